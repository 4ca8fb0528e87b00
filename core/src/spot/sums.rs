//! The sums over blocks of a row's pixels, and the highest responses of the kernel [1 2 1].
//!
//! A sweep keeps only the highest response of each part of the row, which halves its cost.
//! [`Sums::highest`] then searches the best part for the place.
//!
//! [`Coarse`] holds all sizes from 8 pixels up, which follow from the row's blocks of 8. [`Fine`] holds the
//! sizes below, which take four times as long: the search computes them only where they matter.

use core::ops::Range;

use dual_mac::portable::sweep_of;
use dual_mac::{PART, sweep, sweep_wide};
use heapless::Vec;

use crate::base::{Counts, numeric};
use crate::row::{BLOCK_LOG2, LARGEST_COUNT, Light, MAX_PIXELS};
use crate::spot::tilt::Tilt;
use crate::spot::{LARGEST_BLOCK_LOG2, MEDIAN_BLOCKS, in_q8, median};

const fn most_parts(block_log2: u32) -> usize {
    (MAX_PIXELS >> (block_log2 + 1)).div_ceil(PART)
}

/// The sizes from 8 pixels up.
const COARSE_SIZES: usize = (LARGEST_BLOCK_LOG2 - BLOCK_LOG2) as usize + 1;

/// What blocks of 8, 16, 32, 64 and 128 pixels have. Those of 8 pixels come with the row.
#[derive(Clone, Debug)]
pub(crate) struct Coarse {
    sums_16: [u16; MAX_PIXELS >> 4],
    sums_32: [u32; MAX_PIXELS >> 5],
    sums_64: [u32; MAX_PIXELS >> 6],
    sums_128: [u32; MAX_PIXELS >> 7],
    /// The highest response in each part.
    parts: [[u32; most_parts(BLOCK_LOG2)]; COARSE_SIZES],
}

impl Coarse {
    pub(crate) const fn new() -> Self {
        Self {
            sums_16: [0; MAX_PIXELS >> 4],
            sums_32: [0; MAX_PIXELS >> 5],
            sums_64: [0; MAX_PIXELS >> 6],
            sums_128: [0; MAX_PIXELS >> 7],
            parts: [[0; most_parts(BLOCK_LOG2)]; COARSE_SIZES],
        }
    }

    /// Sums a row's blocks. In place, because copies of the sums take time.
    #[inline(never)]
    pub(super) fn sum(&mut self, blocks: &[u16]) {
        let [parts_8, parts_16, parts_32, parts_64, parts_128] = &mut self.parts;
        sweep_wide(blocks, &mut self.sums_16, parts_8);
        let mut pairs = blocks.len() / 2;
        let small = first(&self.sums_16, pairs);
        sweep_large(small, &mut self.sums_32, parts_16);
        pairs /= 2;
        sweep_large(first(&self.sums_32, pairs), &mut self.sums_64, parts_32);
        pairs /= 2;
        sweep_large(first(&self.sums_64, pairs), &mut self.sums_128, parts_64);
        pairs /= 2;
        let mut sums_256 = [0; MAX_PIXELS >> 8];
        sweep_large(first(&self.sums_128, pairs), &mut sums_256, parts_128);
    }
}

/// As [`sweep`], of sums over 16 pixels or more.
// Out of line, so that the loop has all registers.
#[inline(never)]
fn sweep_large<T: Copy + Into<u32>>(sums: &[T], next: &mut [u32], parts: &mut [u32]) {
    sweep_of(sums, T::into, next, |sum| sum, parts);
}

// A sum of 16 pixels fits 16 bits. So do four blocks of 4 pixels, as `sweep` asks for its responses, and two
// blocks of 8, as `sweep_wide` does.
const _: () = assert!((LARGEST_COUNT as u32) << 4 <= u16::MAX as u32);

/// What blocks of 1, 2 and 4 pixels have.
pub(super) struct Fine {
    sums_2: [u16; MAX_PIXELS >> 1],
    sums_4: [u16; MAX_PIXELS >> 2],
    parts_1: [u32; most_parts(0)],
    parts_2: [u32; most_parts(1)],
    parts_4: [u32; most_parts(2)],
}

