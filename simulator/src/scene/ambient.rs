//! Light that is not the laser's.

use serde::{Deserialize, Serialize};

/// Daylight or lamps that the filter lets through: evenly over the row, or brighter to one side.
///
/// It is light like the laser's, with shot noise of its own; what pixels under metal see of it is nothing, so
/// that their black level is not the background's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ambient {
    /// Counts a second of exposure in the middle of the row.
    pub counts_per_second: f64,
    /// Counts a second by which a pixel is brighter than the one before.
    #[serde(default)]
    pub slope: f64,
}

impl Ambient {
    /// Adds it to a row of light.
    pub fn add(&self, light: &mut [f32], exposure: f64) {
        let middle = (light.len() as f64 - 1.0) / 2.0;
        for (i, light) in light.iter_mut().enumerate() {
            let brightness = self.counts_per_second + self.slope * (i as f64 - middle);
            // Light is not negative, however steep the slope.
            *light += (exposure * brightness).max(0.0) as f32;
        }
    }
}
