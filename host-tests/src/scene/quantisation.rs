//! The converter's steps.

use serde::{Deserialize, Serialize};

/// A converter of fewer bits than the words have. Without it a row is rounded to whole counts, as words are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quantisation {
    /// Counts from step to step.
    pub step: f64,
}

impl Quantisation {
    /// Rounds a row's counts to steps.
    pub fn apply(&self, counts: &mut [f32]) {
        let step = self.step as f32;
        for count in counts {
            *count = (*count / step).round() * step;
        }
    }
}

/// Rounds to whole counts of the converter.
pub fn quantise(counts: &[f32], full_scale: u16) -> Vec<u16> {
    counts
        .iter()
        .map(|count| count.round().clamp(0.0, f32::from(full_scale)) as u16)
        .collect()
}
