//! The output has not settled when the converter samples it.

use serde::{Deserialize, Serialize};

/// From pixel to pixel, in seconds: 16 periods of the converter's clock of 10.5 MHz.
pub const PIXEL: f64 = 16.0 / 10.5e6;
/// From the start of a pixel to the moment at which the firmware's converter holds it, in seconds: 70 % of a
/// pixel (`src/heads/tcd1304.rs`).
pub const HOLD: f64 = 0.7 * PIXEL;

/// A low pass of first order between the sensor and the converter: output impedance and capacitance, or the
/// amplifier's bandwidth.
///
/// The sensor's output is a step from pixel to pixel. After a time t within a pixel of level x, the output is
///
/// ```text
/// x + (v - x) exp(-t / time_constant)
/// ```
///
/// where v is the output at the end of the pixel before. The converter samples it at t = [`HOLD`]. With
/// a = exp(-HOLD / time_constant) and b = exp(-PIXEL / time_constant), a pixel gives the share 1 - a of its
/// light to its own sample, and a (1 - b) b^(k - 1) to the sample k pixels later. So the light stays, and a
/// spot moves along the row by a / (1 - b) pixels: 0.03 for 0.3 us, 0.18 for 0.6 us. A calibration on the
/// same head takes a steady shift out.
///
/// All sensors have the times of the TCD1304DG behind the firmware's converter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settling {
    /// Seconds in which the difference falls to 1/e.
    pub time_constant: f64,
}

impl Settling {
    /// Pixels by which a spot moves: the mean delay of the light.
    pub fn shift(&self) -> f64 {
        let [at_hold, at_end] = self.shares();
        at_hold / (1.0 - at_end)
    }

    /// Makes the samples of a row from the levels of its outputs, in the order in which they are read. The
    /// output has settled at the level of the first one before the row begins.
    pub fn apply(&self, counts: &mut [f32]) {
        let [at_hold, at_end] = self.shares();
        let mut output = counts.first().map_or(0.0, |&first| f64::from(first));
        for count in counts {
            let level = f64::from(*count);
            let difference = output - level;
            *count = (level + difference * at_hold) as f32;
            output = level + difference * at_end;
        }
    }

    /// Shares of a step that are left when the converter holds, and at the end of the pixel.
    fn shares(&self) -> [f64; 2] {
        [HOLD, PIXEL].map(|time| libm::exp(-time / self.time_constant))
    }
}
