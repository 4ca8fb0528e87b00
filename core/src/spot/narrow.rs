//! Finds a narrow spot on a background that changes slowly along the row.
//!
//! The first search measures light above one level for the whole row. Light that is wider than any spot hides
//! a narrow spot from that search, because the wide light has the higher response in large blocks. Here the
//! background is the light four blocks to the left and to the right of a place. The place counts by its
//! *contrast*: how much its response is above that of the brighter side. A slope, an edge or a flat part of
//! the background has no contrast. The top of wide light has little, and is less bent than a spot.

use crate::fault::Fault;
use crate::numeric;
use crate::spot::second_spot::{LEAST_OTHER, NEAR, check_near, has_similar_height, two_spots};
use crate::spot::sums::Sums;
use crate::spot::{Background, Spot, above, height, in_q8, middle, needed, noise, square};
use crate::units::Counts;

/// The smallest block has 2 pixels, for widths from 1 pixel. Blocks of one pixel would double the cost.
const SMALLEST_BLOCK_LOG2: u32 = 1;

/// The largest block has 2^4 = 16 pixels, for widths up to 20 pixels.
const LARGEST_BLOCK_LOG2: u32 = 4;

/// Blocks from a spot to the background beside it. A width is at most 4/3 of a block: the spot has 3 % of its
/// response left there.
const BESIDE: usize = 4;

/// The least contrast, in halves of a standard deviation of a response's noise. A spot that is bright enough
/// for a centre has about as much. The difference of two responses has 1.4 times that noise, so noise alone
/// has to reach seven standard deviations.
pub(super) const LEAST_CONTRAST: u16 = 20;

/// The least bend (see [`Place::bend`]), in the same unit. A spot's bend is 0.28 to 0.5 of its contrast. The
/// noise of a bend is 0.9 of a response's noise, so noise alone has to reach 5.6 standard deviations, and on
/// the top of wide light only.
const LEAST_BEND: u16 = 10;

/// Pixels to either side of a spot in which its noise is measured: bright light has more noise than the rest
/// of the row.
const NOISE_REACH: usize = 256;

/// Finds the spot with the most significant contrast. `row_noise` is the noise of a pixel of the row. `None`
/// if no spot has enough contrast. Returns [`Fault::TwoSpots`] if two spots have a similar contrast.
#[cold]
#[inline(never)]
pub(super) fn find(sums: &Sums<'_>, row_noise: Counts) -> Option<Result<Spot, Fault>> {
    let mut least = needed(LEAST_CONTRAST, row_noise);
    let mut best = None;
    for block_log2 in SMALLEST_BLOCK_LOG2..=LARGEST_BLOCK_LOG2 {
        if let Some(place) = Place::highest(sums, block_log2, least, row_noise) {
            least = significance(place.contrast, block_log2);
            best = Some(place);
        }
    }
    let best = best?;
    let centre = middle(best.block, best.block_log2);
    let to = centre.saturating_add(NOISE_REACH).min(sums.light.len());
    let near = sums.light.slice(centre.saturating_sub(NOISE_REACH)..to)?;
    let noise = noise(near)?.max(row_noise);
    if !best.stands_out(noise) {
        return None;
    }
    if let Some(other) = best.find_other(sums, noise) {
        return Some(Err(two_spots(centre, other)));
    }
    let (here, level) = (sums.response(best.block_log2, best.block)?, best.level);
    let spot = Spot {
        centre,
        block_log2: best.block_log2,
        height: height(above(here, best.block_log2, level), best.block_log2),
        background: Background { level, noise },
        black_level: level,
    };
    Some(check_near(sums, spot))
}

/// A place on the row that may be a spot's.
#[derive(Clone, Copy)]
struct Place {
    block_log2: u32,
    block: usize,
    /// In the unit of a response: at most 2^18 counts.
    contrast: u32,
    /// How much more the light has fallen halfway to the sides than a parabola, which has fallen by a quarter
    /// there. The top of wide light is a parabola. In the unit of a response.
    bend: u32,
    /// The level of the background: the mean of both sides.
    level: Counts,
}

impl Place {
    /// The place of a spot with the highest contrast in blocks of 2^`block_log2` pixels, if its significance
    /// is more than `least`.
    fn highest(sums: &Sums<'_>, block_log2: u32, least: u64, noise: Counts) -> Option<Self> {
        // Below 2^54, of which the root is taken. Without the 8 bits of Q8 it is below 2^20.
        let least = least
            .saturating_mul(1 << block_log2.min(LARGEST_BLOCK_LOG2))
            .isqrt();
        let least = (least >> Counts::FRACTION) as u32;
        let mut best: Option<Self> = None;
        for_each_candidate(sums, block_log2, least, |block, least| {
            if let Some(place) = Self::at(sums, block_log2, block)
                && place.contrast > least
                && place.stands_out(noise)
                && !sums.is_one_pixel(block_log2, block, place.level)
            {
                best = Some(place);
                return place.contrast;
            }
            least
        });
        best
    }