impl Fine {
    pub(super) const fn new() -> Self {
        Self {
            sums_2: [0; MAX_PIXELS >> 1],
            sums_4: [0; MAX_PIXELS >> 2],
            parts_1: [0; most_parts(0)],
            parts_2: [0; most_parts(1)],
            parts_4: [0; most_parts(2)],
        }
    }

    /// Sums a row's pixels. In place, because copies of the sums take time.
    #[inline(never)]
    pub(super) fn sum(&mut self, light: Light<'_>) {
        let (words, inverted) = light.words();
        sweep(words, inverted, &mut self.sums_2, &mut self.parts_1);
        let pairs = light.len() / 2;
        let twos = first(&self.sums_2, pairs);
        sweep(twos, 0, &mut self.sums_4, &mut self.parts_2);
        let fours = first(&self.sums_4, pairs / 2);
        sweep(fours, 0, &mut [0; MAX_PIXELS >> 3], &mut self.parts_4);
    }
}

/// The sums over blocks of all sizes, and the highest responses of the kernel, background included.
#[derive(Clone, Copy)]
pub(super) struct Sums<'a> {
    pub(super) light: Light<'a>,
    blocks: &'a [u16],
    coarse: &'a Coarse,
    /// Where there is none, only blocks of 8 pixels and more have [parts](Self::parts).
    fine: Option<&'a Fine>,
}

impl<'a> Sums<'a> {
    pub(super) fn new(light: Light<'a>, blocks: &'a [u16], coarse: &'a Coarse) -> Self {
        Self {
            light,
            blocks,
            coarse,
            fine: None,
        }
    }

    pub(super) const fn with(self, fine: &'a Fine) -> Self {
        Self {
            fine: Some(fine),
            ..self
        }
    }

    /// The smallest block size whose highest responses are known.
    pub(super) const fn smallest_log2(&self) -> u32 {
        match self.fine {
            None => BLOCK_LOG2,
            Some(_) => 0,
        }
    }

    pub(super) fn number(&self, block_log2: u32) -> usize {
        self.light.len() >> block_log2.min(LARGEST_BLOCK_LOG2)
    }

    /// The sum over a block. `None` off the row.
    #[inline]
    pub(super) fn block(&self, block_log2: u32, block: usize) -> Option<u32> {
        if block >= self.number(block_log2) {
            return None;
        }
        match block_log2 {
            0 => self.light.get(block).map(u32::from),
            1 | 2 => {
                let start = block.wrapping_shl(block_log2);
                let end = start.saturating_add(1 << block_log2);
                let pixels = self.light.slice(start..end)?;
                // At most four counts.
                Some(pixels.iter().map(u32::from).fold(0, numeric::add_u32))
            }
            3 => self.blocks.get(block).copied().map(u32::from),
            4 => self.coarse.sums_16.get(block).copied().map(u32::from),
            5 => self.coarse.sums_32.get(block).copied(),
            6 => self.coarse.sums_64.get(block).copied(),
            _ => self.coarse.sums_128.get(block).copied(),
        }
    }

    /// Writes the sums over the blocks from one on, as far as there are blocks and places. Returns how many.
    pub(super) fn blocks_from(&self, block_log2: u32, block: usize, sums: &mut [u32]) -> usize {
        let end = block.saturating_add(sums.len());
        let end = end.min(self.number(block_log2));
        let blocks = block..end.max(block);
        let number = blocks.len();
        let pixels = blocks.start.wrapping_shl(block_log2)..blocks.end.wrapping_shl(block_log2);
        match block_log2 {
            0..=2 => {
                let light = self.light.slice(pixels).unwrap_or_default();
                match block_log2 {
                    0 => fill(sums, light.chunks().map(sum_of::<1>)),
                    1 => fill(sums, light.chunks().map(sum_of::<2>)),
                    _ => fill(sums, light.chunks().map(sum_of::<4>)),
                }
            }
            3 | 4 => {
                let small = self.small_blocks(block_log2).get(blocks);
                let small = small.unwrap_or_default().iter();
                fill(sums, small.map(|&sum| sum.into()));
            }
            _ => {
                let large: &[u32] = match block_log2 {
                    5 => &self.coarse.sums_32,
                    6 => &self.coarse.sums_64,
                    _ => &self.coarse.sums_128,
                };
                fill(sums, large.get(blocks).unwrap_or_default().iter().copied());
            }
        }
        number
    }

