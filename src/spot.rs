//! Where the spot is, to a pixel, and how wide, to a factor of two.
//!
//! First the row's own background: its level and its noise, as medians over blocks of pixels, so that a spot that
//! fills less than half of the row does not count. Then the kernel [1 2 1] runs over the pixels, over sums of 2 pixels,
//! of 4, 8 ... 128. That kernel gathers 97 % of the signal-to-noise ratio of the best filter for a gaussian whose width
//! is 0.9 of a block, and the ladder of block sizes is fine enough for every width between. The spot is where the
//! response stands highest above its own noise.
//!
//! All in integers, and all from differences of counts: adding a constant to a row changes nothing.

use heapless::Vec;

use crate::reading::Fault;
use crate::row::{LARGEST_COUNT, Row};
use crate::units::Counts;

/// The longest row, in pixels of its light range.
pub const MAX_PIXELS: usize = 4096;

/// The largest block has 2^7 = 128 pixels, for widths up to 130 pixels.
const LARGEST_BLOCK_LOG2: u32 = 7;

/// A response this far above its noise (in standard deviations) is a spot. Noise alone gets there in one row of 7000:
/// 7300 kernel positions a row at a probability of 1.9e-8 each. Those rows end as too dim, see the estimator.
const DETECTION: u64 = 11; // in halves of a standard deviation: 5.5

/// A candidate for the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    /// The pixel nearest to the middle, good to half a block.
    pub centre: usize,
    /// The spot's width is about 2^`block_log2` pixels, within a factor of about two.
    pub block_log2: u32,
    /// What the row reads away from the spot.
    pub background: Background,
}

/// What the row reads away from the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background {
    /// Its level.
    pub level: Counts,
    /// Standard deviation of a pixel, at least that of rounding to a count (1/sqrt(12)).
    pub noise: Counts,
}

/// Finds the spot.
///
/// # Errors
/// [`Fault::NoSpot`] where nothing stands out, or the row is longer than [`MAX_PIXELS`] or shorter than 16 pixels.
pub fn find(row: &Row<'_>) -> Result<Spot, Fault> {
    let light = row.light();
    let background = background(light).ok_or(Fault::NoSpot {
        amplitude: Counts::from_int(0),
    })?;
    let level = background.level.to_bits();
    let mut best = Peak::at(sweep(light.iter().map(|&count| u32::from(count))), 0, level);
    // Each pass halves the sums in place, so the buffer only shrinks.
    let mut sums: Vec<u32, { MAX_PIXELS / 2 }> = Vec::new();
    for pair in light.chunks_exact(2) {
        // Rows too long for the buffer were refused with the background.
        let _ = sums.push(pair.iter().map(|&count| u32::from(count)).sum());
    }
    for block_log2 in 1..=LARGEST_BLOCK_LOG2 {
        let peak = Peak::at(sweep(sums.iter().copied()), block_log2, level);
        if peak.significance > best.significance {
            best = peak;
        }
        halve(&mut sums);
    }
    // The kernel's noise: (1 + 4 + 1) * 2^block_log2 pixels' variance. Q8 counts squared: noise < 2^20, so below 2^44.
    let noise = u64::from(background.noise.to_bits().unsigned_abs());
    let needed = 6 * noise * noise * DETECTION * DETECTION / 4;
    if best.significance < needed {
        return Err(Fault::NoSpot {
            amplitude: best.height(),
        });
    }
    Ok(Spot {
        centre: best.centre(),
        block_log2: best.block_log2,
        background,
    })
}

/// The highest response at one block size.
struct Peak {
    block_log2: u32,
    /// Index of the kernel's middle block.
    block: usize,
    /// Response above the background, Q24.8 counts.
    response: i32,
    /// response^2 / block size: comparable between block sizes, and with the noise's variance.
    significance: u64,
}

