//! Pixels differ in what they make of light (photo-response non-uniformity).

use serde::{Deserialize, Serialize};

use crate::scene::{Effect, random};

/// Each pixel's response differs from the mean by a factor of its own, which stays (EMVA standard 1288,
/// PRNU): the deviation from pixel to pixel grows with the light, and is nothing in the dark.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Response {
    /// Standard deviation of the response over its mean: 0.01 for 1 %.
    pub deviation: f64,
}

impl Response {
    /// The factors of the light pixels of a line of the sensor.
    pub fn factors(&self, seed: u64, line: u64, pixels: usize) -> Vec<f32> {
        let mut random = random::of_line(seed, Effect::Response, line);
        let deviation = self.deviation as f32;
        // No pixel makes less than nothing of light.
        let factor = |normal: f32| (1.0 + deviation * normal).max(0.0);
        let factors = random::normals_of(&mut random, pixels).map(factor);
        factors.collect()
    }
}
