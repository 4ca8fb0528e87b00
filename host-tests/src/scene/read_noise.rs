//! Noise of the sensor's output and the converter.

use rand::Rng;
use rand_distr::{Distribution as _, StandardNormal};
use serde::{Deserialize, Serialize};

/// White and normal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadNoise {
    /// Standard deviation in counts.
    pub counts: f64,
}

impl ReadNoise {
    /// Adds it to a row's counts.
    pub fn apply(&self, counts: &mut [f32], random: &mut impl Rng) {
        for count in counts {
            let normal: f32 = StandardNormal.sample(random);
            *count += self.counts as f32 * normal;
        }
    }
}
