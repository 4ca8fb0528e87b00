//! The coarse search for a spot whose width is known: one sweep of the kernel [1 2 1] over the row, in groups
//! of blocks of 8 pixels.

use crate::numeric;
use crate::row::{LARGEST_COUNT, MAX_PIXELS};

/// Blocks of 2^3 = 8 pixels: a block's sum fits 16 bits, and a block is four words of two pixels.
pub(super) const BLOCK_LOG2: u32 = 3;

const _: () = assert!((LARGEST_COUNT as u32) << BLOCK_LOG2 <= u16::MAX as u32);

/// Blocks in a part of the row, which is also the size of the largest group. The sweep keeps the highest
/// response of each part. [`Sweep::peak`] then searches only the parts that matter for the place.
const PART_LOG2: u32 = 4;

const PARTS: usize = MAX_PIXELS >> (BLOCK_LOG2 + PART_LOG2);

/// How far a spot reaches, in groups: a response at this distance or nearer belongs to the spot. A spot's
/// width is at most 1.5 groups: at this distance it has a third of its response left.
const SPOT_REACH: usize = 2;

/// The highest response of the kernel in each part of the row, background included.
pub(super) struct Sweep<'a> {
    blocks: &'a [[u16; 8]],
    /// A group has 2^`log2` blocks, at most 2^[`PART_LOG2`].
    log2: u32,
    highest_in_parts: [u32; PARTS],
}

/// The highest response; of equal ones, the first.
#[derive(Clone, Copy)]
pub(super) struct Peak {
    pub(super) group: usize,
    pub(super) response: u32,
    /// Whether a similar response lies more than [`SPOT_REACH`] groups away.
    pub(super) has_another: bool,
}

impl<'a> Sweep<'a> {
    pub(super) fn new(blocks: &'a [[u16; 8]], log2: u32) -> Self {
        let log2 = log2.min(PART_LOG2);
        let highest_in_parts = match log2 {
            0 => sweep_blocks(blocks),
            _ => sweep_groups(blocks, log2),
        };
        Self {
            blocks,
            log2,
            highest_in_parts,
        }
    }

    /// Finds the peak. `least_similar` gives the least response that is similar to a given one. `None` where
    /// the row is too short for a response.
    pub(super) fn peak(&self, least_similar: impl FnOnce(u32) -> u32) -> Option<Peak> {
        let highest = *self.highest_in_parts.iter().max()?;
        let least = least_similar(highest);
        let mut peak = None;
        let (mut first, mut last) = (usize::MAX, 0);
        let parts = (0..PARTS).zip(&self.highest_in_parts);
        for (part, _) in parts.filter(|&(_, highest)| *highest >= least) {
            let mut kernel = Kernel::default();
            // The kernel's last group is in the part, and two are before it.
            let log2 = self.log2.min(PART_LOG2);
            let groups = 1usize << (PART_LOG2 - log2);
            let end = groups.saturating_mul(part.saturating_add(1));
            let start = end.saturating_sub(groups).saturating_sub(2);
            let blocks = self
                .blocks
                .get(start.saturating_mul(1 << log2)..)
                .unwrap_or_default();
            let responses = (start..end)
                .zip(blocks.chunks_exact(1 << log2))
                .map(|(group, blocks)| (group, kernel.take(sum_of_blocks(blocks))));
            for (group, response) in responses {
                if response < least {
                    continue;
                }
                let middle = group.saturating_sub(1);
                (first, last) = (first.min(middle), middle);
                if response == highest && peak.is_none() {
                    peak = Some(middle);
                }
            }
        }
        let group = peak?;
        Some(Peak {
            group,
            response: highest,
            has_another: first.saturating_add(SPOT_REACH) < group
                || last > group.saturating_add(SPOT_REACH),
        })
    }

    /// The sum over a group. `None` off the row.
    pub(super) fn sum(&self, group: usize) -> Option<u32> {
        let size = 1usize << self.log2;
        let start = group.checked_mul(size)?;
        let blocks = self.blocks.get(start..start.checked_add(size)?)?;
        Some(sum_of_blocks(blocks))
    }
}

// Two loops out of line, so that each keeps nothing but sums.

#[inline(never)]
fn sweep_blocks(blocks: &[[u16; 8]]) -> [u32; PARTS] {
    let mut kernel = Kernel::default();
    find_highest_in_parts(blocks, |blocks| kernel.highest(blocks.iter().map(sum)))
}

#[inline(never)]
fn sweep_groups(blocks: &[[u16; 8]], log2: u32) -> [u32; PARTS] {
    let mut kernel = Kernel::default();
    find_highest_in_parts(blocks, |blocks| {
        let groups = blocks.chunks_exact(1 << log2);
        kernel.highest(groups.map(sum_of_blocks))
    })
}

#[inline(always)]
fn find_highest_in_parts(
    blocks: &[[u16; 8]],
    mut highest: impl FnMut(&[[u16; 8]]) -> u32,
) -> [u32; PARTS] {
    let mut parts = [0; PARTS];
    let (whole, rest) = blocks.as_chunks::<{ 1 << PART_LOG2 }>();
    let mut left = parts.iter_mut();
    for (part, blocks) in left.by_ref().zip(whole) {
        *part = highest(blocks);
    }
    if let Some(part) = left.next() {
        *part = highest(rest);
    }
    parts
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

    /// Takes sums, and returns the highest response of a kernel that ends with one of them.
    #[inline(always)]
    fn highest(&mut self, sums: impl Iterator<Item = u32>) -> u32 {
        sums.fold(0, |highest, sum| highest.max(self.take(sum)))
    }
}

/// The sum of a block of 8 pixels, two at a time: each half of the word adds four counts of 12 bits, which
/// fit 16 bits.
#[inline(always)]
fn sum(&[a, b, c, d, e, f, g, h]: &[u16; 8]) -> u32 {
    let left = numeric::add_u32(pair(a, b), pair(c, d));
    let right = numeric::add_u32(pair(e, f), pair(g, h));
    let both = numeric::add_u32(left, right);
    (both & 0xffff) + (both >> 16)
}

/// The sum over blocks of at most 128 pixels together.
#[inline(always)]
pub(crate) fn sum_of_blocks(blocks: &[[u16; 8]]) -> u32 {
    blocks
        .iter()
        .fold(0, |all, block| numeric::add_u32(all, sum(block)))
}

#[inline(always)]
fn pair(low: u16, high: u16) -> u32 {
    u32::from(low) | (u32::from(high) * 0x1_0000)
}
