//! Finds the spot again in the next row, whose place and width the row before tells.
//!
//! The peak of the kernel's responses is searched near the place of the row before. Then the sweep over the
//! rest of the row only tests whether any response there is similar to the peak.

use crate::base::{Counts, Fault, Pixels, WorkBudget, numeric};
use crate::row::{BLOCK_LOG2, Blocks, MAX_PIXELS, Row};
use crate::spot::{
    Coarse, DETECTION, LARGEST_BLOCK_LOG2, MIN_PIXELS, Spot, find_in, height, in_q8, middle,
    needed, square, under_the_kernel,
};

/// Finds the spot again in the next row, with a tenth of the work of [`find`](crate::spot::find). Uses blocks
/// of 8 pixels or more that fit the width of the spot before, and the background and the noise of the row
/// before. Calls `find` instead if the spot is narrower than 4 pixels, has moved by more than its width and a
/// block, or is on another background: a sudden change of light changes the noise too, and noise might then
/// pass for a spot above the old background.
///
/// # Errors
/// As [`find`](crate::spot::find).
pub fn find_again(
    row: &Row<'_>,
    before: &Spot,
    width: Pixels,
) -> Result<(Spot, WorkBudget), Fault> {
    let blocks = Blocks::of(row.light());
    let mut budget = WorkBudget::of_row();
    let coarse = &mut Coarse::new();
    let spot = find_again_in(row, blocks.sums(), coarse, before, width, &mut budget)?;
    Ok((spot, budget))
}

/// As [`find_again`], with the row's blocks, and room for what [`find`](crate::spot::find) makes of them.
pub(crate) fn find_again_in(
    row: &Row<'_>,
    blocks: &[u16],
    coarse: &mut Coarse,
    before: &Spot,
    width: Pixels,
    budget: &mut WorkBudget,
) -> Result<Spot, Fault> {
    if width < NARROWEST || row.light().len() < MIN_PIXELS {
        return find_in(row, blocks, coarse, budget);
    }
    let reach = spot_reach(width);
    // The kernel fits a width of 0.9 of its block best, and widths of 0.75 or 1.5 nearly as well.
    let block_log2 = (BLOCK_LOG2..=LARGEST_BLOCK_LOG2)
        .take_while(|&log2| width >= Pixels::from_int((3 << log2) / 4))
        .last()
        .unwrap_or(BLOCK_LOG2);
    let log2 = block_log2 - BLOCK_LOG2;
    let groups = Groups { blocks, log2 };
    let level = Counts::from_bits(before.background.level_bits());
    let background = under_the_kernel(level, block_log2);
    let above = |response: u32| in_q8(response).saturating_sub(background).max(0);
    let block = 1usize << block_log2;
    // Not negative: the width is at least half of the block that was chosen for it.
    let width = (width.to_bits() >> Pixels::FRACTION).cast_unsigned() as usize;
    let Some(peak) = groups.peak_near(before.centre >> block_log2) else {
        return find_in(row, blocks, coarse, budget);
    };
    let response = above(peak.response);
    let significance = square(response.unsigned_abs()) >> block_log2;
    let centre = middle(peak.group, block_log2);
    // Another spot has two thirds of the peak's response or more: see `second_spot::has_similar_height`.
    // Both terms are below 2^29.
    let least_similar =
        (numeric::add_i32(background, response / 3 * 2).max(0) >> Counts::FRACTION).unsigned_abs();
    // [`find`](crate::spot::find) tells whether a weak response is only noise, because the spot is gone, and
    // whether the sensor is silent, because no pixel changes.
    if significance < needed(DETECTION, before.background.noise)
        || centre.abs_diff(before.centre) > width + block
        || has_background_changed(background, response, groups.beside(peak.group))
        || groups.has_another(peak.group, reach, least_similar)
    {
        return find_in(row, blocks, coarse, budget);
    }
    Ok(Spot {
        centre,
        block_log2,
        height: height(response, block_log2),
        background: before.background,
        black_level: before.background.level,
    })
}

/// A narrower spot is found by [`find`](crate::spot::find), in blocks of fewer pixels. With blocks of 8
/// pixels, a spot of this width stands out two thirds as much as with blocks of 4. If it then stands out too
/// little, `find` is called all the same.
const NARROWEST: Pixels = Pixels::from_int(4);

/// Whether the background beside the spot has changed by more than a quarter of the spot's response. All
/// three arguments are responses of the kernel, in Q24.8 counts. A smaller change moves no centre of a phase
/// table, and a quarter of a response does not pass for a whole one. The centroid, which subtracts the level,
/// then subtracts a level that is off by that change.
fn has_background_changed(background: i32, response: i32, beside: Option<i32>) -> bool {
    beside.is_none_or(|beside| beside.abs_diff(background) > response.unsigned_abs() / 4)
}

/// Groups from the spot's group to the two that show the background beside it. A group has 2/3 to 4/3 of the
/// width, so the nearest pixels of those two are 2.7 widths from the centre, where a gaussian has 3 % of its
/// height left.
const GROUPS_TO_BACKGROUND: usize = 5;

/// How far a spot reaches, in groups: a response at this distance or nearer belongs to the spot. A spot's
/// width is at most 1.5 groups: at two groups it has a third of its response left. A spot of less than 0.75
/// groups has at most 0.44 of its response left at two groups, if it lies between two groups. Light there is
/// another spot, which may be as near as five widths.
fn spot_reach(width: Pixels) -> usize {
    if width < Pixels::from_int(6) { 1 } else { 2 }
}

