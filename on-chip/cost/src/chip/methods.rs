//! The methods, each with the spot already known.

use cost_on_chip::inputs::{self, Input, Searched};
use cost_on_chip::methods::{self, Method};
use cost_on_chip::rows::{self, PIXELS, ROWS, Turn, WIDTHS};
use slitrange::{Estimator, Fault, RowCentre};

use super::board::let_the_log_out;
use super::counter::{self, Cost};

/// What a method gives, once it was called.
type Output = Option<Result<RowCentre, Fault>>;

/// Counts every method on [`ROWS`] rows of each width.
pub fn measure() {
    let geometry = rows::geometry();
    let (mut before, mut now) = ([0; PIXELS], [0; PIXELS]);
    for width in WIDTHS {
        let mut costs = [[Cost::default(); ROWS]; METHODS.len()];
        for row in 0..ROWS {
            rows::light(width, row, Turn::Before, &mut before);
            rows::light(width, row, Turn::Now, &mut now);
            let (before, now) = (
                defmt::unwrap!(inputs::searched(&before).ok()),
                defmt::unwrap!(inputs::searched(&now).ok()),
            );
            for ((method, function), costs) in METHODS.into_iter().zip(&mut costs) {
                let input = inputs::input(method, &before, now, &geometry);
                let mut output = None;
                costs[row] = counter::count(function, &input, &mut output);
                print_row(method, width, row, &defmt::unwrap!(output));
            }
        }
        for ((method, _), costs) in METHODS.into_iter().zip(costs) {
            counter::print("method", method.name(), ("width", width), costs);
        }
    }
}

/// The bits of what was found, so that a PC can be asked for the same.
fn print_row(method: Method, width: f32, row: usize, output: &Result<RowCentre, Fault>) {
    match output {
        Ok(found) => defmt::println!(
            "row {} width {} number {} centre {} uncertainty {}",
            method.name(),
            width,
            row,
            found.centre.to_bits(),
            found.uncertainty.to_bits()
        ),
        Err(fault) => defmt::println!(
            "row {} width {} number {} fault {}",
            method.name(),
            width,
            row,
            fault.name()
        ),
    }
    let_the_log_out();
}

/// A function that runs a method on an input of any row.
type Function = extern "C" fn(&Input<'_>, &mut Output);

/// Inlined with a constant method, so that none of the other methods' code can be reached from where it is.
#[inline(always)]
fn run(method: Method, input: &Input<'_>, output: &mut Output) {
    let Searched { row, spot } = &input.searched;
    let before = input.before.as_ref();
    *output = Some(methods::centre(method, row, spot, before, input.geometry));
}

/// Gives each method a function under a name that it keeps in the ELF file: `cargo cost` counts a method's
/// code from there.
macro_rules! functions {
    ($($function:ident: $method:expr,)*) => {
        /// The methods in the order of [`Method::ALL`], each with the function that is counted.
        const METHODS: [(Method, Function); Method::ALL.len()] = [$(($method, $function),)*];
        $(
            #[inline(never)]
            #[unsafe(no_mangle)]
            extern "C" fn $function(input: &Input<'_>, output: &mut Output) {
                run($method, input, output);
            }
        )*
    };
}

functions! {
    method_centroid: Method::Estimator(Estimator::Centroid),
    method_phase_table: Method::Estimator(Estimator::PhaseTable),
    method_adaptive: Method::Estimator(Estimator::Adaptive),
    method_gauss_newton: Method::Estimator(Estimator::GaussNewton),
    method_fraunhofer: Method::Estimator(Estimator::Fraunhofer),
    method_repair: Method::Repair,
}
