//! What a row shows where no spot is.

use crate::base::Counts;
use crate::row::{Geometry, LARGEST_COUNT};

/// Level and noise of a row away from the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background {
    /// The counts of an unlit pixel.
    pub level: Counts,
    /// Standard deviation of an unlit pixel. At least that of rounding to a count, 1/sqrt(12).
    pub noise: Counts,
}

impl Background {
    /// The level in the bits of [`Counts`], limited to what a row can hold: 0 to 4095 * 2^8 < 2^20.
    pub fn level_bits(&self) -> i32 {
        level_bits(self.level)
    }

    /// Two variances in counts squared: of an unlit pixel, rounding included, and of the shot noise for each
    /// count of light.
    pub fn variances(&self, geometry: &Geometry) -> (f32, f32) {
        let noise = self.noise.to_f32();
        let shot = f32::from(geometry.shot_variance_per_count_q16) / 65536.0;
        (noise * noise, shot)
    }
}

/// A level in the bits of [`Counts`], limited to what a row can hold.
pub(crate) fn level_bits(level: Counts) -> i32 {
    const LARGEST: i32 = (LARGEST_COUNT as i32) << Counts::FRACTION;
    level.to_bits().clamp(0, LARGEST)
}
