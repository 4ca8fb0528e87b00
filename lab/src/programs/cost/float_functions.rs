//! The exponential, the logarithm and the square root by each library: instructions, errors, and what the
//! errors do to a centre and to the check.

use anyhow::Context as _;
use cost_on_chip::float_functions::{self, Function, Library};
use judges::float_functions::{Exp, WIDTHS, cell, change_of_centre, errors_in_the_check};

use crate::programs::cost::chip::Chip;
use crate::table::{self, cells};

/// Exponentials that the check of a row computes, and a step of `gauss-newton`.
const IN_THE_CHECK: f64 = 3.0;
const IN_A_STEP: f64 = 5.0;

/// All that was measured.
#[derive(Default)]
pub struct FloatFunctions {
    functions: Vec<Measured>,
    effects: Vec<Effect>,
}

/// A function of a library.
struct Measured {
    function: Function,
    library: Library,
    /// Instructions of a call, the median over the arguments, and the most.
    instructions: f64,
    instructions_most: f64,
    /// See [`float_functions::largest_error`].
    error: f64,
}

/// What the exponentials of `libm` and of `micromath` do for spots of a width.
struct Effect {
    width: f64,
    /// The change of the centre of `gauss-newton` over the bound.
    centre: [f64; 2],
    /// The largest error of e in the check.
    e: [f64; 2],
    /// The shape's misfit that this error alone makes, by `micromath`.
    misfit: f64,
}

/// Measures the errors here, and takes the instructions from the chip.
///
/// # Errors
/// The chip's program did not count a function.
pub fn measure(chip: &Chip) -> anyhow::Result<FloatFunctions> {
    let functions = float_functions::ALL.map(|(function, library)| {
        let name = float_functions::name(function, library);
        let counted = chip.floats.iter().find(|counted| counted.name == name);
        let counted =
            counted.with_context(|| format!("the chip's program did not count {name}"))?;
        Ok(Measured {
            function,
            library,
            instructions: counted.instructions,
            instructions_most: counted.instructions_most,
            error: float_functions::largest_error(function, library),
        })
    });
    Ok(FloatFunctions {
        functions: functions.into_iter().collect::<anyhow::Result<_>>()?,
        effects: WIDTHS.map(effect).into(),
    })
}

fn effect(width: f64) -> Effect {
    let exact: Exp = |x| f64::from(x).exp() as f32;
    let of: fn(Library) -> Exp = |library| match library {
        Library::Micromath => |x| float_functions::call(Function::Exp, Library::Micromath, x),
        _ => |x| float_functions::call(Function::Exp, Library::Libm, x),
    };
    let both = [Library::Libm, Library::Micromath].map(of);
    let cell = cell(width);
    let in_check = both.map(|exp| errors_in_the_check(exp, width as f32));
    Effect {
        width,
        centre: both.map(|exp| change_of_centre(&cell, exp, exact) / cell.spot().bound()),
        e: in_check.map(|(e, _)| e),
        misfit: in_check[1].1,
    }
}

impl FloatFunctions {
    /// The tables of `docs/accuracy.md`.
    pub fn markdown(&self) -> String {
        let exponential = |library| {
            let is_it = |it: &&Measured| it.function == Function::Exp && it.library == library;
            let found = self.functions.iter().find(is_it);
            found.map_or(f64::NAN, |it| it.instructions)
        };
        let [libm, micromath] = [Library::Libm, Library::Micromath].map(exponential);
        format!(
            "{}\nThe check of a row computes three exponentials: {:.0} instructions by `libm`, {:.0} by \
             `micromath`. A step of `gauss-newton` computes five: {:.0} and {:.0}.\n\n{}",
            table::markdown(&self.function_table()),
            IN_THE_CHECK * libm,
            IN_THE_CHECK * micromath,
            IN_A_STEP * libm,
            IN_A_STEP * micromath,
            table::markdown(&self.effect_table()),
        )
    }

    fn function_table(&self) -> Vec<Vec<String>> {
        let mut rows = vec![cells(&[
            "function",
            "instructions",
            "most",
            "largest error",
        ])];
        rows.extend(self.functions.iter().map(|it| {
            vec![
                label(it.function, it.library).to_owned(),
                format!("{:.0}", it.instructions),
                format!("{:.0}", it.instructions_most),
                format!("{:.0e}", it.error),
            ]
        }));
        rows
    }

    fn effect_table(&self) -> Vec<Vec<String>> {
        let mut rows = vec![cells(&[
            "σ px",
            "centre, libm",
            "centre, micromath",
            "e, libm",
            "e, micromath",
            "misfit, micromath",
        ])];
        rows.extend(self.effects.iter().map(|it| {
            let [libm, micromath] = it.centre.map(|part| format!("{:.3} %", 100.0 * part));
            let [e, approximate] = it.e.map(|error| format!("{error:.0e}"));
            let misfit = format!("{:.0e}", it.misfit);
            let width = it.width.to_string();
            vec![width, libm, micromath, e, approximate, misfit]
        }));
        rows
    }
}

/// What a reader calls it.
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
    use crate::programs::cost::chip::FloatOnChip;

    #[test]
    fn each_function_has_a_row_and_one_that_was_not_counted_is_an_error() {
        let counted = |(function, library)| FloatOnChip {
            name: float_functions::name(function, library).to_owned(),
            instructions: 40.0,
            instructions_most: 60.0,
        };
        let mut chip = Chip {
            floats: float_functions::ALL.map(counted).into(),
            ..Chip::default()
        };
        let page = measure(&chip).expect("all functions").markdown();
        println!("{page}");
        for (function, library) in float_functions::ALL {
            let row = format!("| {} | 40 | 60 | ", label(function, library));
            assert_eq!(page.matches(&row).count(), 1, "{row}");
        }
        assert!(page.contains("120 instructions by `libm`"), "{page}");
        assert!(page.contains("computes five: 200 and 200."), "{page}");
        chip.floats.pop();
        assert!(measure(&chip).is_err());
    }
}
