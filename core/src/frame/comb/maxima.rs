//! Finds all images of a comb on a row, to a few pixels.
//!
//! The kernel [1 2 1] runs over blocks of 8 pixels, as in the search for one spot. A peak is the highest
//! response for five blocks to both sides. It stands out of the noise, and is no side lobe of a brighter one.

use heapless::Vec;

use crate::base::{Counts, numeric};
use crate::row::{BLOCK, Background};

/// The most peaks of a row. If there are more, the highest are kept.
pub const MAX_MAXIMA: usize = 32;
/// A peak is the highest response within so many blocks: 40 pixels, half of the way between the images of the
/// nearest two slits less the width of one.
const APART: usize = 5;
/// Side lobes of a slit are sought within so many blocks: 88 pixels. The next slit's image is farther.
const LOBES: usize = 11;
/// A slit's side lobes beyond [`APART`] have less than 1 / [`LOBE`] of its peak: the third one has 0.8 %
/// (sinc^2 at 3.47).
const LOBE: u32 = 32;
/// The least response in standard deviations of its noise.
const DETECTION: u32 = 5;
/// Standard deviation of the kernel's noise over that of a pixel: sqrt((1 + 4 + 1) 8) = 6.93, rounded up.
const KERNEL_NOISE: u32 = 7;

/// Where an image is, roughly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Maximum {
    /// The pixel, to about two.
    pub place: f32,
    /// Height above the background.
    pub height: Counts,
}

/// The peaks of a row.
pub type Maxima = Vec<Maximum, MAX_MAXIMA>;

pub(crate) fn find(blocks: &[u16], background: Background, peaks: &mut Maxima) {
    peaks.clear();
    let noise = background.noise.to_bits().max(0).unsigned_abs();
    let level = background.level_bits().unsigned_abs();
    // Four blocks of the level, which is below 2^20 in Q8.
    let under = level.saturating_mul(4 * numeric::to_u32(BLOCK)) >> Counts::FRACTION;
    let least = noise.saturating_mul(DETECTION * KERNEL_NOISE) >> Counts::FRACTION;
    let least = under.saturating_add(least);
    for (three, block) in blocks.windows(3).zip(1usize..) {
        let Some(response) = response(three).filter(|&response| response > least) else {
            continue;
        };
        let beside = |three: Option<&[u16]>| three.and_then(self::response).unwrap_or(under);
        let left = beside(blocks.get(block.saturating_sub(2)..=block));
        let right = beside(blocks.get(block..block.saturating_add(3)));
        // Most blocks of an image are done with by a look at their neighbours.
        if left >= response || right > response {
            continue;
        }
        let above = response.saturating_sub(under);
        if !is_highest(blocks, block, response) || is_side_lobe(blocks, block, above, under) {
            continue;
        }
        // A block's number is below 2^9, and a response above the level is that of 32 pixels.
        let (left, right, middle) = (left as f32, right as f32, response as f32);
        // The vertex of the parabola through three responses, at most half a block from the middle one.
        let bend = 2.0 * middle - left - right;
        let rise = 0.5 * (right - left);
        let off = if bend > 0.0 { rise / bend } else { 0.0 };
        let peak = Maximum {
            place: (block as f32 + 0.5 + off) * BLOCK as f32 - 0.5,
            height: Counts::from_bits((above.saturating_mul(1 << (Counts::FRACTION - 5))) as i32),
        };
        add(peaks, peak);
    }
}

/// Adds a peak. If the list is full, the new peak takes the place of the lowest one.
fn add(peaks: &mut Maxima, peak: Maximum) {
    let Err(peak) = peaks.push(peak) else { return };
    let lowest = peaks.iter_mut().min_by_key(|peak| peak.height);
    if let Some(lowest) = lowest.filter(|lowest| lowest.height < peak.height) {
        *lowest = peak;
    }
}

/// The kernel's response on three blocks: below 2^17.
fn response(three: &[u16]) -> Option<u32> {
    let &[left, middle, right] = three else {
        return None;
    };
    let sides = numeric::add_u32(left.into(), right.into());
    Some(numeric::add_u32(sides, 2 * u32::from(middle)))
}

/// The highest response on the blocks within `reach` of one, that block left out.
fn highest_near(blocks: &[u16], block: usize, reach: usize) -> (u32, u32) {
    let from = block.saturating_sub(reach.saturating_add(1));
    let highest = |blocks: Option<&[u16]>| {
        let responses = blocks.unwrap_or_default().windows(3).filter_map(response);
        responses.max().unwrap_or(0)
    };
    let to = block.saturating_add(reach).saturating_add(2);
    let to = to.min(blocks.len());
    (
        highest(blocks.get(from..block.saturating_add(1))),
        highest(blocks.get(block..to)),
    )
}

/// Whether no response nearby is higher. Of equal ones the first counts.
fn is_highest(blocks: &[u16], block: usize, response: u32) -> bool {
    let (left, right) = highest_near(blocks, block, APART);
    left < response && right <= response
}

/// Whether a response above the background is so much lower than another one that it may be its side lobe.
fn is_side_lobe(blocks: &[u16], block: usize, above: u32, under: u32) -> bool {
    let (left, right) = highest_near(blocks, block, LOBES);
    left.max(right).saturating_sub(under) / LOBE > above
}
