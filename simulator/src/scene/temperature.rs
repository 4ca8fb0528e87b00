//! The sensor warms up, and its geometry with it.

use serde::{Deserialize, Serialize};

use crate::optics::Optics;

/// Casing, slit mount and sensor grow with temperature.
///
/// Baseline b and focal length f grow by 1 + e, e = expansion times the rise in temperature; angles stay. For
/// a target at rest the centre, f tan(u - atan(d/b)) from the axis at an angle a, then moves in first order
/// by
///
/// ```text
/// e (f tan(a) + f d b / ((b^2 + d^2) cos^2(a)))
/// ```
///
/// which is an error: no estimate knows of it. The mask of a [`crate::scene::Comb`] grows with its mount, by
/// the same factor from the axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Temperature {
    /// Kelvin a second by which the sensor warms up from the temperature at which it was calibrated.
    pub kelvin_per_second: f64,
    /// Expansion of the baseline and of the slit's mount, per kelvin: 23e-6 for aluminium.
    pub expansion: f64,
}

impl Temperature {
    /// The factor by which lengths have grown after a time in seconds.
    pub fn scale(&self, time: f64) -> f64 {
        1.0 + self.expansion * self.kelvin_per_second * time
    }

    /// The geometry after a time in seconds.
    pub fn optics(&self, optics: &Optics, time: f64) -> Optics {
        let scale = self.scale(time);
        Optics {
            baseline: optics.baseline * scale,
            focal_length: optics.focal_length * scale,
            ..*optics
        }
    }
}
