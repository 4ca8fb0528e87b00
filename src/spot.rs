//! Where the spot is, to a pixel, and how wide, to a factor of two.
//!
//! First the row's own background: its level and its noise, as medians over blocks of pixels, so that a spot that
//! fills less than half of the row does not count. Then the kernel [1 2 1] runs over the pixels, over sums of 2 pixels,
//! of 4, 8 ... 128. For a gaussian whose width is 0.9 of a block that kernel gathers 89 to 97 % of the signal-to-noise ratio of
//! the best filter, as it lies on the blocks, and 84 % or more for the widths between. The spot is where the response stands
//! highest above its own noise.
//!
//! All in integers, and all from differences of counts: adding a constant to a row changes nothing.

use heapless::Vec;

use crate::reading::Fault;
use crate::row::{LARGEST_COUNT, MAX_PIXELS, Row};
use crate::units::{Counts, Pixels};

/// The shortest row that is searched, in pixels of its light range.
pub const MIN_PIXELS: usize = 32;

/// The largest block has 2^7 = 128 pixels, for widths up to 130 pixels.
const LARGEST_BLOCK_LOG2: u32 = 7;

/// A response this far above its noise is a spot, in halves of a standard deviation. At 4.5 a spot of 1.5 pixels' width and a
/// peak of five times the noise is missed once in some thousand rows, and noise alone gets there in one row of twenty. Those rows
/// end as too dim: see the estimator.
const DETECTION: u64 = 9;

/// A candidate for the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    /// The pixel nearest to the middle, good to half a block.
    pub centre: usize,
    /// The spot's width is about 2^`block_log2` pixels, within a factor of about two.
    pub block_log2: u32,
    /// Its height, roughly: the mean over the pixels of the kernel, above the background.
    pub height: Counts,
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
/// [`Fault::NoSpot`] where nothing stands out, or the row is shorter than [`MIN_PIXELS`].
/// [`Fault::SensorSilent`] where all pixels read the same, which no sensor's noise allows.
pub fn find(row: &Row<'_>) -> Result<Spot, Fault> {
    let light = row.light();
    let no_spot = Fault::NoSpot {
        amplitude: Counts::from_int(0),
    };
    if light.len() < MIN_PIXELS {
        return Err(no_spot);
    }
    if light.iter().all(|count| Some(count) == light.first()) {
        return Err(Fault::SensorSilent);
    }
    let (peaks, level) = peaks(light).ok_or(no_spot)?;
    let background = Background {
        level,
        noise: noise(light).ok_or(no_spot)?,
    };
    let best = peaks
        .iter()
        .enumerate()
        .map(|(block_log2, peak)| Candidate::new(*peak, block_log2 as u32, level))
        .max_by_key(|candidate| candidate.significance)
        .ok_or(no_spot)?;
    if best.significance < needed(background.noise) {
        return Err(Fault::NoSpot {
            amplitude: best.height(),
        });
    }
    Ok(Spot {
        centre: best.centre(light),
        block_log2: best.block_log2,
        height: best.height(),
        background,
    })
}

/// Finds the spot again in the next row: in blocks of 8 pixels or more, a multiple of them that fits the width it had, and above
/// the background and the noise it had. That takes a tenth of the work. Narrower spots are looked for as in [`find`], and so is
/// what turns up more than its width and a block from where it was, or on another background. Light that changed all at once
/// changed the noise too; by the old background and the old noise, noise might pass for a spot.
///
/// # Errors
/// As [`find`].
pub fn find_again(row: &Row<'_>, before: &Spot, width: Pixels) -> Result<Spot, Fault> {
    let light = row.light();
    // The kernel fits a width of 0.9 of its block best, and one of 0.75 or 1.5 nearly as well.
    let block_log2 = (BLOCK_LOG2..=LARGEST_BLOCK_LOG2)
        .take_while(|&log2| width >= Pixels::from_int((3 << log2) / 4))
        .last();
    let Some(block_log2) = block_log2.filter(|_| light.len() >= MIN_PIXELS) else {
        return find(row);
    };
    let blocks = light.as_chunks().0;
    let log2 = block_log2 - BLOCK_LOG2;
    let peak = match block_log2 {
        BLOCK_LOG2 => sweep_blocks(blocks),
        _ => sweep_groups(blocks, log2),
    };
    // A response is at most 4 * 128 * 4095 < 2^21 counts, and so is the background under it: both fit in Q8.
    let background = (before.background.level.to_bits() * 4) << block_log2;
    let response = ((peak.response << Counts::FRACTION) as i32 - background).max(0);
    let significance = square(response.unsigned_abs()) >> block_log2;
    let block = 1usize << block_log2;
    let centre = (peak.block << block_log2) + block / 2;
    // At least three quarters of a block, by which the block was chosen, so not negative.
    let width = (width.to_bits() >> Pixels::FRACTION) as usize;
    // What is left of a spot that went away is not looked for in noise; and rows without change tell that no sensor is there.
    if significance < needed(before.background.noise)
        || centre.abs_diff(before.centre) > width + block
        || is_on_another(
            background,
            response,
            background_beside(blocks, log2, peak.block),
        )
    {
        return find(row);
    }
    Ok(Spot {
        centre,
        block_log2,
        height: Counts::from_bits(response >> (2 + block_log2)),
        background: before.background,
    })
}

