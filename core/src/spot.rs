//! Finds the spot on a row: its place to a pixel, its width to a factor of two.
//!
//! First the search takes the level and the noise of the row's own background. Both are medians over blocks
//! of pixels, so a spot that fills less than half of the row does not change them. Then the kernel [1 2 1]
//! runs over the pixels, and over sums of 2, 4, 8 ... 128 pixels. A gaussian whose width is 0.9 of a block
//! gives that kernel 89 to 97 % of the signal-to-noise ratio of the best filter, depending on how it lies on
//! the blocks. Widths between two block sizes give 84 % or more. The spot is where the response stands
//! highest above its own noise. A background that rises along the row and would hide the spot is subtracted
//! first (`tilt`). If the highest response is that of light too wide for a spot, the search compares each
//! place with the light beside it (`narrow`). Last, the search tests whether the light is two spots
//! (`second_spot`).
//!
//! All sums are integers, and all results come from differences of counts: adding a constant to a row changes
//! nothing.

mod narrow;
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

/// The least response of a spot, in halves of a standard deviation of its noise. At 4.5 standard deviations
/// the search misses a spot of 1.5 pixels' width with a peak of five times the noise once in some thousand
/// rows. Noise alone gets there in one row of forty: the estimator rejects those rows as too dim.
const DETECTION: u16 = 9;

/// A candidate for the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    /// The pixel nearest to the spot's middle, to half a block.
    pub centre: usize,
    /// The spot's width is about 2^`block_log2` pixels, within a factor of about two.
    pub block_log2: u32,
    /// The spot's rough height above the background: the mean over the kernel's pixels.
    pub height: Counts,
    /// Level and noise of the row away from the spot.
    pub background: Background,
    /// The level that the centroid subtracts: that of the background, unless the
    /// [`measurement`](crate::measurement) chooses another.
    pub black_level: Counts,
}

/// Level and noise of a row away from the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background {
    /// The counts of an unlit pixel.
    pub level: Counts,
    /// Standard deviation of an unlit pixel. At least that of rounding to a count, 1/sqrt(12).
    pub noise: Counts,
}

impl Background {
    /// The level in the bits of [`Counts`], limited to what a row can hold: 0 to 4095 * 2^8 < 2^20.
    pub fn level_bits(&self) -> i32 {
        level_bits(self.level)
    }

    /// Two variances in counts squared: of an unlit pixel, rounding included, and of the shot noise for each
    /// count of light.
    pub fn variances(&self, geometry: &Geometry) -> (f32, f32) {
        let noise = self.noise.to_f32();
        let shot = f32::from(geometry.shot_variance_per_count_q16) / 65536.0;
        (noise * noise, shot)
    }
}

/// A level in the bits of [`Counts`], limited to what a row can hold.
fn level_bits(level: Counts) -> i32 {
    const LARGEST: i32 = (LARGEST_COUNT as i32) << Counts::FRACTION;
    level.to_bits().clamp(0, LARGEST)
}

impl Spot {
    /// The black level in the bits of [`Counts`], limited to what a row can hold.
    pub fn black_level_bits(&self) -> i32 {
        level_bits(self.black_level)
    }

