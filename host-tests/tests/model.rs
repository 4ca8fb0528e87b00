//! The core's fixed-point algorithms in f64, nothing rounded: what is left of a difference is what fixed
//! point and f32 cost.

use crate::support::*;
pub mod centroid;
pub mod phase_table;

/// Eq. (1) as D + K/(x - xp), in micrometres.
pub fn distance(curve: &Eq1, centre: f64) -> f64 {
    // K in Q48.16 is below 2^55: an f64 holds all but two bits of it.
    curve.d().to_f64() + curve.k() as f64 / 65536.0 / (centre - curve.pole().to_f64())
}