/// Whether the background beside the spot differs from the one it had by more than a quarter of the spot's response; all as the
/// kernel weighs them, in Q24.8 counts. Less changes no centre of a phase table: a quarter of a
/// response does not pass for the whole. The rungs that take the level off are off by that.
fn is_on_another(background: i32, response: i32, beside: Option<i32>) -> bool {
    beside.is_none_or(|beside| beside.abs_diff(background) > response.unsigned_abs() / 4)
}

/// Groups of blocks from the spot's to those beside it. A group has 2/3 to 4/3 of the width: their nearest pixels are
/// 2.7 widths from the centre, where a gaussian has 3 % of its height left.
const BESIDE: usize = 5;

/// The background to the left and right of a group of 2^`log2` blocks, as the kernel [1 2 1] weighs it, in Q24.8 counts. `None`
/// where the row has neither.
fn background_beside(blocks: &[[u16; 8]], log2: u32, group: usize) -> Option<i32> {
    let sum_of = |group: usize| {
        let start = group << log2;
        let blocks = blocks.get(start..start + (1 << log2))?;
        Some(blocks.iter().map(sum).sum::<u32>())
    };
    let left = group.checked_sub(BESIDE).and_then(sum_of);
    let right = sum_of(group + BESIDE);
    let both = left.or(right)? + right.or(left)?;
    // A group has at most 128 pixels of 12 bits: four of them, in Q8, are below 2^29.
    Some(((2 * both) << Counts::FRACTION) as i32)
}

/// Blocks of 2^3 = 8 pixels: their sums fit 16 bits, and four words of two pixels make one.
const BLOCK_LOG2: u32 = 3;

const _: () = assert!((LARGEST_COUNT as u32) << BLOCK_LOG2 <= u16::MAX as u32);

/// The kernel's highest response, background included, and its middle block.
#[derive(Clone, Copy, Default)]
struct Highest {
    block: usize,
    response: u32,
}

/// Runs [1 2 1] over blocks.
#[inline(never)]
fn sweep_blocks(blocks: &[[u16; 8]]) -> Highest {
    let mut kernel = Kernel::default();
    for block in blocks {
        kernel.take(sum(block));
    }
    kernel.highest()
}

/// Runs [1 2 1] over groups of 2^`log2` blocks.
#[inline(never)]
fn sweep_groups(blocks: &[[u16; 8]], log2: u32) -> Highest {
    let mut kernel = Kernel::default();
    for group in blocks.chunks_exact(1 << log2) {
        kernel.take(group.iter().map(sum).sum());
    }
    kernel.highest()
}

/// The kernel [1 2 1], which takes one sum after the other.
#[derive(Default)]
struct Kernel {
    last: u32,
    last_two: u32,
    taken: usize,
    highest: Highest,
}

impl Kernel {
    #[inline(always)]
    fn take(&mut self, sum: u32) {
        let two = self.last + sum;
        // What is missing before the first two counts as zero, below any background.
        let response = self.last_two + two;
        if response > self.highest.response {
            self.highest = Highest {
                block: self.taken,
                response,
            };
        }
        (self.last, self.last_two) = (sum, two);
        self.taken += 1;
    }

