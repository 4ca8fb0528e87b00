//! The light near the spot of the row before, in blocks of its width.

use crate::base::numeric;
use crate::row::MAX_PIXELS;
use crate::spot::in_q8;

/// Groups from the spot's group to the two that show the background beside it. A group has 2/3 to 4/3 of the
/// width, so the nearest pixels of those two are 2.7 widths from the centre, where a gaussian has 3 % of its
/// height left.
const GROUPS_TO_BACKGROUND: usize = 5;

/// How far the peak is searched from the place of the row before, in groups. A spot that moved by its width
/// and a group is found: a width is at most 1.5 groups. A peak beyond that is found too, as far as it reaches
/// to there.
const SEARCH_REACH: usize = 5;

/// Blocks in groups of 2^`log2`.
pub(super) struct Groups<'a> {
    pub(super) blocks: &'a [u16],
    pub(super) log2: u32,
}

/// The highest response; of equal ones, the first.
pub(super) struct Peak {
    pub(super) group: usize,
    pub(super) response: u32,
}

impl Groups<'_> {
    fn blocks_in(&self, groups: usize) -> usize {
        groups.saturating_mul(1usize.wrapping_shl(self.log2))
    }

    /// The sum over a group. `None` off the row.
    fn sum(&self, group: usize) -> Option<u32> {
        let end = self.blocks_in(group.saturating_add(1));
        Some(sum_of_group(self.blocks.get(self.blocks_in(group)..end)?))
    }

    /// The peak near a group. `None` where the row is too short for a response.
    pub(super) fn peak_near(&self, group: usize) -> Option<Peak> {
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
    pub(super) fn beside(&self, group: usize) -> Option<i32> {
        let left = (group.checked_sub(GROUPS_TO_BACKGROUND)).and_then(|group| self.sum(group));
        let right = self.sum(group.saturating_add(GROUPS_TO_BACKGROUND));
        let both = numeric::add_u32(left.or(right)?, right.or(left)?);
        // Twice two groups of at most 128 pixels: as much as a response.
        Some(in_q8(numeric::add_u32(both, both)))
    }

    /// Whether any response further away than `reach` groups is `least` or more.
    pub(super) fn has_another(&self, group: usize, reach: usize, least: u32) -> bool {
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