    /// The sums over blocks of 2 to 16 pixels. Empty for other sizes, and for those that are not computed.
    pub(super) fn small_blocks(&self, block_log2: u32) -> &'a [u16] {
        let sums: &[u16] = match (block_log2, self.fine) {
            (1, Some(fine)) => &fine.sums_2,
            (2, Some(fine)) => &fine.sums_4,
            (3, _) => self.blocks,
            (4, _) => &self.coarse.sums_16,
            _ => &[],
        };
        sums.get(..self.number(block_log2)).unwrap_or_default()
    }

    /// The kernel's response with its middle on a block: at most 4 * 128 * 4095 < 2^21. `None` where the
    /// kernel reaches over the row's end.
    #[inline]
    pub(super) fn response(&self, block_log2: u32, block: usize) -> Option<u32> {
        let small = self.small_blocks(block_log2);
        if !small.is_empty() {
            let &[left, middle, right] = small.get(block.checked_sub(1)?..)?.first_chunk()?;
            return Some(u32::from(left) + 2 * u32::from(middle) + u32::from(right));
        }
        let left = self.block(block_log2, block.checked_sub(1)?)?;
        let (middle, right) = (
            self.block(block_log2, block)?,
            self.block(block_log2, block.checked_add(1)?)?,
        );
        let twice = numeric::add_u32(middle, middle);
        Some(numeric::add_u32(numeric::add_u32(left, twice), right))
    }

    /// The nearest blocks to the left of a block, and from it on to the right, on which the kernel's response
    /// is at most `most`.
    pub(super) fn nearest_low(
        &self,
        block_log2: u32,
        block: usize,
        most: u32,
    ) -> (Option<usize>, Option<usize>) {
        let block = block.min(self.number(block_log2).saturating_sub(1));
        let small = self.small_blocks(block_log2);
        if !small.is_empty() {
            let sums = |sum: &u16| u32::from(*sum);
            let left = small.get(..=block).unwrap_or_default().iter().map(sums);
            let right = small.get(block.saturating_sub(1)..).unwrap_or_default();
            return nearest_low(left.rev(), right.iter().map(sums), block, most);
        }
        let sums = |block: usize| self.block(block_log2, block).unwrap_or_default();
        let left = (0..block.saturating_add(1)).map(sums);
        let right = (block.saturating_sub(1)..self.number(block_log2)).map(sums);
        nearest_low(left.rev(), right, block, most)
    }

    /// Calls `see` with each of these blocks, which are in one of the [parts](Self::parts), on which the
    /// kernel's response is more than `least`, and with the response, until it returns `false`. Whether it
    /// never does.
    pub(super) fn all_above(
        &self,
        block_log2: u32,
        blocks: Range<usize>,
        least: u32,
        see: &mut dyn FnMut(usize, u32) -> bool,
    ) -> bool {
        let start = blocks.start.saturating_sub(1);
        let end = blocks.end.saturating_add(1);
        let small = self.small_blocks(block_log2);
        if !small.is_empty() {
            let near = small.get(start..end.min(small.len()));
            return all_above(near.unwrap_or_default(), start, least, see);
        }
        let mut near = [0; 2 * PART + 2];
        let near = (near.get_mut(..end.saturating_sub(start))).unwrap_or_default();
        let number = self.blocks_from(block_log2, start, near);
        all_above(near.get(..number).unwrap_or_default(), start, least, see)
    }

    /// The highest response of each part, and the blocks on which the kernel's middle lies there.
    pub(super) fn parts(
        &self,
        block_log2: u32,
    ) -> impl Iterator<Item = (u32, Range<usize>)> + use<'a> {
        let parts: &[u32] = match (block_log2, self.fine) {
            (0, Some(fine)) => &fine.parts_1,
            (1, Some(fine)) => &fine.parts_2,
            (2, Some(fine)) => &fine.parts_4,
            _ => {
                let size = block_log2.wrapping_sub(BLOCK_LOG2) as usize;
                let parts = self.coarse.parts.get(size);
                parts.map_or(&[], <[u32; _]>::as_slice)
            }
        };
        // The first pair of blocks is in no part.
        let pairs = self.number(block_log2) / 2;
        let number = pairs.saturating_sub(1).div_ceil(PART);
        // A part holds the kernels whose last block is in it. The first pair of blocks only starts the first
        // kernel, so the first middle is block 1.
        let starts = (0..most_parts(0)).map(|part| part.saturating_mul(2 * PART).saturating_add(1));
        let parts = parts.get(..number).unwrap_or_default();
        (parts.iter().copied())
            .zip(starts)
            .map(|(highest, start)| (highest, start..start.saturating_add(2 * PART)))
    }

    /// The block on which the kernel's middle has its highest response; of equal ones, the first.
    pub(super) fn highest(&self, block_log2: u32) -> Option<usize> {
        // Not `>=`: of equal parts the first.
        let (response, blocks) = (self.parts(block_log2))
            .reduce(|highest, part| if part.0 > highest.0 { part } else { highest })?;
        let mut found = None;
        let mut take_first = |block, _| {
            found = Some(block);
            false
        };
        let least = response.checked_sub(1)?;
        self.all_above(block_log2, blocks, least, &mut take_first);
        found
    }

    /// Whether one pixel has three quarters of the light about a block. No spot has such a pixel: its width
    /// is 0.5 or more.
    pub(super) fn is_one_pixel(&self, block_log2: u32, block: usize, level: Counts) -> bool {
        let size = 1usize << block_log2.min(LARGEST_BLOCK_LOG2);
        let from = block.saturating_sub(2).saturating_mul(size);
        let to = block.saturating_add(3).saturating_mul(size);
        let to = to.min(self.light.len());
        let pixels = self.light.slice(from..to).unwrap_or_default();
        // At most 640 pixels of 12 bits in Q8: below 2^30.
        let background = numeric::mul_i32(level.to_bits(), numeric::to_i32(pixels.len()));
        let blocks = block.checked_sub(2).and_then(|first| {
            let blocks = self.small_blocks(block_log2).get(first..)?;
            blocks.first_chunk::<5>()
        });
        let light = match blocks {
            Some(blocks) => blocks.map(u32::from).into_iter().fold(0, numeric::add_u32),
            None => pixels.sum(),
        };
        let light = numeric::sub_i32(in_q8(light), background);
        // Such a pixel divided by three is more than a quarter of the light, both rounded towards zero.
        let quarter = light / 4;
        let more = if quarter < 0 { 1 } else { 3 };
        let least = numeric::add_i32(numeric::mul_i32(3, quarter), more);
        // The largest whole count below it.
        let below = numeric::add_i32(least, level.to_bits()).saturating_sub(1) >> Counts::FRACTION;
        u32::try_from(below).map_or(true, |below| pixels.exceeds(below))
    }

    /// Whether a part of the background is darker than its level by more than a pixel's noise. A spot there
    /// may stand out from the background beside it, and not from the level. (The noise of a block of 128
    /// pixels is an eleventh of a pixel's, so noise alone makes no block so dark.)
    pub(super) fn has_darker_background(&self, level: Counts, noise: Counts) -> bool {
        let darkest = self.darkest(level).to_bits();
        level.to_bits().saturating_sub(darkest) > noise.to_bits()
    }

    /// The level of the darkest block of the largest size, but at most `level`: wide light may raise the
    /// level of most of the row.
    pub(super) fn darkest(&self, level: Counts) -> Counts {
        let sums = self.coarse.sums_128.iter();
        let darkest = sums.take(self.number(LARGEST_BLOCK_LOG2)).min();
        darkest.map_or(level, |&sum| {
            level.min(Counts::from_bits(in_q8(sum) >> LARGEST_BLOCK_LOG2))
        })
    }

    /// The background's level: the median over its blocks.
    pub(super) fn level(&self) -> Option<Counts> {
        let (block_log2, blocks) = self.blocks_of_background()?;
        Some(Counts::from_bits(in_q8(median(&blocks)?) >> block_log2))
    }

    /// The background's tilt, if it may hide a spot of this height.
    pub(super) fn tilt_that_may_hide(&self, height: Counts, noise: Counts) -> Option<Tilt> {
        let (block_log2, blocks) = self.blocks_of_background()?;
        Tilt::that_may_hide(&blocks, block_log2, self.light.len(), height, noise)
    }

    /// The blocks of the largest size of which the row has 16 or more, and that size.
    fn blocks_of_background(&self) -> Option<(u32, Vec<u32, MEDIAN_BLOCKS>)> {
        let sizes = 1..=LARGEST_BLOCK_LOG2;
        let block_log2 = sizes.take_while(|&log2| self.number(log2) >= 16).last()?;
        let mut blocks = Vec::new();
        blocks.resize(self.number(block_log2), 0).ok()?;
        self.blocks_from(block_log2, 0, &mut blocks);
        Some((block_log2, blocks))
    }
}

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

