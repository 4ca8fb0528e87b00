//! The exponential, the logarithm and the square root by each library: instructions, errors, and what the
//! errors do to a centre.

use cost_on_chip::float_functions::{self, Function, Library};
use judges::float_functions::{Exp, WIDTHS, cell, change_of_centre};

use crate::programs::cost::chip::{self, Chip};
use crate::table;

/// Exponentials that a step of `gauss-newton` computes.
const IN_A_STEP: f64 = 5.0;

/// The tables of `docs/accuracy.md`: the errors of each function here and its instructions on the chip, and
/// what the exponentials do.
pub fn markdown(chip: &Chip) -> anyhow::Result<String> {
    let counted = |name| chip::of_name(&chip.floats, name);
    let row = |(function, library, name)| {
        let counted = counted(name)?;
        Ok(vec![
            label(function, library).to_owned(),
            format!("{:.0}", counted.instructions),
            format!("{:.0}", counted.most),
            format!("{:.0e}", float_functions::largest_error(function, library)),
        ])
    };
    let functions = float_functions::ALL.map(row).into_iter();
    let functions = functions.collect::<anyhow::Result<Vec<_>>>()?;
    let libm = counted("exp-libm")?.instructions;
    let micromath = counted("exp-micromath")?.instructions;
    Ok(format!(
        "{}\nA step of `gauss-newton` computes five exponentials: {:.0} instructions by `libm`, {:.0} by \
         `micromath`.\n\n{}",
        table::of("function | instructions | most | largest error", functions),
        IN_A_STEP * libm,
        IN_A_STEP * micromath,
        table::of(
            "σ px | centre, libm | centre, micromath",
            WIDTHS.map(effect)
        ),
    ))
}

/// What the exponentials of `libm` and of `micromath` do for spots of a width: the change of the centre of
/// `gauss-newton` over the bound.
fn effect(width: f64) -> Vec<String> {
    let exact: Exp = |x| f64::from(x).exp() as f32;
    let both: [Exp; 2] = [
        |x| float_functions::call(Function::Exp, Library::Libm, x),
        |x| float_functions::call(Function::Exp, Library::Micromath, x),
    ];
    let cell = cell(width);
    let centre = both.map(|exp| change_of_centre(&cell, exp, exact) / cell.spot().bound());
    let [libm, micromath] = centre.map(|part| format!("{:.3} %", 100.0 * part));
    vec![width.to_string(), libm, micromath]
}

const fn label(function: Function, library: Library) -> &'static str {
    match (function, library) {
        (Function::Exp, Library::Micromath) => "exponential, micromath",
        (Function::Exp, _) => "exponential, libm",
        (Function::Ln, Library::Micromath) => "logarithm, micromath",
        (Function::Ln, _) => "logarithm, libm",
        (Function::SquareRoot, Library::Libm) => "square root, libm",
        (Function::SquareRoot, Library::Micromath) => "square root, micromath",
        (Function::SquareRoot, Library::DualMac) => "square root, VSQRT",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::cost::chip::Counted;

    #[test]
    fn each_function_has_a_row_and_one_that_was_not_counted_is_an_error() {
        let counted = |(_, _, name): (Function, Library, &str)| Counted {
            name: name.to_owned(),
            instructions: 40.0,
            most: 60.0,
        };
        let mut chip = Chip {
            floats: float_functions::ALL.map(counted).into(),
            ..Chip::default()
        };
        let page = markdown(&chip).expect("all functions");
        println!("{page}");
        for (function, library, _) in float_functions::ALL {
            let row = format!("| {} | 40 | 60 | ", label(function, library));
            assert_eq!(page.matches(&row).count(), 1, "{row}");
        }
        let step = "computes five exponentials: 200 instructions by `libm`, 200 by `micromath`.";
        assert!(page.contains(step), "{page}");
        chip.floats.pop();
        assert!(markdown(&chip).is_err());
    }
}
