//! Where the spot is, to a pixel, and how wide, to a factor of two.
//!
//! First come the level and the noise of the row's own background, as medians over blocks of pixels, so that
//! a spot that fills less than half of the row does not count. Then the kernel [1 2 1] runs over the pixels,
//! over sums of 2 pixels, of 4, 8 ... 128. For a gaussian whose width is 0.9 of a block that kernel gathers
//! 89 to 97 % of the signal-to-noise ratio of the best filter, as it lies on the blocks, and 84 % or more for
//! the widths between. The spot is where the response stands highest above its own noise. A background that
//! rises along the row and would hide the spot is subtracted first (`tilt`). Last, the search tests whether
//! the light is two spots (`second_spot`).
//!
//! All in integers, and all from differences of counts: adding a constant to a row changes nothing.

mod second_spot;
mod sweep;
mod tilt;

use heapless::Vec;

use crate::fault::Fault;
use crate::numeric;
use crate::row::{Geometry, LARGEST_COUNT, MAX_PIXELS, Row};
pub(crate) use crate::spot::sweep::sum_of_blocks;
use crate::spot::sweep::{BLOCK_LOG2, Sweep};
use crate::spot::tilt::Tilt;
use crate::units::{Counts, Pixels};

/// The shortest row that is searched, in pixels of its light range.
pub const MIN_PIXELS: usize = 32;

/// The largest block has 2^7 = 128 pixels, for widths up to 130 pixels.
const LARGEST_BLOCK_LOG2: u32 = 7;

/// A response this far above its noise is a spot, in halves of a standard deviation. At 4.5 a spot of 1.5
/// pixels' width and a peak of five times the noise is missed once in some thousand rows, and noise alone
/// gets there in one row of forty. Those rows end as too dim: see the estimator.
const DETECTION: u16 = 9;

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
    /// What the centroid subtracts: the background's level, unless the [`measurement`](crate::measurement)
    /// chooses another.
    pub black_level: Counts,
}

/// What the row reads away from the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background {
    /// Its level.
    pub level: Counts,
    /// Standard deviation of a pixel, at least that of rounding to a count (1/sqrt(12)).
    pub noise: Counts,
}

impl Background {
    /// The level in the bits of [`Counts`], within what a row can hold: 0 to 4095 * 2^8 < 2^20.
    pub fn level_bits(&self) -> i32 {
        level_bits(self.level)
    }

    /// The variance of an unlit pixel in counts squared, rounding included, and the shot noise's variance for
    /// each count of light.
    pub fn variances(&self, geometry: &Geometry) -> (f32, f32) {
        let noise = self.noise.to_f32();
        let shot = f32::from(geometry.shot_variance_per_count_q16) / 65536.0;
        (noise * noise, shot)
    }
}

/// A level in the bits of [`Counts`], within what a row can hold.
fn level_bits(level: Counts) -> i32 {
    const LARGEST: i32 = (LARGEST_COUNT as i32) << Counts::FRACTION;
    level.to_bits().clamp(0, LARGEST)
}

impl Spot {
    /// The black level in the bits of [`Counts`], within what a row can hold.
    pub fn black_level_bits(&self) -> i32 {
        level_bits(self.black_level)
    }

    /// A height above the background as one above the black level.
    pub const fn above_black(&self, height: Counts) -> Counts {
        let above = height
            .to_bits()
            .saturating_add(self.background.level.to_bits());
        Counts::from_bits(above.saturating_sub(self.black_level.to_bits()))
    }

    /// The fault of a candidate that does not have the shape of a spot.
    pub const fn no_spot(&self) -> Fault {
        Fault::NoSpot {
            amplitude: self.height,
        }
    }
}

/// Finds the spot.
///
/// # Errors
/// [`Fault::NoSpot`] where nothing stands out, or the row is shorter than [`MIN_PIXELS`].
/// [`Fault::TwoSpots`] where two spots stand out, and their heights do not tell which is the laser's.
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
    match search(light, false)? {
        Found::Spot(spot) => Ok(spot),
        Found::Tilt(tilt) => search_level(light, tilt),
    }
}

/// What a search ends with.
enum Found {
    Spot(Spot),
    /// The background rises along the row by so much that the row is to be searched without its tilt.
    Tilt(Tilt),
}

