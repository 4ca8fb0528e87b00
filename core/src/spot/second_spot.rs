//! Tells whether the search found one spot or two.
//!
//! The search takes the block in which most light stands out. Two spots within about nine widths of each
//! other may both lie in that block, so the light near it is divided into finer blocks. Two lumps of light
//! are two spots if each is compact, they are far apart for their width, a valley separates them, and there
//! is little other light beside them. If they are about as high, nothing tells which is the laser's: that is
//! a fault. Otherwise the higher one is the spot. Speckle breaks a spot into lumps too, but these are closer,
//! or more than two.
//!
//! Further away the kernel's responses decide: a response nearly as high as the spot's is another spot.

use crate::base::{Counts, Fault, Pixels, WorkBudget, numeric};
use crate::spot::sums::Sums;
use crate::spot::{
    LARGEST_BLOCK_LOG2, Spot, above, height, in_q8, middle, needed, square, under_the_kernel,
};

/// Whether two spots are so alike in height that nothing tells which is the laser's. A second spot of 50 % of
/// the first one's height must not count as alike, one of 80 % must. Blocks measure heights to a tenth, so
/// the limit is two thirds.
pub(super) const fn has_similar_height(height: i64, highest: i64) -> bool {
    3 * height > 2 * highest
}

/// Whether a second lump is high enough to matter. A lower one moves the search's result by half a width at
/// most.
const fn is_high_enough(height: i32, highest: i32) -> bool {
    height > highest / 4
}

/// The least response of another spot, in halves of a standard deviation of its noise. Noise alone reaches
/// 5.5 standard deviations in one row of 10,000 (8000 places). A spot that is bright enough for a centre has
/// ten.
pub(super) const LEAST_OTHER: u16 = 11;
/// Blocks to either side of the spot that are divided into finer ones. [`find_far_spot`] tests the rest.
pub(super) const NEAR: usize = 4;
/// A fine block is an eighth of the spot's block. Blocks of a quarter would do for the narrowest two spots
/// that the search takes for one.
const FINE_LOG2: u32 = 3;
const FINE: usize = (2 * NEAR) << FINE_LOG2;
/// The work of dividing the light into smaller blocks once more. The first pass belongs to the plain
/// search, and a pass that finds no two spots is not paid.
const WORK_OF_SMALLER_BLOCKS: usize = 220;

/// Returns the spot, or the higher one of two. `None` where the sums do not hold the sizes that the higher
/// one needs.
///
/// # Errors
/// [`Fault::TwoSpots`] if the other spot is about as high.
pub(super) fn check(
    sums: &Sums<'_>,
    found: Spot,
    budget: &mut WorkBudget,
) -> Option<Result<Spot, Fault>> {
    let spot = match check_near(sums, found, budget) {
        Ok(spot) => spot,
        Err(fault) => return Some(Err(fault)),
    };
    if spot.block_log2 < sums.smallest_log2() {
        return None;
    }
    Some(match find_far_spot(sums, &spot) {
        Some(other) => Err(two_spots(spot.centre, other)),
        None => Ok(spot),
    })
}

/// As [`check`], for the light within [`NEAR`] blocks only.
pub(super) fn check_near(
    sums: &Sums<'_>,
    found: Spot,
    budget: &mut WorkBudget,
) -> Result<Spot, Fault> {
    let mut spot = found;
    let mut near = Near::NOTHING;
    // Each pass takes smaller blocks than the one before.
    while let Some((higher, lower)) = near.look(sums, &spot).and_then(Near::find_two_spots) {
        if has_similar_height(lower.height.into(), higher.height.into()) {
            return Err(two_spots(higher.middle, lower.middle));
        }
        let Some(finer) = higher.spot(sums, &spot) else {
            break;
        };
        spot = finer;
        budget.pay_at_most(WORK_OF_SMALLER_BLOCKS);
    }
    Ok(spot)
}

pub(super) fn two_spots(centre: usize, other: usize) -> Fault {
    Fault::TwoSpots {
        centre: Pixels::from_int(numeric::to_i32(centre)),
        other: Pixels::from_int(numeric::to_i32(other)),
    }
}

/// The light near a spot above the background, in fine blocks. Q24.8 counts, of 16 pixels below 2^24.
struct Near {
    light: [i32; FINE],
    /// The median of three neighbouring blocks, which removes hot and dead pixels.
    smooth: [i32; FINE],
    length: usize,
    /// The first block's number on the row.
    first: usize,
    block_log2: u32,
    /// Standard deviation of a block.
    noise: i32,
}

/// A part of the light that has one top.
struct Lump {
    /// The highest block. `from..to` are the blocks about it with more than half of its light.
    top: usize,
    from: usize,
    to: usize,
    /// The most light in three neighbouring blocks of the lump.
    height: i32,
    /// The pixel to the right of the middle.
    middle: usize,
    /// Pixels with more than half of the highest block's light.
    full_width: usize,
}

impl Near {
    const NOTHING: Self = Self {
        light: [0; FINE],
        smooth: [0; FINE],
        length: 0,
        first: 0,
        block_log2: 0,
        noise: 0,
    };

