//! Numbers as the core holds them, in fixed point.

use slitrange::base::units::{Micrometres, Pixels};

/// The nearest number of micrometres that can be held.
pub fn micrometres(value: f64) -> Micrometres {
    Micrometres::from_bits((value * f64::from(1 << Micrometres::FRACTION)).round() as i32)
}

/// The centre after `part` of `of` equal steps from one centre to another.
pub fn part_of_way(from: Pixels, to: Pixels, part: i32, of: i32) -> Pixels {
    let (from, to) = (i64::from(from.to_bits()), i64::from(to.to_bits()));
    Pixels::from_bits((from + (to - from) * i64::from(part) / i64::from(of)) as i32)
}

/// The nearest number of pixels that can be held.
pub fn pixels(value: f64) -> Pixels {
    Pixels::from_bits((value * f64::from(1 << Pixels::FRACTION)).round() as i32)
}
