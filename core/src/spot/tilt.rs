//! A background that rises along the row, as sunlight from one side makes it. The search subtracts it.
//!
//! Its slope is the median of the steps from one large block to the next. A spot makes as many steps up as
//! down, so it counts for little, however many blocks it covers.

use heapless::Vec;

use crate::base::order_statistic::{from_ordered, ordered};
use crate::base::{Counts, numeric};
use crate::row::Light;
use crate::spot::{LARGEST_BLOCK_LOG2, MEDIAN_BLOCKS, median};

/// Bits after the binary point of a slope.
const FRACTION: u32 = 16;

/// A background that rises, or falls, by the same from each pixel to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tilt {
    /// Counts a pixel, Q16. Below 2^27, because blocks have at least two pixels and their means differ by at
    /// most 4095.
    slope: i64,
}

impl Tilt {
    /// Measures the tilt from the sums over a row's blocks of 2^`block_log2` pixels, if it may hide a spot of
    /// this height. It may if the background's change from the row's middle to its end is more than a quarter
    /// of the height, and more than twice a pixel's noise. Noise alone makes a change of 0.4 of a pixel's
    /// noise, so that limit is five standard deviations. (28 blocks of 128 pixels: median steps scatter by
    /// 1.25 sqrt(2 / 128) / sqrt(27), and half a row has 14 of them.)
    ///
    /// `None` too for fewer than two sums, or for more than a median takes.
    pub(super) fn that_may_hide(
        sums: &[u32],
        block_log2: u32,
        pixels: usize,
        height: Counts,
        noise: Counts,
    ) -> Option<Self> {
        // Sums of at most 128 pixels of 12 bits: below 2^19.
        let steps = (sums.iter().zip(sums.iter().skip(1)))
            .map(|(this, next)| numeric::sub_i32(*next as i32, *this as i32));
        let may_hide = |step: i32| {
            let drift = Self::of(step, block_log2).rise(pixels / 2);
            drift > 2 * i64::from(noise.to_bits()) && drift > i64::from(height.to_bits()) / 4
        };
        // The median is large only if half of the steps are. Most rows have few large steps, and need no
        // median.
        let hiding = numeric::count(steps.clone().map(may_hide));
        if hiding < sums.len().saturating_sub(1) / 2 {
            return None;
        }
        let mut keys: Vec<u32, MEDIAN_BLOCKS> = Vec::new();
        for step in steps {
            keys.push(ordered(step)).ok()?;
        }
        let step = from_ordered(median(&keys)?);
        may_hide(step).then(|| Self::of(step, block_log2))
    }

    /// The tilt of this step from block to block.
    fn of(step: i32, block_log2: u32) -> Self {
        // The step of the sums, divided by the pixels of a block, is the step of the means. Divided by them
        // again, it is the slope.
        Self {
            slope: (i64::from(step) * (1 << FRACTION)) >> (2 * block_log2.min(LARGEST_BLOCK_LOG2)),
        }
    }

    /// How much the background changes over so many pixels, without sign, Q24.8 counts.
    fn rise(self, pixels: usize) -> i64 {
        // A slope is below 2^27, and a row has at most 2^12 pixels.
        numeric::mul_i64(self.slope.saturating_abs(), pixels as i64)
            >> (FRACTION - Counts::FRACTION)
    }

    /// How much higher the background is at a pixel than at the row's dark end, Q24.8 counts. At most 2^20,
    /// the most that a row can hold.
    pub(super) fn height_at(self, light: Light<'_>, pixel: usize) -> i32 {
        let from_dark = if self.slope > 0 {
            pixel
        } else {
            light.len().saturating_sub(pixel).saturating_sub(1)
        };
        numeric::i64_to_i32(self.rise(from_dark).min(1 << 20))
    }

    /// Writes a row without the tilt to `untilted`, and returns its lowest count. That lowest count is
    /// subtracted too: otherwise a row whose dark end is near zero would be cut off there.
    pub(super) fn subtract_from(self, light: Light<'_>, untilted: &mut [u16]) -> i32 {
        /// The highest tilt that a row can hold, Q16: 4096 counts. Beyond, the tilt stays as high.
        const HIGHEST: i32 = 1 << (12 + FRACTION);
        // Below 2^27.
        let slope = numeric::i64_to_i32(self.slope);
        let (words, inverted) = light.words();
        // The pixels, counted from the dark end, where the tilt is not higher than that.
        let sloping = (HIGHEST.unsigned_abs().checked_div(slope.unsigned_abs()))
            .map_or(words.len(), |steps| {
                words.len().min((steps as usize).saturating_add(1))
            });
        let subtract_slope = |words: &[u16], untilted: &mut [u16]| {
            let start = if slope > 0 {
                0
            } else {
                // At most `HIGHEST`.
                let steps = numeric::to_i32(words.len().saturating_sub(1));
                numeric::mul_i32(slope.saturating_neg(), steps)
            };
            dual_mac::subtract_slope(words, inverted, start, slope, untilted)
        };
        let subtract_highest = |words: &[u16], untilted: &mut [u16]| {
            dual_mac::subtract_slope(words, inverted, HIGHEST, 0, untilted)
        };
        let middle = if slope > 0 {
            sloping
        } else {
            words.len().saturating_sub(sloping)
        };
        let (left, right) = words.split_at_checked(middle).unwrap_or_default();
        let (to_left, to_right) = untilted.split_at_mut_checked(middle).unwrap_or_default();
        let lowest = if slope > 0 {
            subtract_slope(left, to_left).min(subtract_highest(right, to_right))
        } else {
            subtract_highest(left, to_left).min(subtract_slope(right, to_right))
        };
        dual_mac::subtract_to_12_bits(untilted, lowest);
        lowest.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::LARGEST_COUNT;

    /// A row without its tilt, and the tilt at each pixel, make the row again.
    #[test]
    fn a_tilt_that_is_subtracted_has_the_height_that_it_has_at_a_pixel() {
        // Up to 2^20 / 2^16 = 16 counts a pixel: more than a row of 300 pixels holds.
        let steep = [0, 1, 65_536, 700_000, 1 << 20].into_iter();
        for slope in steep.flat_map(|slope| [slope, -slope]) {
            let tilt = Tilt { slope };
            let light: Vec<u16, 300> = (0..300).map(|pixel| 4095 - 7 * pixel).collect();
            let mut untilted = [0; 300];
            let lowest = tilt.subtract_from(light.as_slice().into(), &mut untilted);
            assert_eq!(untilted.iter().min(), Some(&0), "{slope}");
            for (pixel, (&count, &without)) in light.iter().zip(&untilted).enumerate() {
                let height = tilt.height_at(light.as_slice().into(), pixel) >> Counts::FRACTION;
                let expected = i32::from(count) - height - lowest;
                let without = i32::from(without);
                assert_eq!(
                    without,
                    expected.min(LARGEST_COUNT.into()),
                    "{slope}, {pixel}"
                );
            }
        }
    }
}