/// See [`Sums::nearest_low`]: the sums from `block` on to the left, and from the one before it to the right.
fn nearest_low(
    left: impl Iterator<Item = u32>,
    right: impl Iterator<Item = u32>,
    block: usize,
    most: u32,
) -> (Option<usize>, Option<usize>) {
    let left = first_low(left, most).and_then(|steps| block.checked_sub(steps));
    let right = first_low(right, most).map(|steps| block.saturating_sub(1).saturating_add(steps));
    (left, right)
}

/// The first of these blocks on which the kernel's response is at most `most`.
#[inline(always)]
fn first_low(mut sums: impl Iterator<Item = u32>, most: u32) -> Option<usize> {
    let (first, mut last) = (sums.next()?, sums.next()?);
    // Sums of at most 128 pixels of 12 bits: four of them are below 2^21.
    let mut last_two = numeric::add_u32(first, last);
    let low = sums.position(|sum| {
        let two = numeric::add_u32(last, sum);
        let response = numeric::add_u32(last_two, two);
        (last, last_two) = (sum, two);
        response <= most
    })?;
    Some(low.saturating_add(1))
}

/// See [`Sums::all_above`]: on these blocks, of which `first` is the first.
// A loop out of line, so that it keeps nothing but sums.
#[inline(never)]
fn all_above<T: Copy + Into<u32>>(
    blocks: &[T],
    first: usize,
    least: u32,
    see: &mut dyn FnMut(usize, u32) -> bool,
) -> bool {
    let middles = first.saturating_add(1)..usize::MAX;
    for (block, three) in middles.zip(blocks.windows(3)) {
        let &[left, middle, right] = three else {
            continue;
        };
        // As in `first_low`.
        let sides = numeric::add_u32(left.into(), right.into());
        let response = numeric::add_u32(sides, numeric::add_u32(middle.into(), middle.into()));
        if response > least && !see(block, response) {
            return false;
        }
    }
    true
}

