//! What each rung costs on the chip, and how accurate it is: what `help estimator` shows.
//!
//! `cargo cost --write` writes this file from what it measures; edits by hand do not last.

use super::Estimator;

/// What a rung costs and what it gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Figures {
    /// The rung.
    pub estimator: Estimator,
    /// Instructions that [`centre`](super::centre) executes on the chip for a row whose spot is known.
    pub instructions: u32,
    /// The time that they take at 168 MHz, in tenths of a microsecond, by the cycle model of `cargo cost`.
    pub microseconds_tenths: u32,
    /// Root mean square error over the Cramér-Rao bound, times 100: the worst cell in white noise.
    pub white_percent: u16,
    /// The same in shot and read noise.
    pub shot_percent: u16,
}

/// The rungs in the order of [`Estimator::ALL`]. Columns: instructions, tenths of a microsecond, RMSE over the bound times
/// 100 in white noise, and in shot and read noise.
pub const FIGURES: [Figures; 10] = [
    rung(Estimator::Centroid, 1015, 84, 273, 115),
    rung(Estimator::Parabola, 60, 6, 3100, 3100),
    rung(Estimator::LogParabola, 120, 11, 3100, 3100),
    rung(Estimator::ZeroCrossing, 204, 20, 760, 270),
    rung(Estimator::Blocks, 299, 25, 113, 117),
    rung(Estimator::PhaseTable, 354, 30, 110, 114),
    rung(Estimator::Adaptive, 653, 54, 103, 104),
    rung(Estimator::Robust, 1416, 121, 105, 105),
    rung(Estimator::GaussNewton, 37553, 2786, 103, 104),
    rung(Estimator::Fraunhofer, 354, 30, 112, 118),
];

const fn rung(
    estimator: Estimator,
    instructions: u32,
    microseconds_tenths: u32,
    white_percent: u16,
    shot_percent: u16,
) -> Figures {
    Figures {
        estimator,
        instructions,
        microseconds_tenths,
        white_percent,
        shot_percent,
    }
}
