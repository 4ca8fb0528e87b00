//! Finds a narrow spot on a background that changes slowly along the row.
//!
//! The first search measures light above one level for the whole row. Light that is wider than any spot hides
//! a narrow spot from that search, because the wide light has the higher response in large blocks. Here the
//! background is the light four blocks to the left and to the right of a place. The place counts by its
//! *contrast*: how much its response is above that of the brighter side. A slope, an edge or a flat part of
//! the background has no contrast. The top of wide light has little, and is less bent than a spot.
//!
//! One pass takes the highest contrast of each part of the row. Then the search looks at the parts, the
//! highest first, until it has found a place of a spot with more contrast than the next part.

use dual_mac::{BESIDE, PLACES_OF_PART, REACH, SAMPLES_OF_PART};
use heapless::Vec;

use crate::base::{Counts, Fault, WorkBudget, numeric};
use crate::row::MAX_PIXELS;
use crate::spot::second_spot::{LEAST_OTHER, NEAR, check_near, has_similar_height, two_spots};
use crate::spot::sums::Sums;
use crate::spot::{Background, Spot, above, height, in_q8, middle, needed, noise, square};

/// The smallest block has 2 pixels, for widths from 1 pixel. Blocks of one pixel would double the cost.
const SMALLEST_BLOCK_LOG2: u32 = 1;
/// The largest block has 2^4 = 16 pixels, for widths up to 20 pixels.
const LARGEST_BLOCK_LOG2: u32 = 4;

// Blocks from a spot to the background beside it. A width is at most 4/3 of a block: the spot has 3 % of its
// response left there.
const _: () = assert!(BESIDE == 4);

/// The most parts of all sizes together.
const MOST_PARTS: usize = {
    let mut parts = 0;
    let mut log2 = SMALLEST_BLOCK_LOG2;
    while log2 <= LARGEST_BLOCK_LOG2 {
        parts += most_parts(log2);
        log2 += 1;
    }
    parts
};

const fn most_parts(block_log2: u32) -> usize {
    (MAX_PIXELS >> block_log2).div_ceil(PLACES_OF_PART)
}

/// The blocks of a place and those of its sides.
const BLOCKS: usize = 2 * REACH + 1;
/// The work of a search, without its looks at parts.
pub(super) const WORK: usize = 870;
/// What a search may take to look at parts, in units of about eight of the chip's instructions: 27,000 in
/// all. That is enough for narrow spots and speckle on wide light, and for four hot pixels that are brighter.
const LOOKS: u32 = 3400;
/// Units of [`LOOKS`] in one unit of work, which is 40 instructions.
const LOOKS_IN_A_UNIT: u32 = 5;
/// Looking at a part.
const LOOK: u32 = 75;
/// Measuring the contrast and the bend of a place. Testing whether it is one pixel costs as much again.
const PLACE: u32 = 14;
/// Parts of a group. The highest rank of each group is stored, so that two short searches find the highest
/// part.
const GROUP: usize = 12;
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
/// if no spot has enough contrast. Returns [`Fault::TwoSpots`] if two spots have a similar contrast, and
/// [`Fault::NoSpot`] if [`LOOKS`] is used up before the spot is found.
#[cold]
#[inline(never)]
pub(super) fn find(
    sums: &Sums<'_>,
    row_noise: Counts,
    budget: &mut WorkBudget,
) -> Option<Result<Spot, Fault>> {
    let looks = LOOKS.min(numeric::to_u32(budget.left()).saturating_mul(LOOKS_IN_A_UNIT));
    let mut parts = Parts::none(sums, looks);
    parts.measure(row_noise);
    let found = parts.best(row_noise);
    let used = looks.saturating_sub(parts.looks_left);
    budget.pay_at_most(used.div_ceil(LOOKS_IN_A_UNIT) as usize);
    let best = match found {
        Ok(best) => best?,
        Err(fault) => return Some(Err(fault)),
    };
    let centre = middle(best.block, best.block_log2);
    let to = centre.saturating_add(NOISE_REACH).min(sums.light.len());
    let near = sums.light.slice(centre.saturating_sub(NOISE_REACH)..to)?;
    let noise = noise(&[near])?.max(row_noise);
    if !best.stands_out(noise) {
        return None;
    }
    if let Some(other) = parts.find_other(&best, noise) {
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
    Some(check_near(sums, spot, budget))
}

/// The parts of the row whose contrast is more than that of noise.
struct Parts<'a> {
    sums: &'a Sums<'a>,
    /// In the order of the sizes, and from left to right.
    parts: Vec<Part, MOST_PARTS>,
    /// The [`rank_of`] the contrast of each part, or zero once the part is taken.
    ranks: Vec<u32, MOST_PARTS>,
    /// The highest rank of each [`GROUP`] of parts.
    highest: Vec<u32, { MOST_PARTS.div_ceil(GROUP) }>,
    looks_left: u32,
}

impl<'a> Parts<'a> {
    const fn none(sums: &'a Sums<'a>, looks_left: u32) -> Self {
        Self {
            sums,
            parts: Vec::new(),
            ranks: Vec::new(),
            highest: Vec::new(),
            looks_left,
        }
    }

