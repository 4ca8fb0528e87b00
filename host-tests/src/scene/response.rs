//! Pixels differ in what they make of light (photo-response non-uniformity).

use serde::{Deserialize, Serialize};

use crate::scene::{Effect, random};

/// Each pixel's response differs from the mean by a factor of its own, which stays (EMVA standard 1288, PRNU).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Response {
    /// Standard deviation of the response over its mean: 0.01 for 1 %.
    pub deviation: f64,
}

impl Response {
    /// The factors of a sensor's pixels.
    pub fn factors(&self, seed: u64, pixels: usize) -> Vec<f32> {
        let deviation = self.deviation as f32;
        let normals = random::normals_of_scene(seed, Effect::Response, pixels);
        let factors = normals.into_iter().map(|normal| 1.0 + deviation * normal);
        // No pixel makes less than nothing of light.
        factors.map(|factor| factor.max(0.0)).collect()
    }
}