/// Searches a row. `is_level` says that its tilt was subtracted.
// Not inlined: the stack holds the sums of one search at a time.
#[inline(never)]
fn search(light: &[u16], is_level: bool) -> Result<Found, Fault> {
    let no_spot = Fault::NoSpot {
        amplitude: Counts::from_int(0),
    };
    let mut memory = Memory::default();
    let sums = Sums::new(light, &mut memory).ok_or(no_spot)?;
    let (level, tilt) = sums.background().ok_or(no_spot)?;
    let noise = noise(light).ok_or(no_spot)?;
    let candidates = || (0..SIZES as u32).filter_map(|log2| Candidate::new(&sums, log2, level));
    let mut best = (candidates().max_by_key(|candidate| candidate.significance)).ok_or(no_spot)?;
    if best.block_log2 == 0 && best.is_one_pixel(&sums, level) {
        // A hot one. In larger blocks what it hides may stand out.
        best = candidates()
            .filter(|candidate| !candidate.is_one_pixel(&sums, level))
            .max_by_key(|candidate| candidate.significance)
            .ok_or(no_spot)?;
    }
    if !is_level && tilt.matters(light, best.height(), noise) {
        return Ok(Found::Tilt(tilt));
    }
    if best.significance < needed(DETECTION, noise) {
        return Err(Fault::NoSpot {
            amplitude: best.height(),
        });
    }
    let block = sums.highest(best.block_log2).ok_or(no_spot)?;
    let spot = Spot {
        centre: middle(block, best.block_log2),
        block_log2: best.block_log2,
        height: best.height(),
        background: Background { level, noise },
        black_level: level,
    };
    second_spot::check(&sums, spot).map(Found::Spot)
}

/// Searches a row without its tilt, and adds the tilt at the spot to the background's level.
#[cold]
#[inline(never)]
fn search_level(light: &[u16], tilt: Tilt) -> Result<Spot, Fault> {
    let mut level: Vec<u16, MAX_PIXELS> = Vec::new();
    // A row has no more pixels than that.
    let (lowest, above) = tilt.taken_off(light);
    for count in above {
        let _ = level.push(count);
    }
    match search(&level, true)? {
        Found::Spot(spot) => {
            let level = Counts::from_bits(
                (spot.background.level.to_bits())
                    .saturating_add(lowest.saturating_mul(1 << Counts::FRACTION))
                    .saturating_add(tilt.at(light, spot.centre)),
            );
            Ok(Spot {
                background: Background {
                    level,
                    ..spot.background
                },
                black_level: level,
                ..spot
            })
        }
        // A tilt is taken off once.
        Found::Tilt(_) => Err(Fault::NoSpot {
            amplitude: Counts::from_int(0),
        }),
    }
}

/// Finds the spot again in the next row, with a tenth of the work: in blocks of 8 pixels or more, a multiple
/// that fits the width of the spot before, and above the background and the noise before. [`find`] searches
/// the row instead if the spot is narrower, has moved by more than its width and a block, or is on another
/// background. If the light changed all at once, so did the noise, and noise might pass for a spot above the
/// old background.
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
    let sweep = Sweep::new(light.as_chunks().0, block_log2 - BLOCK_LOG2);
    let level = Counts::from_bits(before.background.level_bits());
    let background = under_the_kernel(level, block_log2);
    let above = |response: u32| in_q8(response).saturating_sub(background).max(0);
    // A response like the peak's has two thirds of it: see `second_spot::is_alike`. Below 2^30 and 2^31.
    let least_like = |peak: u32| {
        (numeric::add_i32(background, above(peak) / 3 * 2).max(0) >> Counts::FRACTION)
            .unsigned_abs()
    };
    let Some(peak) = sweep.peak(least_like) else {
        return find(row);
    };
    let response = above(peak.response);
    let significance = square(response.unsigned_abs()) >> block_log2;
    let block = 1usize << block_log2;
    let centre = middle(peak.group, block_log2);
    // At least three quarters of a block, by which the block was chosen, so not negative.
    let width = (width.to_bits() >> Pixels::FRACTION) as usize;
    // What is left of a spot that went away is not looked for in noise; and rows without change tell that no
    // sensor is there.
    if significance < needed(DETECTION, before.background.noise)
        || centre.abs_diff(before.centre) > width + block
        || is_on_another(background, response, background_beside(&sweep, peak.group))
        || peak.has_another
    {
        return find(row);
    }
    Ok(Spot {
        centre,
        block_log2,
        height: height(response, block_log2),
        background: before.background,
        black_level: before.background.level,
    })
}

/// Whether the background beside the spot differs from the one it had by more than a quarter of the spot's
/// response; all as the kernel weighs them, in Q24.8 counts. Less changes no centre of a phase table: a
/// quarter of a response does not pass for the whole. The centroid, which subtracts the level, is off by
/// that.
fn is_on_another(background: i32, response: i32, beside: Option<i32>) -> bool {
    beside.is_none_or(|beside| beside.abs_diff(background) > response.unsigned_abs() / 4)
}