    /// Measures the contrast of all parts. In place, because copies take time.
    #[inline(always)]
    fn measure(&mut self, noise: Counts) {
        // Another spot needs less than the one with the most contrast.
        let needed = needed(LEAST_OTHER, noise);
        for block_log2 in SMALLEST_BLOCK_LOG2..=LARGEST_BLOCK_LOG2 {
            let blocks = self.sums.small_blocks(block_log2);
            let mut highest = [0; most_parts(SMALLEST_BLOCK_LOG2)];
            dual_mac::contrasts(blocks, &mut highest);
            let least = contrast_of(needed, block_log2);
            let last = blocks.len().saturating_sub(SAMPLES_OF_PART);
            for (part, highest) in (0..MAX_PIXELS).zip(highest) {
                // A quarter, rounded down by at most 3/4. Below 2^18.
                let contrast = numeric::add_u32(4 * u32::from(highest), 3);
                if contrast > least {
                    // There is room for all.
                    let _ = self.parts.push(Part {
                        block_log2,
                        first: part.wrapping_mul(PLACES_OF_PART).min(last),
                        contrast,
                    });
                    let rank = rank_of(significance(contrast, block_log2));
                    let _ = self.ranks.push(rank);
                }
            }
        }
        for group in self.ranks.chunks(GROUP) {
            let _ = self.highest.push(highest_of(group).1);
        }
    }

    /// Takes the part with the highest rank, if that is `least` or more.
    fn take(&mut self, least: u32) -> Option<Part> {
        let (group, rank, _) = highest_of(&self.highest);
        if rank < least {
            return None;
        }
        let first = group.saturating_mul(GROUP);
        let (_, ranks) = self.ranks.split_at_mut_checked(first)?;
        let ranks = ranks.chunks_mut(GROUP).next()?;
        let (place, _, next) = highest_of(ranks);
        *ranks.get_mut(place)? = 0;
        *self.highest.get_mut(group)? = next;
        self.parts.get(first.saturating_add(place)).copied()
    }

    /// The place of a spot with the most significant contrast. Looks at the part with the highest contrast
    /// first, and so on, until no part left has more than the best place.
    fn best(&mut self, noise: Counts) -> Result<Option<Place>, Fault> {
        let mut best: Option<Place> = None;
        let mut least = needed(LEAST_CONTRAST, noise);
        while let Some(part) = self.take(rank_of(least)) {
            let is_spot = |place: &Place| place.stands_out(noise);
            let more = contrast_of(least, part.block_log2);
            let found = part.highest(self.sums, more, &mut self.looks_left, is_spot);
            if self.looks_left == 0 {
                let amplitude = height(in_q8(part.contrast), part.block_log2);
                return Err(Fault::NoSpot { amplitude });
            }
            if let Some(place) = found {
                least = significance(place.contrast, place.block_log2);
                best = found;
            }
        }
        Ok(best)
    }

    /// Finds another spot of similar contrast further away than [`NEAR`] blocks, and returns its pixel.
    fn find_other(&mut self, best: &Place, noise: Counts) -> Option<usize> {
        let least = needed(LEAST_OTHER, noise);
        let is_other = |place: &Place| {
            place.block.abs_diff(best.block) > NEAR
                && has_similar_height(place.contrast.into(), best.contrast.into())
                && significance(place.contrast, place.block_log2) >= least
                // A spot between two blocks has four fifths of the bend.
                && place.bend > best.bend / 2
        };
        let block_log2 = best.block_log2;
        let parts = self.parts.iter();
        let similar = parts.filter(|part| {
            part.block_log2 == block_log2
                && has_similar_height(part.contrast.into(), best.contrast.into())
        });
        for part in similar {
            let other = part.highest(self.sums, best.contrast / 2, &mut self.looks_left, is_other);
            if let Some(other) = other {
                return Some(middle(other.block, block_log2));
            }
            if self.looks_left == 0 {
                return Some(middle(part.first, block_log2));
            }
        }
        None
    }
}

/// Blocks side by side.
#[derive(Clone, Copy)]
struct Part {
    block_log2: u32,
    /// The first of the [`SAMPLES_OF_PART`] blocks that it takes.
    first: usize,
    /// At least the highest contrast of its places.
    contrast: u32,
}

