//! Lamps that flicker with the mains.

use std::f64::consts::{PI, TAU};

use rand::Rng as _;
use serde::{Deserialize, Serialize};

use crate::scene::{Ambient, Effect, random};

/// Light of lamps at twice the mains frequency, evenly over the row or brighter to one side. In the middle of
/// the row it is
///
/// ```text
/// counts_per_second (1 + modulation cos(2 pi frequency t + phase))
/// ```
///
/// The modulation is the percent flicker of IEEE Std 1789-2015, (max - min) / (max + min). A row sees the
/// integral over its exposure. With T the exposure and t its middle this is
///
/// ```text
/// counts_per_second (T + modulation sin(pi frequency T) / (pi frequency) cos(2 pi frequency t + phase))
/// ```
///
/// It is light like [`crate::scene::Ambient`]'s, with shot noise of its own. Rows of an exposure that is a
/// whole number of the lamps' periods do not flicker.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MainsLight {
    /// Mean counts a second of exposure.
    pub counts_per_second: f64,
    /// Counts a second by which a pixel is brighter than the one before, in the mean over time.
    #[serde(default)]
    pub slope: f64,
    /// Depth of the modulation, from 0 to 1.
    pub modulation: f64,
    /// Of the light, in Hz: 100 where the mains have 50 Hz, 120 where they have 60 Hz.
    pub frequency: f64,
    /// In the middle of the first row's exposure, in radians. Drawn from the scene's seed if not given.
    #[serde(default)]
    pub phase: Option<f64>,
}

impl MainsLight {
    /// The phase in radians, given or drawn.
    pub fn phase(&self, seed: u64) -> f64 {
        let draw = || TAU * random::of_scene(seed, Effect::MainsLight).random::<f64>();
        self.phase.unwrap_or_else(draw)
    }

    /// Counts in the middle of a row whose exposure has its middle at a time in seconds.
    pub fn counts(&self, phase: f64, time: f64, exposure: f64) -> f64 {
        self.counts_per_second * self.seconds(phase, time, exposure)
    }

    /// For how long the lamps would shine with their mean brightness to give the same light.
    fn seconds(&self, phase: f64, time: f64, exposure: f64) -> f64 {
        let swing = libm::sin(PI * self.frequency * exposure) / (PI * self.frequency);
        exposure + self.modulation * swing * libm::cos(TAU * self.frequency * time + phase)
    }

    /// Adds it to a row of light.
    pub fn add(&self, light: &mut [f32], phase: f64, time: f64, exposure: f64) {
        let steady = Ambient {
            counts_per_second: self.counts_per_second,
            slope: self.slope,
        };
        steady.add(light, self.seconds(phase, time, exposure));
    }
}
