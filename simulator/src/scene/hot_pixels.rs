//! A few pixels leak.

use rand::Rng as _;
use serde::{Deserialize, Serialize};

use crate::scene::{Effect, random};

/// Pixels with a large dark current, at random places that stay: each pixel is hot with the same probability,
/// whatever the others are.
///
/// Dark current is charge like light's, and doubles it in twice the exposure; it has shot noise and fills the
/// well. It is not light: a pixel's response does not change it (EMVA standard 1288; J. R. Janesick, "Photon
/// Transfer", SPIE 2007).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HotPixels {
    /// Share of the light pixels that are hot. The few shielded ones are taken to be sound.
    pub share: f64,
    /// Their dark current in counts a second of exposure.
    pub counts_per_second: f64,
}

impl HotPixels {
    /// The numbers of the hot ones among the light pixels of a line of the sensor, ascending.
    pub fn places(&self, seed: u64, line: u64, pixels: usize) -> Vec<usize> {
        let mut random = random::of_line(seed, Effect::HotPixels, line);
        // A number for every pixel: more of a share adds pixels, and takes none away.
        let hot = (0..pixels).map(|_| random.random::<f64>() < self.share);
        let places = hot.enumerate().filter(|(_, hot)| *hot);
        places.map(|(pixel, _)| pixel).collect()
    }

    /// Adds the dark current of the hot ones to a row of light.
    pub fn add(&self, light: &mut [f32], places: &[usize], exposure: f64) {
        for &place in places {
            light[place] += (self.counts_per_second * exposure) as f32;
        }
    }
}
