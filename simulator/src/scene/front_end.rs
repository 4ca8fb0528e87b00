//! The amplifier between sensor and converter is not the nominal one.

use serde::{Deserialize, Serialize};

/// Gain, offset and the rail of the analog front end, which differ from unit to unit: the TCD1304DG's
/// saturation voltage is 0.6 V typical and 0.45 V at least, its output's level in the dark 1.5 to 3.5 V (data
/// sheet), and the amplifier's resistors have a tolerance.
///
/// Light of x counts in the other effects, and a black level b, make
///
/// ```text
/// min(gain x + b + offset, saturation)
/// ```
///
/// counts. Shot noise and the full well come before: both are in electrons. [`crate::scene::ShotNoise`] has
/// the electrons of a count at a gain of 1, so that a count of the converter stands for
/// `electrons_per_count` / `gain` electrons, and y counts above black have a variance of y `gain` /
/// `electrons_per_count`. Black level, fixed pattern and read noise are those at the converter, and the gain
/// does not change them. The converter adds its noise after the amplifier has clipped.
///
/// The sensor does not know the gain: [`crate::scene::Scene::geometry`] is that of a nominal front end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrontEnd {
    /// A factor on light: 1 for the nominal amplifier and sensor.
    pub gain: f64,
    /// Counts by which all outputs read more.
    #[serde(default)]
    pub offset: f64,
    /// Counts that the output does not exceed, black level included. Without it only the converter's range
    /// limits the output.
    #[serde(default)]
    pub saturation: Option<f64>,
}

impl FrontEnd {
    /// Amplifies a row of light.
    pub fn amplify(&self, light: &mut [f32]) {
        let gain = self.gain as f32;
        light.iter_mut().for_each(|light| *light *= gain);
    }

    /// Adds the offset to a row's counts, and clips them.
    pub fn shift_and_clip(&self, counts: &mut [f32]) {
        let offset = self.offset as f32;
        let rail = self.saturation.map_or(f32::INFINITY, |it| it as f32);
        for count in counts {
            *count = (*count + offset).min(rail);
        }
    }
}
