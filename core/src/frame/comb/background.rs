//! Level and noise of a row away from the images of a comb.

use core::ops::Range;

use heapless::Vec;

use crate::base::{Counts, numeric, order_statistic};
use crate::row::{BLOCK, Background, Light};
use crate::spot::noise;

/// The most blocks from which the level is taken.
const MOST: usize = 64;
/// Fewer pixels do not tell level and noise.
const LEAST: usize = 512;

/// Level and noise of the pixels that are not in `images`. If these pixels are fewer than 512, all pixels
/// count: the noise then contains the steps of the images.
///
/// The level is the median of up to 64 blocks of 8 pixels, so it holds if less than half of them are lit.
pub(crate) fn background(
    light: Light<'_>,
    blocks: &[u16],
    images: Range<usize>,
) -> Option<Background> {
    let outside = (images.start.min(light.len()))
        .saturating_add(light.len().saturating_sub(images.end.max(images.start)));
    let images = if outside < LEAST { 0..0 } else { images };
    let blocks_of_images = images.start / BLOCK..images.end.div_ceil(BLOCK);
    let left = blocks.get(..blocks_of_images.start.min(blocks.len()));
    let right = blocks.get(blocks_of_images.end.min(blocks.len())..);
    let (left, right) = (left.unwrap_or_default(), right.unwrap_or_default());
    // Half a row has as many blocks as fit a usize.
    let step = left.len().saturating_add(right.len()).div_ceil(MOST).max(1);
    let mut sums: Vec<u32, { MOST + 1 }> = Vec::new();
    for &sum in left.iter().step_by(step).chain(right.iter().step_by(step)) {
        // Two parts of a row, each rounded up, are at most MOST + 1 blocks.
        let _ = sums.push(sum.into());
    }
    let median = order_statistic::ranked(sums.len() / 2, &sums)?;
    // A sum of 8 counts of 12 bits, in Q8, is below 2^23.
    let level = numeric::mul_i32(median as i32, 1 << Counts::FRACTION) / numeric::to_i32(BLOCK);
    let (left, _) = light.split(images.start);
    let (_, right) = light.split(images.end);
    Some(Background {
        level: Counts::from_bits(level),
        noise: noise(&[left, right])?,
    })
}
