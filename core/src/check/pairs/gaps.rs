//! Which pairs do not count, because a pixel of their samples is saturated or masked.

use core::ops::Range;

use super::{MOST_PAIRS, Pairs};
use crate::base::numeric;
use crate::centre::gauss_newton::MaskedPixels;
use crate::row::Light;

/// Which samples do not count.
pub struct Gaps<'a> {
    /// If any pixel of the row is saturated: from which count on.
    pub saturation: Option<u16>,
    pub masked: &'a MaskedPixels,
}

impl Gaps<'_> {
    /// Whether no pixel of a range is saturated or masked. `false` off the row.
    pub(super) fn leave(&self, light: Light<'_>, pixels: Range<usize>) -> bool {
        let Some(counts) = light.slice(pixels.clone()) else {
            return false;
        };
        let is_cut = |saturation| counts.iter().any(|count| count >= saturation);
        let has_masked = || pixels.clone().any(|pixel| self.masked.has(pixel));
        !(self.saturation.is_some_and(is_cut) || self.masked.samples != 0 && has_masked())
    }
}

impl Pairs<'_> {
    /// A bit for each pair, the lowest for the first: whether the pair does not count.
    #[cold]
    #[inline(never)]
    pub(super) fn places_of_gaps(&self) -> u64 {
        let pixels = self.pixels.max(1);
        // Where the samples to the right start, and where those to the left end.
        let from = self.mirror.right.saturating_sub(1);
        let end = self.mirror.left;
        let mut gaps = 0u64;
        // The bits of the pairs before one.
        let below = |pair: usize| {
            1u64.wrapping_shl(numeric::to_u32(pair.min(MOST_PAIRS)))
                .wrapping_sub(1)
        };
        // A sample takes its pixels, and one at either end. How far the nearest and the furthest pixel of a
        // gap are from there tells the first and the last pair.
        let mark = |gap: Range<usize>| {
            let last = gap.end.saturating_sub(1);
            let to_right = last.checked_sub(from);
            let to_left = end.checked_sub(gap.start);
            let sides = [
                to_right.map(|furthest| (gap.start.saturating_sub(from), furthest)),
                to_left.map(|furthest| (end.saturating_sub(last), furthest)),
            ];
            for (nearest, furthest) in sides.into_iter().flatten() {
                let first = (nearest.saturating_sub(pixels.saturating_add(1))).div_ceil(pixels);
                // The pairs up to the last, without those before the first.
                let end = (furthest / pixels).saturating_add(1);
                gaps |= below(end) & !below(first);
            }
        };
        self.gaps.masked.runs().for_each(mark);
        if let Some(saturation) = self.gaps.saturation {
            let below = u32::from(saturation.saturating_sub(1));
            let is_cut = |pixels: Range<usize>| {
                let end = pixels.end.min(self.light.len());
                let near = self.light.slice(pixels.start..end);
                near.is_some_and(|near| near.exceeds(below))
            };
            // Whether some pairs side by side have a gap. A row has at most 2^12 pixels.
            let have_gap = |pairs: Range<usize>| {
                let nearest = pairs.start.wrapping_mul(pixels);
                let furthest = pairs.end.wrapping_mul(pixels).wrapping_add(1);
                let right = from.wrapping_add(nearest)..from.wrapping_add(furthest).wrapping_add(1);
                let left = end.saturating_sub(furthest)..end.saturating_sub(nearest);
                is_cut(right) || is_cut(left.start..left.end.saturating_add(1))
            };
            let number = self.number().1.min(MOST_PAIRS);
            for first in (0..number).step_by(4) {
                let four = first..first.saturating_add(4).min(number);
                if have_gap(four.clone()) {
                    for pair in four.filter(|&pair| have_gap(pair..pair.wrapping_add(1))) {
                        gaps |= 1u64.wrapping_shl(numeric::to_u32(pair));
                    }
                }
            }
        }
        gaps
    }
}
