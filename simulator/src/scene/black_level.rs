//! What an unlit pixel reads.

use serde::{Deserialize, Serialize};

/// The counts of an unlit pixel (the paper's black threshold t), and how they drift as the sensor warms up.
///
/// It is an offset of the output amplifier and the converter, the same for all outputs, shielded pixels and
/// dummies among them. The mean dark current, which shielded pixels have too, is taken to be part of it, and
/// its noise part of the read noise; pixels of which that would be untrue are [`crate::scene::HotPixels`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlackLevel {
    /// Counts at the start.
    pub counts: f64,
    /// Counts a second by which it rises.
    #[serde(default)]
    pub drift: f64,
}

impl BlackLevel {
    /// One that does not drift.
    pub const fn steady(counts: f64) -> Self {
        Self { counts, drift: 0.0 }
    }

    /// Counts after a time in seconds.
    pub fn after(&self, time: f64) -> f64 {
        self.counts + self.drift * time
    }
}
