//! The sums over blocks of 8 pixels, from the one pass over a read-out's words that also tests them. The
//! search for the spot starts from these sums.

use dual_mac::Pair;

use crate::row::{LARGEST_COUNT, Light, MAX_PIXELS};

/// Blocks of 2^3 = 8 pixels: a block's sum fits 16 bits.
pub(crate) const BLOCK_LOG2: u32 = 3;
pub(crate) const BLOCK: usize = 1 << BLOCK_LOG2;

const _: () = assert!((LARGEST_COUNT as u32) << BLOCK_LOG2 <= u16::MAX as u32);

/// The most blocks of a row.
const MAX_BLOCKS: usize = MAX_PIXELS / BLOCK;

/// The sums over the blocks of a row, light positive. Pixels that do not fill the last block are left out.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    sums: [u16; MAX_BLOCKS],
    length: usize,
}

impl Blocks {
    pub(crate) const NONE: Self = Self {
        sums: [0; MAX_BLOCKS],
        length: 0,
    };

    pub(crate) fn of(light: Light<'_>) -> Self {
        let mut blocks = Self::NONE;
        blocks.sum(light);
        blocks
    }

    /// Sums a row's blocks, and returns all bits that are set in any of their words. If one of these bits is
    /// above full scale, the sums mean nothing.
    #[inline]
    pub(crate) fn sum(&mut self, light: Light<'_>) -> u16 {
        let (words, inverted) = light.words();
        let blocks = words.as_chunks::<BLOCK>().0;
        self.length = blocks.len().min(MAX_BLOCKS);
        // A count is full scale less a word, or the word itself.
        let (sign, of_eight) = match inverted {
            0 => (Pair(1, 1), 0),
            full_scale => (Pair(-1, -1), full_scale.wrapping_shl(BLOCK_LOG2)),
        };
        dual_mac::sum_blocks(blocks, sign, of_eight, &mut self.sums)
    }

    pub(crate) fn clear(&mut self) {
        self.length = 0;
    }

    #[inline]
    pub(crate) fn sums(&self) -> &[u16] {
        self.sums.get(..self.length).unwrap_or_default()
    }
}