/// Groups of blocks from the spot's to those beside it. A group has 2/3 to 4/3 of the width: their nearest
/// pixels are 2.7 widths from the centre, where a gaussian has 3 % of its height left.
const BESIDE: usize = 5;

/// The background to the left and right of a group, as the kernel [1 2 1] weighs it, in Q24.8 counts. `None`
/// where the row has neither.
fn background_beside(sweep: &Sweep<'_>, group: usize) -> Option<i32> {
    let left = (group.checked_sub(BESIDE)).and_then(|group| sweep.sum(group));
    let right = sweep.sum(group.saturating_add(BESIDE));
    let both = numeric::add_u32(left.or(right)?, right.or(left)?);
    // Twice two groups of at most 128 pixels, like a response.
    Some(in_q8(numeric::add_u32(both, both)))
}

/// The significance of a response so many halves of a standard deviation above the background. The kernel's
/// noise is (1 + 4 + 1) * 2^block_log2 pixels' variance; Q8 counts squared: noise < 2^20, so below 2^50.
fn needed(halves: u16, noise: Counts) -> u64 {
    let halves = u64::from(halves);
    square(noise.to_bits().unsigned_abs()).saturating_mul(6 * halves * halves) / 4
}

fn square(value: u32) -> u64 {
    u64::from(value) * u64::from(value)
}

/// Number of block sizes: 1, 2, 4 ... 128 pixels.
const SIZES: usize = LARGEST_BLOCK_LOG2 as usize + 1;

/// Pairs of blocks in a part. Noting how high the response gets in each part, and not where, halves the
/// search's cost; [`Sums::highest`] then searches the winner's part alone.
const PART: usize = 16;

/// Parts of all block sizes: of 2048 pairs of pixels 128, half of that of the pairs of twice the size, and so
/// on.
const PARTS: usize = MAX_PIXELS / PART;

/// What a search keeps of a row.
struct Memory {
    /// Of 4096 pixels: 2048 blocks of two, 1024 of four, and so on.
    sums: [u32; MAX_PIXELS],
    parts: [u32; PARTS],
}

impl Default for Memory {
    fn default() -> Self {
        Self {
            sums: [0; MAX_PIXELS],
            parts: [0; PARTS],
        }
    }
}