/// How far the peak is searched from the place of the row before, in groups. A spot that moved by its width
/// and a group is found: a width is at most 1.5 groups. A peak beyond that is found too, as far as it reaches
/// to there.
const SEARCH_REACH: usize = 5;

/// Blocks in groups of 2^`log2`.
struct Groups<'a> {
    blocks: &'a [u16],
    log2: u32,
}

/// The highest response; of equal ones, the first.
struct Peak {
    group: usize,
    response: u32,
}

impl Groups<'_> {
    /// The blocks in so many groups.
    fn blocks_in(&self, groups: usize) -> usize {
        groups.saturating_mul(1usize.wrapping_shl(self.log2))
    }

    /// The sum over a group. `None` off the row.
    fn sum(&self, group: usize) -> Option<u32> {
        let end = self.blocks_in(group.saturating_add(1));
        Some(sum_of_group(self.blocks.get(self.blocks_in(group)..end)?))
    }

    /// The peak near a group. `None` where the row is too short for a response.
    fn peak_near(&self, group: usize) -> Option<Peak> {
        let first = group.saturating_sub(SEARCH_REACH);
        // With the group before the first response, and the one behind the last.
        let start = first.saturating_sub(1);
        let number = group.saturating_add(SEARCH_REACH + 2).saturating_sub(start);
        let near = self.blocks.get(self.blocks_in(start)..)?;
        let near = near.get(..self.blocks_in(number)).unwrap_or(near);
        match self.log2 {
            0 => peak(start, first, near.iter().map(|&sum| sum.into())),
            log2 => {
                let groups = near.chunks_exact(1usize.wrapping_shl(log2).max(1));
                peak(start, first, groups.map(sum_of_group))
            }
        }
    }

    /// The background to the left and right of a group, as a response of the kernel [1 2 1], in Q24.8 counts.
    /// Where the row has one side only, that side counts twice. `None` where the row has neither.
    fn beside(&self, group: usize) -> Option<i32> {
        let left = (group.checked_sub(GROUPS_TO_BACKGROUND)).and_then(|group| self.sum(group));
        let right = self.sum(group.saturating_add(GROUPS_TO_BACKGROUND));
        let both = numeric::add_u32(left.or(right)?, right.or(left)?);
        // Twice two groups of at most 128 pixels: as much as a response.
        Some(in_q8(numeric::add_u32(both, both)))
    }

    /// Whether any response further away than `reach` groups is `least` or more.
    fn has_another(&self, group: usize, reach: usize, least: u32) -> bool {
        // The kernel's middle is further away than that. Its last group on the left, and its first on the
        // right, are one nearer.
        let left = self.blocks_in(group.saturating_sub(reach.saturating_sub(1)));
        let right = self.blocks_in(group.saturating_add(reach));
        let left = self.blocks.get(..left).unwrap_or_default();
        let right = self.blocks.get(right..).unwrap_or_default();
        // A spot that the row's start cuts responds without a first group.
        self.response_at_start()
            .is_some_and(|response| group > reach && response >= least)
            || reaches(left, self.log2, least)
            || reaches(right, self.log2, least)
    }

    /// The kernel's response with its middle on the first group, and nothing before it.
    fn response_at_start(&self) -> Option<u32> {
        let (first, second) = (self.sum(0)?, self.sum(1)?);
        Some(numeric::add_u32(numeric::add_u32(first, first), second))
    }
}

/// The highest response with its middle on the group `first` or behind it. The sums start with group `start`,
/// and before that there is nothing.
#[inline(always)]
fn peak(start: usize, first: usize, sums: impl Iterator<Item = u32>) -> Option<Peak> {
    let mut kernel = Kernel::default();
    let mut peak: Option<Peak> = None;
    for (last, sum) in (start..usize::MAX).zip(sums) {
        let response = kernel.take(sum);
        if last > first && peak.as_ref().is_none_or(|peak| response > peak.response) {
            let group = last.wrapping_sub(1);
            peak = Some(Peak { group, response });
        }
    }
    peak
}

/// Whether any response of the kernel on groups of 2^`log2` blocks is `least` or more.
fn reaches(blocks: &[u16], log2: u32, least: u32) -> bool {
    // Both are below 2^21.
    let least = least as i32;
    if log2 == 0 {
        return dual_mac::reaches(blocks, least);
    }
    let groups = blocks.chunks_exact(1usize.wrapping_shl(log2).max(1));
    let mut kernel = Kernel::default();
    let signs = (0..MAX_PIXELS)
        .zip(groups)
        .fold(0, |signs, (group, blocks)| {
            let response = kernel.take(sum_of_group(blocks)) as i32;
            // Negative for a response that is `least` or more. The first two groups only start the kernel.
            let sign = numeric::sub_i32(least, response).saturating_sub(1);
            if group < 2 { signs } else { signs | sign }
        });
    signs < 0
}

/// The kernel [1 2 1], which takes one sum after the other.
#[derive(Default)]
struct Kernel {
    last: u32,
    last_two: u32,
}

impl Kernel {
    /// Takes a sum, and returns the response of the kernel that ends with it.
    #[inline(always)]
    fn take(&mut self, sum: u32) -> u32 {
        // Sums of at most 128 pixels of 12 bits: four of them are below 2^21.
        let two = numeric::add_u32(self.last, sum);
        let response = numeric::add_u32(self.last_two, two);
        (self.last, self.last_two) = (sum, two);
        response
    }
}

/// The sum over blocks of at most 128 pixels together.
#[inline(always)]
fn sum_of_group(blocks: &[u16]) -> u32 {
    (blocks.iter()).fold(0, |all, &sum| numeric::add_u32(all, sum.into()))
}