    /// `None` where the row ends before the sides.
    fn at(sums: &Sums<'_>, block_log2: u32, block: usize) -> Option<Self> {
        let here = sums.response(block_log2, block)?;
        let response = |block| Some(sums.response(block_log2, block)? as i32);
        let left = |blocks| response(block.checked_sub(blocks)?);
        let right = |blocks| response(block.checked_add(blocks)?);
        // Responses of blocks of at most 16 pixels of 12 bits: below 2^18, and times 2 * 4 below 2^21.
        let here = here as i32;
        let fallen = |sides: i32| numeric::sub_i32(numeric::mul_i32(2, here), sides);
        let (left_side, right_side) = (left(BESIDE)?, right(BESIDE)?);
        let sides = numeric::add_i32(left_side, right_side);
        let halfway = numeric::add_i32(left(BESIDE / 2)?, right(BESIDE / 2)?);
        let bend = numeric::sub_i32(numeric::mul_i32(4, fallen(halfway)), fallen(sides)) / 8;
        Some(Self {
            block_log2,
            block,
            contrast: here
                .saturating_sub(left_side.max(right_side))
                .max(0)
                .unsigned_abs(),
            bend: bend.max(0).unsigned_abs(),
            level: height(in_q8((sides / 2).unsigned_abs()), block_log2),
        })
    }

    /// Whether the contrast and the bend are more than that of noise.
    fn stands_out(&self, noise: Counts) -> bool {
        significance(self.contrast, self.block_log2) >= needed(LEAST_CONTRAST, noise)
            && significance(self.bend, self.block_log2) >= needed(LEAST_BEND, noise)
    }

    /// Finds another spot of similar contrast further away than [`NEAR`] blocks, and returns its pixel.
    fn find_other(&self, sums: &Sums<'_>, noise: Counts) -> Option<usize> {
        let least = needed(LEAST_OTHER, noise);
        let mut other = None;
        for_each_candidate(
            sums,
            self.block_log2,
            self.contrast / 2,
            |block, searched| {
                if block.abs_diff(self.block) > NEAR
                && let Some(place) = Self::at(sums, self.block_log2, block)
                && has_similar_height(place.contrast.into(), self.contrast.into())
                && significance(place.contrast, self.block_log2) >= least
                // A spot between two blocks has four fifths of the bend.
                && place.bend > self.bend / 2
                && !sums.is_one_pixel(self.block_log2, block, place.level)
                {
                    other = Some(middle(block, self.block_log2));
                    // The first one is enough.
                    return u32::MAX;
                }
                searched
            },
        );
        other
    }
}

/// As of a [`Candidate`](crate::spot::Candidate): response^2 / block size, in Q8 counts squared.
fn significance(response: u32, block_log2: u32) -> u64 {
    square(in_q8(response).unsigned_abs()) >> block_log2.min(LARGEST_BLOCK_LOG2)
}

/// Calls `see` with each block whose contrast may be more than `least`, and with `least`: its response is as
/// much above the mean of both sides. `see` returns the next `least`.
#[inline(always)]
fn for_each_candidate(
    sums: &Sums<'_>,
    block_log2: u32,
    mut least: u32,
    mut see: impl FnMut(usize, u32) -> u32,
) {
    let sums = sums.small_blocks(block_log2);
    // Contrasts to both sides are at most eight sums of 16 pixels of 12 bits: below 2^20.
    let twice = |least: u32| numeric::mul_i32(2, least.min(1 << 20) as i32);
    let mut both = twice(least);
    let (mut last, mut last_two) = (0, 0);
    // The kernel's middle is one block before its last. The first two sums are not those of a whole kernel:
    // `Place::at` has no place there.
    let middles = (BESIDE..).map(|last| last.wrapping_sub(1));
    for (block, sums) in middles.zip(sums.windows(2 * BESIDE + 1)) {
        let &[left, _, _, _, here, _, _, _, right] = sums else {
            break;
        };
        let (left, here, right) = (left.into(), u32::from(here), right.into());
        let sides = numeric::add_u32(left, right);
        let above = numeric::sub_i32(numeric::add_u32(here, here) as i32, sides as i32);
        let two = numeric::add_i32(last, above);
        let contrast = numeric::add_i32(last_two, two);
        (last, last_two) = (above, two);
        if contrast > both {
            least = see(block, least);
            both = twice(least);
        }
    }
}
