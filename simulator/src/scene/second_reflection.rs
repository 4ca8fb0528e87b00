//! A second spot, by way of another surface.

use serde::{Deserialize, Serialize};

use crate::scene::spot::Spot;

/// Light that reaches the sensor by way of a shiny surface beside the target, or from a second layer of a
/// clear one: a gaussian beside the spot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SecondReflection {
    /// Pixels from the spot's centre to its own.
    pub offset: f64,
    /// Its sigma in pixels.
    pub width: f64,
    /// Its height over the spot's.
    pub strength: f64,
}

impl SecondReflection {
    /// Adds it to a row of light whose spot is `amplitude` counts high at pixel `centre`.
    pub fn add(&self, light: &mut [f32], centre: f64, amplitude: f64) {
        Spot::new(self.width, 0.0).add(light, centre + self.offset, amplitude * self.strength);
    }
}