impl Peak {
    fn at((block, response): (usize, u32), block_log2: u32, level: i32) -> Self {
        // A response is at most 4 * 128 * 4095 < 2^21 counts; so is the background under it: both fit in Q8.
        let response = ((response << Counts::FRACTION) as i32 - ((level * 4) << block_log2)).max(0);
        let significance =
            (u64::from(response.unsigned_abs()) * u64::from(response.unsigned_abs())) >> block_log2;
        Self {
            block_log2,
            block,
            response,
            significance,
        }
    }

    /// The kernel weighs a block's worth of pixels by 1 + 2 + 1; a matched gaussian fills 80 % of that.
    fn height(&self) -> Counts {
        Counts::from_bits(self.response >> (2 + self.block_log2))
    }

    fn centre(&self) -> usize {
        (self.block << self.block_log2) + ((1usize << self.block_log2) / 2)
    }
}

/// The largest value of a + 2 b + c over three neighbours, and where b is. Zero at 0 where there are fewer than three.
fn sweep(values: impl Iterator<Item = u32>) -> (usize, u32) {
    let (mut previous, mut pair) = (0, 0);
    let (mut best, mut best_at) = (0, 0);
    for (i, value) in values.enumerate() {
        // Sums of at most 128 pixels of 12 bits: four of them stay below 2^21.
        let next = previous + value;
        let response = pair + next;
        if i >= 2 && response > best {
            (best, best_at) = (response, i - 1);
        }
        (previous, pair) = (value, next);
    }
    (best_at, best)
}

/// Sums of two neighbours take the place of their parts.
fn halve(sums: &mut Vec<u32, { MAX_PIXELS / 2 }>) {
    let half = sums.len() / 2;
    for i in 0..half {
        if let (Some(&a), Some(&b)) = (sums.get(2 * i), sums.get(2 * i + 1))
            && let Some(sum) = sums.get_mut(i)
        {
            *sum = a + b;
        }
    }
    sums.truncate(half);
}

/// Most blocks of the background's median.
const BACKGROUND_BLOCKS: usize = 32;

/// Level and noise as medians over blocks: the level from the blocks' means, the noise from their mean absolute
/// differences of neighbours, which are sigma 2/sqrt(pi) for white noise.
fn background(light: &[u16]) -> Option<Background> {
    if light.len() > MAX_PIXELS || light.len() < 16 {
        return None;
    }
    let block = light.len().div_ceil(BACKGROUND_BLOCKS).max(8);
    let mut levels: Vec<u32, BACKGROUND_BLOCKS> = Vec::new();
    let mut noises: Vec<u32, BACKGROUND_BLOCKS> = Vec::new();
    for pixels in light.chunks_exact(block) {
        let first = pixels.first().copied().unwrap_or_default();
        let (mut sum, mut steps, mut last) = (0u32, 0u32, first);
        for &count in pixels {
            // At most 4096 pixels of 12 bits: both sums stay below 2^24, and times 2^8 below 2^32.
            sum += u32::from(count);
            steps += u32::from(count.abs_diff(last));
            last = count;
        }
        let pixels = block as u32;
        let _ = levels.push((sum << Counts::FRACTION) / pixels);
        let _ = noises.push((steps << Counts::FRACTION) / (pixels - 1));
    }
    // sqrt(pi)/2 = 0.886227 as 58080/65536; a mean step is below 2^20 in Q8.
    let noise = (u64::from(median(&mut noises)?) * 58_080) >> 16;
    const ROUNDING: i32 = 74; // 256 / sqrt(12)
    Some(Background {
        level: Counts::from_bits(median(&mut levels)? as i32),
        noise: Counts::from_bits((noise as i32).max(ROUNDING)),
    })
}

fn median(values: &mut Vec<u32, BACKGROUND_BLOCKS>) -> Option<u32> {
    values.sort_unstable();
    values.get(values.len() / 2).copied()
}

const _: () =
    assert!(4 * (LARGEST_COUNT as u64) << (LARGEST_BLOCK_LOG2 + Counts::FRACTION) < 1 << 31);
const _: () = assert!((MAX_PIXELS as u64 * LARGEST_COUNT as u64) << Counts::FRACTION < 1 << 32);