    /// Converts a height above the background to a height above the black level.
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
/// [`Fault::NoSpot`] if nothing stands out, or the row is shorter than [`MIN_PIXELS`]. [`Fault::TwoSpots`] if
/// two spots stand out and their heights do not tell which is the laser's. [`Fault::SensorSilent`] if all
/// pixels read the same, which the noise of a sensor never allows.
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

/// The result of a search.
enum Found {
    Spot(Spot),
    /// The background rises so much along the row that it may hide the spot: search the row again without
    /// this tilt.
    Tilt(Tilt),
}

/// Searches a row. `is_level`: its tilt is already subtracted.
// Not inlined, so that the stack holds the sums of only one search at a time.
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
        // The highest response is that of a hot pixel. Larger blocks may show the spot that it hides.
        best = candidates()
            .filter(|candidate| !candidate.is_one_pixel(&sums, level))
            .max_by_key(|candidate| candidate.significance)
            .ok_or(no_spot)?;
    }
    if !is_level && tilt.may_hide(light, best.height(), noise) {
        return Ok(Found::Tilt(tilt));
    }
    let is_dim = best.significance < needed(narrow::LEAST_CONTRAST, noise);
    let may_hide_another =
        best.is_too_wide(&sums, level) || is_dim && sums.has_darker_background(level, noise);
    if may_hide_another && let Some(found) = narrow::find(&sums, noise) {
        return found.map(Found::Spot);
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
    let mut untilted: Vec<u16, MAX_PIXELS> = Vec::from_slice(light).map_err(|_| Fault::NoSpot {
        amplitude: Counts::from_int(0),
    })?;
    let lowest = tilt.subtract_from(&mut untilted);
    match search(&untilted, true)? {
        Found::Spot(spot) => {
            let level = Counts::from_bits(
                (spot.background.level.to_bits())
                    .saturating_add(lowest.saturating_mul(1 << Counts::FRACTION))
                    .saturating_add(tilt.height_at(light, spot.centre)),
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
        // A tilt is subtracted only once.
        Found::Tilt(_) => Err(Fault::NoSpot {
            amplitude: Counts::from_int(0),
        }),
    }
}

/// Finds the spot again in the next row, with a tenth of the work of [`find`]. Uses blocks of 8 pixels or
/// more that fit the width of the spot before, and the background and the noise of the row before. Calls
/// [`find`] instead if the spot is narrower, has moved by more than its width and a block, or is on another
/// background: a sudden change of light changes the noise too, and noise might then pass for a spot above the
/// old background.
///
/// # Errors
/// As [`find`].
pub fn find_again(row: &Row<'_>, before: &Spot, width: Pixels) -> Result<Spot, Fault> {
    let light = row.light();
    // The kernel fits a width of 0.9 of its block best, and widths of 0.75 or 1.5 nearly as well.
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
    // Another spot has two thirds of the peak's response or more: see `second_spot::has_similar_height`.
    // Both terms are below 2^29.
    let least_similar = |peak: u32| {
        (numeric::add_i32(background, above(peak) / 3 * 2).max(0) >> Counts::FRACTION)
            .unsigned_abs()
    };
    let Some(peak) = sweep.peak(least_similar) else {
        return find(row);
    };
    let response = above(peak.response);
    let significance = square(response.unsigned_abs()) >> block_log2;
    let block = 1usize << block_log2;
    let centre = middle(peak.group, block_log2);
    // Not negative: the width is at least three quarters of the block that was chosen for it.
    let width = (width.to_bits() >> Pixels::FRACTION) as usize;
    // [`find`] tells whether a weak response is only noise, because the spot is gone, and whether the sensor
    // is silent, because no pixel changes.
    if significance < needed(DETECTION, before.background.noise)
        || centre.abs_diff(before.centre) > width + block
        || has_background_changed(background, response, background_beside(&sweep, peak.group))
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

/// The background to the left and right of a group, as a response of the kernel [1 2 1], in Q24.8 counts.
/// Where the row has one side only, that side counts twice. `None` where the row has neither.
fn background_beside(sweep: &Sweep<'_>, group: usize) -> Option<i32> {
    let left = (group.checked_sub(GROUPS_TO_BACKGROUND)).and_then(|group| sweep.sum(group));
    let right = sweep.sum(group.saturating_add(GROUPS_TO_BACKGROUND));
    let both = numeric::add_u32(left.or(right)?, right.or(left)?);
    // Twice two groups of at most 128 pixels: as much as a response.
    Some(in_q8(numeric::add_u32(both, both)))
}

/// The significance of a response that is `halves` halves of a standard deviation above the background. The
/// kernel's noise is the variance of (1 + 4 + 1) * 2^block_log2 pixels. Q8 counts squared: noise < 2^20, so
/// below 2^50.
fn needed(halves: u16, noise: Counts) -> u64 {
    let halves = u64::from(halves);
    square(noise.to_bits().unsigned_abs()).saturating_mul(6 * halves * halves) / 4
}

fn square(value: u32) -> u64 {
    u64::from(value) * u64::from(value)
}

/// Number of block sizes: 1, 2, 4 ... 128 pixels.
const SIZES: usize = LARGEST_BLOCK_LOG2 as usize + 1;

/// Pairs of blocks in a part. The sweep keeps only the highest response of each part, which halves its cost.
/// [`Sums::highest`] then searches the best part for the place.
const PART: usize = 16;

/// Parts of all block sizes together: 128 for the 2048 pairs of pixels, half as many for each further size.
const PARTS: usize = MAX_PIXELS / PART;

/// What a search computes from a row.
struct Memory {
    /// For 4096 pixels: 2048 sums of two pixels, 1024 of four, and so on.
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

/// The sums over blocks of all sizes, and the highest responses of the kernel, background included.
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

    /// The sum over a block. `None` off the row.
    #[inline]
    fn block(&self, block_log2: u32, block: usize) -> Option<u32> {
        match (block_log2 as usize).checked_sub(1) {
            None => self.light.get(block).map(|&count| u32::from(count)),
            Some(size) => self.sums.get(size)?.get(block).copied(),
        }
    }

    /// The kernel's response with its middle on a block: at most 4 * 128 * 4095 < 2^21. `None` where the
    /// kernel reaches over the row's end.
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

    /// The highest response of each part, and the blocks on which the kernel's middle lies there.
    fn parts(&self, block_log2: u32) -> impl Iterator<Item = (u32, core::ops::Range<usize>)> {
        let parts = self.parts.get(block_log2 as usize).copied();
        // A part holds the kernels whose last block is in it. The first pair of blocks only starts the first
        // kernel, so the first middle is block 1.
        let starts = (0..PARTS).map(|part| 2 * PART * part + 1);
        (parts.unwrap_or_default().iter().copied())
            .zip(starts)
            .map(|(highest, start)| (highest, start..start + 2 * PART))
    }

    /// The block on which the kernel's middle has its highest response; of equal ones, the first.
    fn highest(&self, block_log2: u32) -> Option<usize> {
        // Not `>=`: of equal parts the first.
        let (response, mut blocks) = (self.parts(block_log2))
            .reduce(|highest, part| if part.0 > highest.0 { part } else { highest })?;
        blocks.find(|&block| self.response(block_log2, block) == Some(response))
    }

    /// Whether one pixel has three quarters of the light about a block. No spot has such a pixel: its width
    /// is 0.5 or more.
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

    /// Whether a part of the background is darker than its level by more than a pixel's noise. A spot there
    /// may stand out from the background beside it, and not from the level. (The noise of a block of 128
    /// pixels is an eleventh of a pixel's, so noise alone makes no block so dark.)
    fn has_darker_background(&self, level: Counts, noise: Counts) -> bool {
        level
            .to_bits()
            .saturating_sub(self.darkest(level).to_bits())
            > noise.to_bits()
    }

    /// The level of the darkest block of the largest size, but at most `level`: wide light may raise the
    /// level of most of the row.
    fn darkest(&self, level: Counts) -> Counts {
        let sums = self.sums.last().copied().unwrap_or_default();
        let darkest = sums.iter().min();
        darkest.map_or(level, |&sum| {
            level.min(Counts::from_bits(in_q8(sum) >> LARGEST_BLOCK_LOG2))
        })
    }

    /// The background's level and tilt: medians over blocks of the largest size of which the row has 16 or
    /// more.
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

/// The number of parts for these pairs: the first pair is in no part.
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

/// The highest response of one block size, above the background.
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

    /// Whether the light is wider than a spot can be: three blocks of 128 pixels to the sides there is more
    /// than a fifth of the response left. A gaussian of 170 pixels has 15 to 18 % left, depending on how it
    /// lies on the blocks; one of 200 pixels 23 to 25 %. They are taken above the darkest part of the row,
    /// because wide light raises the level of the rest. Near the row's end, which may cut the light, two
    /// blocks to the other side count.
    fn is_too_wide(&self, sums: &Sums<'_>, level: Counts) -> bool {
        if self.block_log2 != LARGEST_BLOCK_LOG2 {
            return false;
        }
        let level = sums.darkest(level);
        let Some(block) = sums.highest(self.block_log2) else {
            return false;
        };
        let response = |block| {
            let response = sums.response(self.block_log2, block)?;
            Some(above(response, self.block_log2, level))
        };
        let left = |blocks| block.checked_sub(blocks).and_then(response);
        let right = |blocks| response(block.saturating_add(blocks));
        let beside = match (left(3), right(3)) {
            (Some(left), Some(right)) => Some(left.midpoint(right)),
            (None, _) => right(2),
            (_, None) => left(2),
        };
        beside.is_some_and(|beside| beside > self.response / 5)
    }

    /// The height of the spot: the response over the kernel's weight, 1 + 2 + 1 blocks. True for a spot much
    /// wider than the kernel, too low for others.
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

/// Converts a response, or a smaller sum, to Q24.8 counts.
fn in_q8(response: u32) -> i32 {
    numeric::mul_i32(response as i32, 1 << Counts::FRACTION)
}

/// The pixel to the right of a block's middle.
fn middle(block: usize, block_log2: u32) -> usize {
    let size = 1usize << block_log2.min(LARGEST_BLOCK_LOG2);
    block.saturating_mul(size).saturating_add(size / 2)
}

/// The most values of a median.
const MEDIAN_BLOCKS: usize = 32;

/// Estimates the noise of a pixel from the mean absolute difference of neighbours, which is sigma 2/sqrt(pi)
/// for white noise. Takes the median of these means over parts of the row.
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
        // At most 32 parts, each with at least two steps.
        let mean = (in_q8(steps) as u32).checked_div(fours.len() as u32)?;
        let _ = noises.push(mean);
    }
    // sqrt(pi)/2 = 0.886227 as 58080/65536; a mean step is below 2^20 in Q8.
    let noise = (u64::from(median(&mut noises)?) * 58_080) >> 16;
    /// 1/sqrt(12) of a count in Q8.
    const ROUNDING: i32 = 74;
    Some(Counts::from_bits((noise as i32).max(ROUNDING)))
}

/// The median. Of an even number of values, the upper one of the middle two.
fn median<T: Copy + Ord>(values: &mut [T]) -> Option<T> {
    // Insertion sort: quick for so few values. The library's sorts contain a panic, for values without an
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
// The steps between neighbours in a 32nd of a row (one step in four pixels) fit too, and so do five of the
// largest blocks.
const _: () = assert!(
    LARGEST_COUNT as u64 * (MAX_PIXELS / MEDIAN_BLOCKS / 4) as u64 * (1 << Counts::FRACTION)
        < 1 << 31
);
const _: () =
    assert!((5 * LARGEST_COUNT as u64) << (LARGEST_BLOCK_LOG2 + Counts::FRACTION) < 1 << 31);