/// The sums over blocks of all sizes, and how high the kernel's response gets, background included.
struct Sums<'a> {
    light: &'a [u16],
    /// Of blocks of 2 pixels, 4, 8 ... 128.
    sums: [&'a [u32]; SIZES - 1],
    /// The highest response in each part, of blocks of 1 pixel, 2, 4 ... 128.
    parts: [&'a [u32]; SIZES],
}

impl<'a> Sums<'a> {
    /// `None` where the row has more than [`MAX_PIXELS`].
    fn new(light: &'a [u16], memory: &'a mut Memory) -> Option<Self> {
        let (mut sums, mut parts) = ([&[][..]; SIZES - 1], [&[][..]; SIZES]);
        let pairs = light.as_chunks::<2>().0;
        let (parts_here, mut parts_left) = memory.parts.split_at_mut_checked(parts_of(pairs))?;
        let (mut blocks, mut left) = memory.sums.split_at_mut_checked(pairs.len())?;
        sweep(pairs, blocks, parts_here);
        *parts.first_mut()? = parts_here;
        for (sums, parts) in sums.iter_mut().zip(parts.iter_mut().skip(1)) {
            let pairs = blocks.as_chunks::<2>().0;
            let (parts_here, parts_after) = parts_left.split_at_mut_checked(parts_of(pairs))?;
            let (next, after) = left.split_at_mut_checked(pairs.len())?;
            sweep(pairs, next, parts_here);
            (*sums, *parts) = (blocks, parts_here);
            (blocks, left, parts_left) = (next, after, parts_after);
        }
        Some(Self { light, sums, parts })
    }

    /// The sum over a block. `None` beside the row.
    #[inline]
    fn block(&self, block_log2: u32, block: usize) -> Option<u32> {
        match (block_log2 as usize).checked_sub(1) {
            None => self.light.get(block).map(|&count| u32::from(count)),
            Some(size) => self.sums.get(size)?.get(block).copied(),
        }
    }

    /// The kernel's response about a block: at most 4 * 128 * 4095 < 2^21. `None` where it reaches over the
    /// row's end.
    #[inline]
    fn response(&self, block_log2: u32, block: usize) -> Option<u32> {
        let left = self.block(block_log2, block.checked_sub(1)?)?;
        let (middle, right) = (
            self.block(block_log2, block)?,
            self.block(block_log2, block.checked_add(1)?)?,
        );
        let twice = numeric::add_u32(middle, middle);
        Some(numeric::add_u32(numeric::add_u32(left, twice), right))
    }

    /// The highest response of each part, and the blocks about which the kernel is in it.
    fn parts(&self, block_log2: u32) -> impl Iterator<Item = (u32, core::ops::Range<usize>)> {
        let parts = self.parts.get(block_log2 as usize).copied();
        // A part begins two blocks late, because the first pair starts the first kernel, whose last block is
        // noted.
        let starts = (0..PARTS).map(|part| 2 * PART * part + 1);
        (parts.unwrap_or_default().iter().copied())
            .zip(starts)
            .map(|(highest, start)| (highest, start..start + 2 * PART))
    }

    /// The first block about which the kernel has its highest response.
    fn highest(&self, block_log2: u32) -> Option<usize> {
        // Of equal ones the first.
        let (response, mut blocks) = (self.parts(block_log2))
            .reduce(|highest, part| if part.0 > highest.0 { part } else { highest })?;
        blocks.find(|&block| self.response(block_log2, block) == Some(response))
    }

    /// Whether one pixel has three quarters of the light about a block: no spot has, whose width is 0.5 or
    /// more.
    fn is_one_pixel(&self, block_log2: u32, block: usize, level: Counts) -> bool {
        let size = 1usize << block_log2.min(LARGEST_BLOCK_LOG2);
        let from = block.saturating_sub(2).saturating_mul(size);
        let to = block
            .saturating_add(3)
            .saturating_mul(size)
            .min(self.light.len());
        let pixels = self.light.get(from..to).unwrap_or_default();
        // At most 640 pixels of 12 bits in Q8: below 2^30.
        let above = |count: u16| {
            (i32::from(count) * (1 << Counts::FRACTION)).saturating_sub(level.to_bits())
        };
        let light = pixels
            .iter()
            .fold(0, |sum, &count| numeric::add_i32(sum, above(count)));
        let highest = pixels.iter().map(|&count| above(count)).max();
        highest.is_some_and(|highest| highest / 3 > light / 4)
    }

    /// The background's level, and its tilt: medians over the largest blocks of which the row has 16.
    fn background(&self) -> Option<(Counts, Tilt)> {
        let (block_log2, sums) = (1..SIZES as u32)
            .zip(self.sums)
            .take_while(|(_, sums)| sums.len() >= 16)
            .last()?;
        let mut values: Vec<u32, MEDIAN_BLOCKS> = Vec::from_slice(sums).ok()?;
        let sum = median(&mut values)?;
        let level = Counts::from_bits(in_q8(sum) >> block_log2);
        Some((level, Tilt::of(sums, block_log2)?))
    }
}

/// Parts of so many pairs: the first pair is in none.
fn parts_of<T>(pairs: &[[T; 2]]) -> usize {
    pairs.len().saturating_sub(1).div_ceil(PART)
}

/// Runs [1 2 1] over the values, which come in pairs; puts each pair's sum into `sums`, and the highest
/// response of each part into `parts`.
fn sweep<T: Copy + Into<u32>>(pairs: &[[T; 2]], sums: &mut [u32], parts: &mut [u32]) {
    // The first pair starts the first kernel.
    let (Some((&[a, b], pairs)), Some((sum, sums))) = (pairs.split_first(), sums.split_first_mut())
    else {
        return;
    };
    let (mut last, mut last_two): (u32, u32) = (b.into(), numeric::add_u32(a.into(), b.into()));
    *sum = last_two;
    for ((pairs, sums), part) in pairs.chunks(PART).zip(sums.chunks_mut(PART)).zip(parts) {
        let mut highest = 0;
        for (&[a, b], sum) in pairs.iter().zip(sums) {
            // Sums of at most 128 pixels of 12 bits: four of them stay below 2^21.
            let (a, b) = (a.into(), b.into());
            let (to_a, to_b) = (numeric::add_u32(last, a), numeric::add_u32(a, b));
            // The kernel with its last block at a gives last_two + to_a, and at b to_a + to_b.
            highest = highest.max(numeric::add_u32(to_a, last_two.max(to_b)));
            *sum = to_b;
            (last, last_two) = (b, to_b);
        }
        *part = highest;
    }
}

/// A peak above the background.
struct Candidate {
    block_log2: u32,
    /// Response above the background, Q24.8 counts.
    response: i32,
    /// response^2 / block size: comparable between block sizes, and with the noise's variance.
    significance: u64,
}

impl Candidate {
    fn new(sums: &Sums<'_>, block_log2: u32, level: Counts) -> Option<Self> {
        let highest = sums.parts(block_log2).map(|(response, _)| response).max()?;
        let response = above(highest, block_log2, level).max(0);
        let significance = square(response.unsigned_abs()) >> block_log2;
        Some(Self {
            block_log2,
            response,
            significance,
        })
    }

    fn is_one_pixel(&self, sums: &Sums<'_>, level: Counts) -> bool {
        let block = sums.highest(self.block_log2);
        block.is_some_and(|block| sums.is_one_pixel(self.block_log2, block, level))
    }

    /// The kernel weighs blocks by 1 + 2 + 1; its response over that is the height of a spot much wider than
    /// the kernel, and less than that of others.
    fn height(&self) -> Counts {
        height(self.response, self.block_log2)
    }
}

/// See [`Candidate::height`].
fn height(response: i32, block_log2: u32) -> Counts {
    Counts::from_bits(response >> (2 + block_log2.min(LARGEST_BLOCK_LOG2)))
}

/// A response above the background, in Q24.8 counts.
fn above(response: u32, block_log2: u32, level: Counts) -> i32 {
    in_q8(response).saturating_sub(under_the_kernel(level, block_log2))
}

/// The kernel's response to the background alone, in Q24.8 counts.
fn under_the_kernel(level: Counts, block_log2: u32) -> i32 {
    level
        .to_bits()
        .saturating_mul(4 << block_log2.min(LARGEST_BLOCK_LOG2))
}

/// A response, or less, in Q24.8 counts.
fn in_q8(response: u32) -> i32 {
    numeric::mul_i32(response as i32, 1 << Counts::FRACTION)
}

/// The pixel to the right of a block's middle.
fn middle(block: usize, block_log2: u32) -> usize {
    let size = 1usize << block_log2.min(LARGEST_BLOCK_LOG2);
    block.saturating_mul(size).saturating_add(size / 2)
}

/// Most blocks of a median.
const MEDIAN_BLOCKS: usize = 32;

/// The noise of a pixel, as the median over parts of the row of the mean absolute difference of neighbours,
/// which is sigma 2/sqrt(pi) for white noise.
fn noise(light: &[u16]) -> Option<Counts> {
    let mut noises: Vec<u32, MEDIAN_BLOCKS> = Vec::new();
    let part = light.len().div_ceil(MEDIAN_BLOCKS).max(8);
    for pixels in light.chunks_exact(part) {
        // Two pixels in four are enough: on a row of 3648 the noise is then known to 3 %.
        let fours = pixels.as_chunks::<4>().0;
        // At most 32 steps of 12 bits: below 2^17, and in Q8 below 2^25.
        let steps = fours.iter().fold(0, |sum, [a, b, ..]| {
            numeric::add_u32(sum, u32::from(a.abs_diff(*b)))
        });
        // There are 32 parts at most, and two steps in each at least.
        let mean = (in_q8(steps) as u32).checked_div(fours.len() as u32)?;
        let _ = noises.push(mean);
    }
    // sqrt(pi)/2 = 0.886227 as 58080/65536; a mean step is below 2^20 in Q8.
    let noise = (u64::from(median(&mut noises)?) * 58_080) >> 16;
    /// 1/sqrt(12) of a count in Q8.
    const ROUNDING: i32 = 74;
    Some(Counts::from_bits((noise as i32).max(ROUNDING)))
}

/// The median, of an even number the upper one of the middle two.
fn median<T: Copy + Ord>(values: &mut [T]) -> Option<T> {
    // By insertion, which is quick for so few; the library's sorts have a panic for values that they cannot
    // order.
    for end in 1..values.len() {
        let mut sorted = values.get_mut(..=end)?;
        while let Some((last, before)) = sorted.split_last_mut()
            && let Some(previous) = before.last_mut()
            && *last < *previous
        {
            core::mem::swap(last, previous);
            sorted = before;
        }
    }
    values.get(values.len() / 2).copied()
}

// A response, 1 + 2 + 1 of the largest blocks, fits in Q8.
const _: () =
    assert!((4 * LARGEST_COUNT as u64) << (LARGEST_BLOCK_LOG2 + Counts::FRACTION) < 1 << 31);
// So do the steps between neighbours in a 32nd of a row, of which every fourth counts, and five of the
// largest blocks.
const _: () = assert!(
    LARGEST_COUNT as u64 * (MAX_PIXELS / MEDIAN_BLOCKS / 4) as u64 * (1 << Counts::FRACTION)
        < 1 << 31
);
const _: () =
    assert!((5 * LARGEST_COUNT as u64) << (LARGEST_BLOCK_LOG2 + Counts::FRACTION) < 1 << 31);
