//! What each rung costs on the chip, and how accurate it is: what `help estimator` shows.
//!
//! `cargo cost` writes the figures, in `figures/measured.rs`.

mod measured;

use super::Estimator;

pub use measured::FIGURES;

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