impl Part {
    /// The place with the highest contrast that is more than `least`, if it is a spot's and no single pixel.
    /// `None` too where that takes more than what is left of [`LOOKS`], which is then zero.
    fn highest(
        &self,
        sums: &Sums<'_>,
        mut least: u32,
        looks_left: &mut u32,
        is_spot: impl Fn(&Place) -> bool,
    ) -> Option<Place> {
        *looks_left = looks_left.saturating_sub(LOOK);
        let blocks = sums.small_blocks(self.block_log2).get(self.first..)?;
        let few;
        let part = match blocks.first_chunk() {
            Some(part) => part,
            None => {
                few = short_part(blocks);
                &few
            }
        };
        let places = blocks.len().saturating_sub(2 * REACH).min(PLACES_OF_PART);
        let mut highest = None;
        // How much twice a block is above those beside it. Together as with the kernel, that is the contrast
        // to the mean of both sides, which is not less than that to the brighter one. Eight sums of 16 pixels
        // of 12 bits: below 2^20, and so is twice a contrast.
        let above = |first: usize| {
            let [left, here, right] = [0, BESIDE, 2 * BESIDE].map(|i| i32::from(part[first + i]));
            numeric::sub_i32(2 * here, numeric::add_i32(left, right))
        };
        let (mut before, mut last) = (above(0), above(1));
        for first in 0..places {
            let next = above(first + 2);
            let both = numeric::add_i32(numeric::add_i32(before, next), numeric::mul_i32(2, last));
            (before, last) = (last, next);
            if both <= numeric::mul_i32(2, least.min(1 << 20) as i32) {
                continue;
            }
            if *looks_left == 0 {
                return None;
            }
            *looks_left = looks_left.saturating_sub(PLACE);
            let Some(place) = self.place(part, first, least) else {
                continue;
            };
            if !is_spot(&place) {
                continue;
            }
            *looks_left = looks_left.saturating_sub(PLACE);
            if !sums.is_one_pixel(place.block_log2, place.block, place.level) {
                least = place.contrast;
                highest = Some(place);
            }
        }
        highest
    }

    /// A place of the part, of which `first` is the first block. `None` where its contrast is not more than
    /// `least`.
    #[inline(never)]
    fn place(&self, part: &[u16; SAMPLES_OF_PART], first: usize, least: u32) -> Option<Place> {
        let blocks: &[u16; BLOCKS] = part.get(first..)?.first_chunk()?;
        // Blocks of at most 16 pixels of 12 bits: responses are below 2^18, and times 2 * 4 below 2^21.
        let response = |first: usize| {
            let [left, middle, right] = [0, 1, 2].map(|i| i32::from(blocks[first + i]));
            numeric::add_i32(numeric::add_i32(left, right), 2 * middle)
        };
        let here = response(BESIDE);
        let (left_side, right_side) = (response(0), response(2 * BESIDE));
        let contrast = numeric::sub_i32(here, left_side.max(right_side));
        let contrast = contrast.max(0).unsigned_abs();
        if contrast <= least {
            return None;
        }
        let fallen = |sides: i32| numeric::sub_i32(numeric::mul_i32(2, here), sides);
        let sides = numeric::add_i32(left_side, right_side);
        let halfway = numeric::add_i32(response(BESIDE / 2), response(BESIDE + BESIDE / 2));
        let bend = numeric::sub_i32(numeric::mul_i32(4, fallen(halfway)), fallen(sides)) / 8;
        Some(Place {
            block_log2: self.block_log2,
            block: self.first.saturating_add(first).saturating_add(REACH),
            contrast,
            bend: bend.max(0).unsigned_abs(),
            level: height(in_q8((sides / 2).unsigned_abs()), self.block_log2),
        })
    }
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
    /// Whether the contrast and the bend are more than that of noise.
    fn stands_out(&self, noise: Counts) -> bool {
        significance(self.contrast, self.block_log2) >= needed(LEAST_CONTRAST, noise)
            && significance(self.bend, self.block_log2) >= needed(LEAST_BEND, noise)
    }
}

/// As of a [`Candidate`](crate::spot::Candidate): response^2 / block size, in Q8 counts squared.
fn significance(response: u32, block_log2: u32) -> u64 {
    square(in_q8(response).unsigned_abs()) >> block_log2.min(LARGEST_BLOCK_LOG2)
}

/// The largest whole contrast whose significance is not more than this.
fn contrast_of(significance: u64, block_log2: u32) -> u32 {
    let square = significance.saturating_mul(1 << block_log2.min(LARGEST_BLOCK_LOG2));
    rank_of(square).isqrt()
}

/// A significance without its fraction. Contrasts are below 2^18, so theirs is below 2^32 in blocks of 16.
fn rank_of(significance: u64) -> u32 {
    u32::try_from(significance >> (2 * Counts::FRACTION)).unwrap_or(u32::MAX)
}

/// The place of the highest rank, that rank, and the next lower one; zeros where there is none.
fn highest_of(ranks: &[u32]) -> (usize, u32, u32) {
    let (mut place, mut highest, mut next) = (0, 0, 0);
    for (i, &rank) in (0..MOST_PARTS).zip(ranks) {
        if rank > highest {
            (place, highest, next) = (i, rank, highest);
        } else if rank > next {
            next = rank;
        }
    }
    (place, highest, next)
}

/// A short row has fewer blocks than a part. Those behind them belong to no place.
#[cold]
#[inline(never)]
fn short_part(blocks: &[u16]) -> [u16; SAMPLES_OF_PART] {
    let mut part = [0; SAMPLES_OF_PART];
    for (part, &block) in part.iter_mut().zip(blocks) {
        *part = block;
    }
    part
}
