//! The target's reflectivity changes.

use serde::{Deserialize, Serialize};

/// Targets of different reflectivity, one after the other: from the darkest to the brightest and back, in
/// equal steps of the logarithm. Each stays for the same time, and the next one comes at once, between two
/// rows.
///
/// The laser's light is that of the brightest target times the factor. All other light stays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reflectivity {
    /// The darkest target's light over that of the brightest.
    pub darkest: f64,
    /// Steps from the darkest target to the brightest.
    pub steps: u32,
    /// For how long each target stays, in seconds.
    pub seconds: f64,
}

impl Reflectivity {
    /// The target's light over that of the brightest, after a time in seconds.
    pub fn factor(&self, time: f64) -> f64 {
        let steps = f64::from(self.steps);
        let place = (time / self.seconds).floor().rem_euclid(2.0 * steps);
        // Up to the brightest, and then down.
        libm::pow(self.darkest, (place - steps).abs() / steps)
    }

    /// Dims the laser's light on a row.
    pub fn apply(&self, light: &mut [f32], time: f64) {
        let factor = self.factor(time) as f32;
        light.iter_mut().for_each(|light| *light *= factor);
    }
}