    /// Takes the light near a spot. In place, because copies take time. `None` where the row has no block
    /// near the spot.
    fn look(&mut self, sums: &Sums<'_>, spot: &Spot) -> Option<&Self> {
        let largest = spot.block_log2.min(LARGEST_BLOCK_LOG2);
        let block_log2 = largest.saturating_sub(FINE_LOG2);
        let finer = spot.block_log2.saturating_sub(block_log2).min(FINE_LOG2);
        let reach = NEAR * (1 << finer);
        self.first = block_of(spot.centre, block_log2).saturating_sub(reach);
        self.block_log2 = block_log2;
        // Below 2^20 in Q8, and times 4 at most.
        self.noise = numeric::whole_i32(
            spot.background.noise.to_f32()
                * dual_mac::square_root((1u32 << (2 * Counts::FRACTION + block_log2)) as f32),
        );
        // Each end is its own neighbour.
        let mut with_ends = [0; FINE + 2];
        let (start, blocks) = with_ends.split_first_mut()?;
        self.length = sums.blocks_from(block_log2, self.first, blocks.get_mut(..2 * reach)?);
        let (blocks, end) = blocks.split_at_mut_checked(self.length)?;
        (*start, *end.first_mut()?) = (*blocks.first()?, *blocks.last()?);
        let level = numeric::mul_i32(spot.background.level_bits(), 1 << block_log2);
        // Both are at most 16 pixels of 12 bits in Q8: below 2^24.
        let above = |sum: u32| numeric::sub_i32(in_q8(sum), level);
        let threes = with_ends.array_windows::<3>().take(self.length);
        for ((light, smooth), &[left, here, right]) in
            self.light.iter_mut().zip(&mut self.smooth).zip(threes)
        {
            *light = above(here);
            *smooth = above(left.min(right).max(here.min(left.max(right))));
        }
        Some(self)
    }

    /// Finds two spots, and returns the higher one first. `None` for one spot, or for more than two.
    fn find_two_spots(&self) -> Option<(Lump, Lump)> {
        let smooth = self.smooth.get(..self.length)?;
        let highest = *smooth.iter().max()?;
        let top = smooth.iter().position(|&light| light == highest)?;
        let (left, right) = smooth.split_at_checked(top)?;
        let to_the_right = self.find_beyond_valley(right.iter(), highest);
        let to_the_left = self.find_beyond_valley(left.iter().rev(), highest);
        let other = match (to_the_left, to_the_right) {
            (Some((left, height)), Some((_, other))) if height > other => {
                top.saturating_sub(1).saturating_sub(left)
            }
            (_, Some((right, _))) => top.saturating_add(right),
            (Some((left, _)), None) => top.saturating_sub(1).saturating_sub(left),
            (None, None) => return None,
        };
        let (here, other) = (self.lump(top)?, self.lump(other)?);
        if !self.are_apart(&here, &other) || !self.has_little_other_light(&here, &other) {
            return None;
        }
        Some(if other.height > here.height {
            (other, here)
        } else {
            (here, other)
        })
    }

    /// Finds the highest block beyond a valley, going outwards from the top. Returns its place on that way
    /// and its light.
    fn find_beyond_valley<'a>(
        &self,
        outwards: impl Iterator<Item = &'a i32>,
        highest: i32,
    ) -> Option<(usize, i32)> {
        let (mut valley, mut second) = (highest, None);
        for (i, &light) in (0..FINE).zip(outwards) {
            valley = valley.min(light);
            // Most blocks are dark.
            if !is_high_enough(light, highest) {
                continue;
            }
            if valley <= light / 2
                && light.saturating_sub(valley) > self.noise.saturating_mul(5)
                && second.is_none_or(|(_, height)| light > height)
            {
                second = Some((i, light));
            }
        }
        second
    }

    fn lump(&self, top: usize) -> Option<Lump> {
        let (left, right) = self.smooth.get(..self.length)?.split_at_checked(top)?;
        let half = right.first()? / 2;
        let is_below = |light: &i32| *light <= half;
        let below = left.iter().rposition(is_below);
        let from = below.map_or(0, |below| below.saturating_add(1));
        let below = right.iter().position(is_below);
        let to = below.map_or(self.length, |below| top.saturating_add(below));
        let about = from.saturating_sub(1)..to.saturating_add(1).min(self.length);
        let threes = self.light.get(about)?.windows(3);
        let sum =
            |three: &[i32]| (three.iter()).fold(0i32, |sum, &light| sum.saturating_add(light));
        let height = threes.map(sum).max()?;
        let twice_first = self.first.saturating_mul(2);
        let twice_middle = twice_first.saturating_add(from).saturating_add(to);
        Some(Lump {
            top,
            from,
            to,
            height,
            middle: pixels(twice_middle, self.block_log2) / 2,
            full_width: pixels(to.saturating_sub(from), self.block_log2),
        })
    }

    /// Whether the two tops are at least three and a half widths apart: one and a half times the full width
    /// at half maximum, which is known to two blocks.
    fn are_apart(&self, one: &Lump, other: &Lump) -> bool {
        let wider = one.blocks().max(other.blocks());
        one.top.abs_diff(other.top).saturating_add(2) >= wider.saturating_mul(3).div_ceil(2)
    }

    /// Whether there is little light besides the two lumps. Each reaches three and a half widths from its
    /// middle.
    fn has_little_other_light(&self, one: &Lump, other: &Lump) -> bool {
        let is_of = |i: usize, lump: &Lump| {
            let reach = lump.blocks();
            (lump.from.saturating_sub(reach)..lump.to.saturating_add(reach)).contains(&i)
        };
        let (mut all, mut beside) = (0i64, 0i64);
        // At most 64 terms of 32 bits.
        for (i, &light) in (0..self.length).zip(&self.light) {
            all = numeric::add_i64(all, i64::from(light));
            if !is_of(i, one) && !is_of(i, other) {
                beside = numeric::add_i64(beside, i64::from(light));
            }
        }
        numeric::mul_i64(8, beside) <= all
    }
}

