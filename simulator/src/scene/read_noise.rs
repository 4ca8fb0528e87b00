//! Noise of the sensor's output and the converter.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::scene::random;

/// White and normal: temporal dark noise that light does not change (EMVA standard 1288; J. R. Janesick,
/// "Photon Transfer", SPIE 2007).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadNoise {
    /// Standard deviation in counts.
    pub counts: f64,
}

impl ReadNoise {
    /// Adds it to a row's counts, shielded and dummy outputs among them: they pass the same amplifier.
    pub fn apply(&self, counts: &mut [f32], random: &mut ChaCha8Rng) {
        let deviation = self.counts as f32;
        for block in counts.chunks_mut(random::BLOCK) {
            for (count, normal) in block.iter_mut().zip(&random::normals(random)) {
                *count += deviation * normal;
            }
        }
    }
}
