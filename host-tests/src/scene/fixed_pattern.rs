//! Unlit pixels differ (dark signal non-uniformity).

use serde::{Deserialize, Serialize};

use crate::scene::{Effect, random};

/// Each pixel's black level differs from the mean by an offset of its own, which stays (EMVA standard 1288, DSNU).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedPattern {
    /// Standard deviation in counts.
    pub counts: f64,
}

impl FixedPattern {
    /// The offsets of a sensor's outputs in counts.
    pub fn offsets(&self, seed: u64, outputs: usize) -> Vec<f32> {
        let deviation = self.counts as f32;
        let normals = random::normals_of_scene(seed, Effect::FixedPattern, outputs);
        normals
            .into_iter()
            .map(|normal| deviation * normal)
            .collect()
    }
}
