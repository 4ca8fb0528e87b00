//! The rungs of the ladder, each with the spot already known.

use cost_on_chip::inputs::{self, Input, Searched};
use cost_on_chip::rows::{self, PIXELS, ROWS, Turn, WIDTHS};
use slitrange::centre::{self, Estimator, RowCentre};
use slitrange::fault::Fault;

use super::board::let_the_log_out;
use super::counter::{self, Cost};

/// What a rung gives, once it was called.
type Output = Option<Result<RowCentre, Fault>>;

/// Counts every rung on [`ROWS`] rows of each width.
pub fn measure() {
    let geometry = rows::geometry();
    let (mut before, mut now) = ([0; PIXELS], [0; PIXELS]);
    for width in WIDTHS {
        let mut costs = [[Cost::default(); ROWS]; Estimator::ALL.len()];
        for row in 0..ROWS {
            rows::light(width, row, Turn::Before, &mut before);
            rows::light(width, row, Turn::Now, &mut now);
            let (before, now) = (
                defmt::unwrap!(inputs::searched(&before).ok()),
                defmt::unwrap!(inputs::searched(&now).ok()),
            );
            for (estimator, costs) in Estimator::ALL.into_iter().zip(&mut costs) {
                let input = inputs::input(estimator, &before, now, &geometry);
                let mut output = None;
                costs[row] = counter::count(wrapper(estimator), &input, &mut output);
                print_row(estimator, width, row, &defmt::unwrap!(output));
            }
        }
        for (estimator, costs) in Estimator::ALL.into_iter().zip(costs) {
            let cost = counter::summary(costs);
            defmt::println!(
                "rung {} width {} cycles {} most {} stack {}",
                estimator.name(),
                width,
                cost.median,
                cost.most,
                cost.stack
            );
            let_the_log_out();
        }
    }
}

/// The bits of what was found, so that a PC can be asked for the same.
fn print_row(estimator: Estimator, width: f32, row: usize, output: &Result<RowCentre, Fault>) {
    match output {
        Ok(found) => defmt::println!(
            "row {} width {} number {} centre {} uncertainty {}",
            estimator.name(),
            width,
            row,
            found.centre.to_bits(),
            found.uncertainty.to_bits()
        ),
        Err(fault) => defmt::println!(
            "row {} width {} number {} fault {}",
            estimator.name(),
            width,
            row,
            fault.name()
        ),
    }
    let_the_log_out();
}

/// A rung, for an input of any row.
type Wrapper = extern "C" fn(&Input<'_>, &mut Output);

/// The function that is counted for a rung.
fn wrapper(estimator: Estimator) -> Wrapper {
    match estimator {
        Estimator::Centroid => rung_centroid,
        Estimator::Parabola => rung_parabola,
        Estimator::LogParabola => rung_log_parabola,
        Estimator::ZeroCrossing => rung_zero_crossing,
        Estimator::Blocks => rung_blocks,
        Estimator::PhaseTable => rung_phase_table,
        Estimator::Adaptive => rung_adaptive,
        Estimator::Robust => rung_robust,
        Estimator::GaussNewton => rung_gauss_newton,
        Estimator::Fraunhofer => rung_fraunhofer,
    }
}

/// Inlined with a constant estimator, so that none of the other rungs' code can be reached from where it is.
#[inline(always)]
fn run(estimator: Estimator, input: &Input<'_>, output: &mut Output) {
    let Searched { row, spot } = &input.searched;
    let before = input.before.as_ref();
    *output = Some(centre::centre(estimator, row, spot, before, input.geometry));
}

// Under names that they keep in the ELF file: `cargo cost` counts a rung's code from here.

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_centroid(input: &Input<'_>, output: &mut Output) {
    run(Estimator::Centroid, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_parabola(input: &Input<'_>, output: &mut Output) {
    run(Estimator::Parabola, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_log_parabola(input: &Input<'_>, output: &mut Output) {
    run(Estimator::LogParabola, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_zero_crossing(input: &Input<'_>, output: &mut Output) {
    run(Estimator::ZeroCrossing, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_blocks(input: &Input<'_>, output: &mut Output) {
    run(Estimator::Blocks, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_phase_table(input: &Input<'_>, output: &mut Output) {
    run(Estimator::PhaseTable, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_adaptive(input: &Input<'_>, output: &mut Output) {
    run(Estimator::Adaptive, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_robust(input: &Input<'_>, output: &mut Output) {
    run(Estimator::Robust, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_gauss_newton(input: &Input<'_>, output: &mut Output) {
    run(Estimator::GaussNewton, input, output);
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn rung_fraunhofer(input: &Input<'_>, output: &mut Output) {
    run(Estimator::Fraunhofer, input, output);
}