    /// The response was noted at the kernel's last block.
    fn highest(self) -> Highest {
        Highest {
            block: self.highest.block.saturating_sub(1),
            ..self.highest
        }
    }
}

/// The sum of a block of 8 pixels, two at a time: four counts of 12 bits fit the 16 bits that each half has.
#[inline(always)]
pub(crate) fn sum(&[a, b, c, d, e, f, g, h]: &[u16; 8]) -> u32 {
    let both = (pair(a, b) + pair(c, d)) + (pair(e, f) + pair(g, h));
    (both & 0xffff) + (both >> 16)
}

#[inline(always)]
fn pair(low: u16, high: u16) -> u32 {
    u32::from(low) | u32::from(high) << 16
}

/// The significance that a spot has at least: see [`DETECTION`]. The kernel's noise is (1 + 4 + 1) * 2^block_log2 pixels'
/// variance; Q8 counts squared: noise < 2^20, so below 2^50.
fn needed(noise: Counts) -> u64 {
    6 * square(noise.to_bits().unsigned_abs()) * DETECTION * DETECTION / 4
}

fn square(value: u32) -> u64 {
    u64::from(value) * u64::from(value)
}

/// Number of block sizes: 1, 2, 4 ... 128 pixels.
const SIZES: usize = LARGEST_BLOCK_LOG2 as usize + 1;

/// The kernel's highest response at one block size, background included.
#[derive(Clone, Copy, Default)]
struct Peak {
    /// The part of the row, in [`PART`]s of pairs of blocks, in which the kernel's last block is;
    /// the first pair of blocks is in none.
    part: usize,
    response: u32,
}

/// Pairs of blocks in a part. Noting where the maximum is for each part, and not for each block, halves the search's cost;
/// [`locate`] looks into the part for the winner alone.
const PART: usize = 16;

/// The peaks at all block sizes, and the background's level: the median over the largest blocks of which the row
/// has 16.
fn peaks(light: &[u16]) -> Option<([Peak; SIZES], Counts)> {
    let mut peaks = [Peak::default(); SIZES];
    let mut level = None;
    // Sums of a block size become those of the next in the other buffer.
    let (mut sums, mut next) = ([0u32; MAX_PIXELS / 2], [0u32; MAX_PIXELS / 4]);
    let pairs = light.as_chunks::<2>().0;
    *peaks.first_mut()? = sweep(pairs, &mut sums);
    let mut blocks = pairs.len();
    for (block_log2, peak) in peaks.iter_mut().enumerate().skip(1) {
        if (16..=MEDIAN_BLOCKS).contains(&blocks) {
            level = median_level(sums.get(..blocks)?, block_log2 as u32);
        }
        *peak = sweep(sums.get(..blocks)?.as_chunks::<2>().0, &mut next);
        blocks /= 2;
        sums.get_mut(..blocks)?.copy_from_slice(next.get(..blocks)?);
    }
    Some((peaks, level?))
}

/// Runs [1 2 1] over the values, which come in pairs, and puts each pair's sum into `sums`.
fn sweep<T: Copy + Into<u32>>(pairs: &[[T; 2]], sums: &mut [u32]) -> Peak {
    let mut peak = Peak::default();
    // The first pair starts the first kernel.
    let (Some((&[a, b], pairs)), Some((sum, sums))) = (pairs.split_first(), sums.split_first_mut())
    else {
        return peak;
    };
    let (mut last, mut last_two): (u32, u32) = (b.into(), a.into() + b.into());
    *sum = last_two;
    for (part, (pairs, sums)) in pairs.chunks(PART).zip(sums.chunks_mut(PART)).enumerate() {
        let mut highest = 0;
        for (&[a, b], sum) in pairs.iter().zip(sums) {
            // Sums of at most 128 pixels of 12 bits: four of them stay below 2^21.
            let (a, b) = (a.into(), b.into());
            let (to_a, to_b) = (last + a, a + b);
            // The kernel with its last block at a gives last_two + to_a, and at b to_a + to_b.
            highest = highest.max(to_a + last_two.max(to_b));
            *sum = to_b;
            (last, last_two) = (b, to_b);
        }
        if highest > peak.response {
            peak = Peak {
                part,
                response: highest,
            };
        }
    }
    peak
}

