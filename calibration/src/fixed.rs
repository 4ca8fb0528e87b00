//! Numbers as the core holds them, in fixed point.

use slitrange::base::units::{Micrometres, Pixels};

/// The nearest number of micrometres that can be held.
pub fn micrometres(value: f64) -> Micrometres {
    Micrometres::from_bits((value * f64::from(1 << Micrometres::FRACTION)).round() as i32)
}

/// The nearest number of pixels that can be held.
pub fn pixels(value: f64) -> Pixels {
    Pixels::from_bits((value * f64::from(1 << Pixels::FRACTION)).round() as i32)
}