/// The sum over a block of at most four pixels.
pub(super) fn sum_of<const N: usize>(block: [u16; N]) -> u32 {
    block.into_iter().map(u32::from).fold(0, numeric::add_u32)
}

#[inline(always)]
fn fill(sums: &mut [u32], values: impl Iterator<Item = u32>) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum = value;
    }
}

fn first<T>(values: &[T], number: usize) -> &[T] {
    values.get(..number).unwrap_or(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::Blocks;

    /// In all sizes, from each block on, and where no block is low.
    #[test]
    fn the_nearest_low_blocks_are_those_with_a_low_response() {
        let counts: [u16; 700] = core::array::from_fn(|i| (crate::tests::hash(i) >> 24) as u16);
        let light = Light::from(&counts);
        let blocks = Blocks::of(light);
        let (mut coarse, mut fine) = (Coarse::new(), Fine::new());
        coarse.sum(blocks.sums());
        fine.sum(light);
        let sums = Sums::new(light, blocks.sums(), &coarse).with(&fine);
        for block_log2 in 0..=LARGEST_BLOCK_LOG2 {
            let number = sums.number(block_log2);
            let mean = 4 * (128 << block_log2);
            for most in [0, mean / 4, mean * 7 / 8, mean * 2] {
                let is_low = |&block: &usize| {
                    let response = sums.response(block_log2, block);
                    response.is_some_and(|response| response <= most)
                };
                for block in 0..number + 2 {
                    let left = (0..block).rev().find(is_low);
                    let right = (block..number).find(is_low);
                    let found = sums.nearest_low(block_log2, block, most);
                    assert_eq!(
                        found,
                        (left, right),
                        "at most {most} at {block} of {number}"
                    );
                }
            }
        }
    }
}