/// Index of the kernel's middle block where it has this response in this part.
fn locate(light: &[u16], block_log2: u32, peak: Peak) -> usize {
    // Each part is two blocks late, because the first pair is in none.
    let before = 2 * PART * peak.part;
    let sums = light
        .chunks_exact(1 << block_log2)
        .map(|block| block.iter().map(|&count| u32::from(count)).sum::<u32>())
        .skip(before);
    let (mut last, mut last_two) = (0, 0);
    for (i, sum) in sums.enumerate() {
        let two = last + sum;
        if i >= 2 && last_two + two == peak.response {
            return before + i - 1;
        }
        (last, last_two) = (sum, two);
    }
    before
}

/// A peak above the background.
struct Candidate {
    block_log2: u32,
    peak: Peak,
    /// Response above the background, Q24.8 counts.
    response: i32,
    /// response^2 / block size: comparable between block sizes, and with the noise's variance.
    significance: u64,
}

impl Candidate {
    fn new(peak: Peak, block_log2: u32, level: Counts) -> Self {
        // A response is at most 4 * 128 * 4095 < 2^21 counts, and so is the background under it: both fit in Q8.
        let response =
            (peak.response << Counts::FRACTION) as i32 - ((level.to_bits() * 4) << block_log2);
        let response = response.max(0);
        let significance = square(response.unsigned_abs()) >> block_log2;
        Self {
            block_log2,
            peak,
            response,
            significance,
        }
    }

    /// The kernel weighs blocks by 1 + 2 + 1; its response over that is the height of a spot much wider than the kernel, and
    /// less than that of others.
    fn height(&self) -> Counts {
        Counts::from_bits(self.response >> (2 + self.block_log2))
    }

    fn centre(&self, light: &[u16]) -> usize {
        let block = locate(light, self.block_log2, self.peak);
        (block << self.block_log2) + ((1usize << self.block_log2) / 2)
    }
}

/// Most blocks of a median.
const MEDIAN_BLOCKS: usize = 32;

/// The median of the blocks' means.
fn median_level(sums: &[u32], block_log2: u32) -> Option<Counts> {
    let mut sums: Vec<u32, MEDIAN_BLOCKS> = Vec::from_slice(sums).ok()?;
    let sum = median(&mut sums)?;
    // At most 128 pixels of 12 bits in Q8: below 2^27.
    Some(Counts::from_bits(
        ((sum << Counts::FRACTION) >> block_log2) as i32,
    ))
}

/// The noise of a pixel, as the median over parts of the row of the mean absolute difference of neighbours, which is
/// sigma 2/sqrt(pi) for white noise.
fn noise(light: &[u16]) -> Option<Counts> {
    let mut noises: Vec<u32, MEDIAN_BLOCKS> = Vec::new();
    let part = light.len().div_ceil(MEDIAN_BLOCKS).max(8);
    for pixels in light.chunks_exact(part) {
        // Two pixels in four are enough: on a row of 3648 the noise is then known to 3 %.
        let fours = pixels.as_chunks::<4>().0;
        // At most 32 steps of 12 bits: below 2^17, and in Q8 below 2^25.
        let steps: u32 = fours
            .iter()
            .map(|[a, b, ..]| u32::from(a.abs_diff(*b)))
            .sum();
        // There are 32 parts at most, and two steps in each at least.
        let _ = noises.push((steps << Counts::FRACTION) / fours.len() as u32);
    }
    // sqrt(pi)/2 = 0.886227 as 58080/65536; a mean step is below 2^20 in Q8.
    let noise = (u64::from(median(&mut noises)?) * 58_080) >> 16;
    /// 1/sqrt(12) of a count in Q8.
    const ROUNDING: i32 = 74;
    Some(Counts::from_bits((noise as i32).max(ROUNDING)))
}

fn median(values: &mut Vec<u32, MEDIAN_BLOCKS>) -> Option<u32> {
    values.sort_unstable();
    values.get(values.len() / 2).copied()
}

const _: () =
    assert!((4 * LARGEST_COUNT as u64) << (LARGEST_BLOCK_LOG2 + Counts::FRACTION) < 1 << 31);
