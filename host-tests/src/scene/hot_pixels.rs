//! A few pixels leak.

use rand::Rng as _;
use serde::{Deserialize, Serialize};

use crate::scene::{Effect, random};

/// Pixels with a large dark current, at random places that stay.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HotPixels {
    /// Share of the pixels that are hot.
    pub share: f64,
    /// Their dark current in counts a second of exposure.
    pub counts_per_second: f64,
}

impl HotPixels {
    /// The numbers of the hot ones among a sensor's light pixels, ascending.
    pub fn places(&self, seed: u64, pixels: usize) -> Vec<usize> {
        let mut random = random::of_scene(seed, Effect::HotPixels);
        // A number for every pixel: more of a share adds pixels, and takes none away.
        let hot = (0..pixels).map(|_| random.random::<f64>() < self.share);
        hot.enumerate()
            .filter_map(|(pixel, hot)| hot.then_some(pixel))
            .collect()
    }
}