impl Lump {
    /// Blocks above half of the height.
    fn blocks(&self) -> usize {
        self.to.saturating_sub(self.from)
    }

    /// Makes a spot of the lump. `None` if its blocks are not smaller than those of `found`.
    fn spot(&self, sums: &Sums<'_>, found: &Spot) -> Option<Spot> {
        // The full width is 2.35 widths, and blocks are at most four thirds of one.
        let block_log2 = (0..found.block_log2)
            .take_while(|&log2| pixels(4, log2) <= self.full_width.saturating_mul(7) / 3)
            .last()?;
        let response = sums.response(block_log2, block_of(self.middle, block_log2))?;
        let response = above(response, block_log2, found.background.level);
        Some(Spot {
            centre: self.middle,
            block_log2,
            height: height(response, block_log2),
            ..*found
        })
    }
}

fn pixels(blocks: usize, block_log2: u32) -> usize {
    blocks.saturating_mul(1 << block_log2.min(LARGEST_BLOCK_LOG2))
}

fn block_of(pixel: usize, block_log2: u32) -> usize {
    pixel >> block_log2.min(LARGEST_BLOCK_LOG2)
}

/// The most places, as high as the spot, that are tested for being one pixel.
const MOST_TESTED: u32 = 16;

/// Finds another spot further away than [`NEAR`] blocks, and returns its pixel. It may be a single pixel if
/// there are more than [`MOST_TESTED`] of these.
fn find_far_spot(sums: &Sums<'_>, spot: &Spot) -> Option<usize> {
    let block_log2 = spot.block_log2.min(LARGEST_BLOCK_LOG2);
    let level = spot.background.level;
    let here = block_of(spot.centre, block_log2);
    let response = |block| Some(above(sums.response(block_log2, block)?, block_log2, level));
    // The spot's middle may lie in the next block.
    let near = here.saturating_sub(1)..here.saturating_add(2);
    let highest = near.filter_map(response).max()?;
    // Responses above the background are below 2^30. What is at most so many whole counts, background
    // included.
    let with_background = |above: i32| {
        let all = above.saturating_add(under_the_kernel(level, block_log2));
        (all >> Counts::FRACTION).max(0).unsigned_abs()
    };
    // A similar height is more than two thirds of the highest. The significance is what noise does not reach.
    let needed = needed(LEAST_OTHER, spot.background.noise);
    let root = (needed.saturating_mul(1 << block_log2.min(LARGEST_BLOCK_LOG2))).isqrt();
    let similar = (highest / 3 * 2).max(i32::try_from(root).unwrap_or(i32::MAX));
    let least = with_background(similar).saturating_sub(1);
    let is_other = |response: i32| {
        has_similar_height(response.into(), highest.into())
            && square(response.max(0).unsigned_abs()) >> block_log2.min(LARGEST_BLOCK_LOG2)
                >= needed
    };
    // A valley must lie between the two: the other spot is beyond the nearest dark block on its side.
    let (dark_on_left, dark_on_right) =
        sums.nearest_low(block_log2, here, with_background(highest / 3));
    let left = dark_on_left.map_or(0, |dark| {
        dark.saturating_add(1).min(here.saturating_sub(NEAR))
    });
    let right = dark_on_right.map_or(usize::MAX, |dark| dark.max(here.saturating_add(NEAR)));
    let (mut other, mut tested) = (None, 0);
    let see = &mut |block: usize, response: u32| {
        if !is_other(above(response, block_log2, level)) {
            return true;
        }
        tested = numeric::add_u32(tested, 1);
        let is_there = tested > MOST_TESTED || !sums.is_one_pixel(block_log2, block, level);
        if is_there {
            other = Some(middle(block, block_log2));
        }
        !is_there
    };
    for (highest, blocks) in sums.parts(block_log2) {
        let before = blocks.start..blocks.end.min(left);
        let behind = blocks.start.max(right.saturating_add(1))..blocks.end;
        if highest > least
            && !(sums.all_above(block_log2, before, least, see)
                && sums.all_above(block_log2, behind, least, see))
        {
            break;
        }
    }
    other
}
