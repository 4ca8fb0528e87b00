//! Unlit pixels differ (dark signal non-uniformity).

use serde::{Deserialize, Serialize};

use crate::scene::{Effect, random};

/// Each pixel's black level differs from the mean by an offset of its own, which stays (EMVA standard 1288,
/// DSNU), whatever light and exposure are. Shielded pixels and dummies have one too.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedPattern {
    /// Standard deviation in counts.
    pub counts: f64,
}

impl FixedPattern {
    /// The offsets in counts of the outputs of a line of the sensor.
    pub fn offsets(&self, seed: u64, line: u64, outputs: usize) -> Vec<f32> {
        let mut random = random::of_line(seed, Effect::FixedPattern, line);
        let deviation = self.counts as f32;
        let offsets = random::normals_of(&mut random, outputs).map(|normal| deviation * normal);
        offsets.collect()
    }
}
