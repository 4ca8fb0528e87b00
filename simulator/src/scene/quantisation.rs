//! The converter's steps.

use serde::{Deserialize, Serialize};

/// A converter of fewer bits than the words have. Without it a row is rounded to whole counts, as words are.
///
/// Where noise is larger than half a step, the error of rounding is as good as noise of its own with a
/// variance of step^2 / 12 (W. R. Bennett, "Spectra of quantized signals", Bell System Technical Journal 27,
/// 1948).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quantisation {
    /// Counts from step to step: 16 for 8 bits of 12.
    pub step: f64,
}

impl Quantisation {
    /// Rounds a row's counts to steps, of which the highest is the last one that is not above full scale: a
    /// converter of 8 bits of 12 gives 4080 at most, as its 256 codes begin at 0.
    pub fn apply(&self, counts: &mut [f32], full_scale: u16) {
        let step = self.step as f32;
        let highest = (f32::from(full_scale) / step).floor() * step;
        for count in counts {
            let steps = *count / step;
            // Cutting off the fraction of a half more; `round` would be a call.
            let rounded = (steps + 0.5f32.copysign(steps)) as i32 as f32 * step;
            *count = rounded.min(highest);
        }
    }
}

/// Rounds to whole counts of the converter, which knows none below zero or above full scale.
pub fn quantise(counts: &[f32], full_scale: u16) -> Vec<u16> {
    let largest = f32::from(full_scale);
    counts
        .iter()
        // `clamp` would compare its bounds for each pixel, and the compiler compute one at a time.
        .map(|count| (count.max(0.0).min(largest) + 0.5) as i32 as u16)
        .collect()
}
