//! A pixel holds so much and no more.

use serde::{Deserialize, Serialize};

/// Full well, and what becomes of the charge beyond it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Saturation {
    /// Counts of light that fill a pixel.
    pub full_well: f64,
    /// Share of the charge beyond it that flows over into the neighbours, half to each side, and on from there (blooming).
    #[serde(default)]
    pub blooming: f64,
}

impl Saturation {
    /// Limits a row of light.
    pub fn apply(&self, light: &mut [f32]) {
        let full = self.full_well as f32;
        for light in light {
            *light = light.min(full);
        }
    }
}
