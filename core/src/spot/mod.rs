//! Finds the spot on a row: its place to a pixel, its width to a factor of two.
//!
//! First the search takes the level and the noise of the row's own background. Both are medians over blocks
//! of pixels, so a spot that fills less than half of the row does not change them. Then it lists the lights
//! that stand out of what is beside them (`candidates`): first in blocks of 8 pixels and more, and in the
//! pixels near what it found. Only where these leave a doubt, it searches all pixels. The highest candidate
//! is the spot; another one nearly as high is a fault.
//!
//! The row before tells the next row's place and width. [`find_again`] searches the peak of the kernel's
//! responses near that place. On the rest of the row it only tests whether any response is similar to the
//! peak.
//!
//! All sums are integers, and all results come from differences of counts: adding a constant to a row changes
//! nothing.

mod candidates;
pub mod choice;
mod groups;
pub mod region;

use core::ops::Range;

use dual_mac::Pair;
use heapless::Vec;

use crate::base::{Counts, Fault, Pixels, WorkBudget, numeric, order_statistic};
use crate::row::{BLOCK_LOG2, Background, Blocks, LARGEST_COUNT, Light, MAX_PIXELS, Row};
use crate::spot::candidates::{Candidate, Candidates, LARGEST_LOG2, Peak, Peaks};
use crate::spot::groups::Groups;

/// The shortest row that is searched, in pixels of its light range.
pub const MIN_PIXELS: usize = 32;
/// The largest block has 2^7 = 128 pixels, for widths up to 130 pixels.
const LARGEST_BLOCK_LOG2: u32 = LARGEST_LOG2;
/// In blocks of 8 pixels.
const LARGEST_GROUP: usize = 1 << (LARGEST_BLOCK_LOG2 - BLOCK_LOG2);
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

impl Spot {
    pub(crate) const fn block(&self) -> usize {
        match self.block_log2 {
            log2 @ 0..LARGEST_BLOCK_LOG2 => 1 << log2,
            _ => 1 << LARGEST_BLOCK_LOG2,
        }
    }

    /// Converts a height above the background to a height above the black level.
    pub const fn above_black(&self, height: Counts) -> Counts {
        let level = self.background.level.to_bits();
        let above = height.to_bits().saturating_add(level);
        Counts::from_bits(above.saturating_sub(self.black_level.to_bits()))
    }

    /// The fault of a candidate that does not have the shape of a spot.
    pub const fn no_spot(&self) -> Fault {
        Fault::NoSpot {
            amplitude: self.height,
        }
    }
}

/// Finds the spot. Returns it with the row's work budget, of which the search takes units only if it looks at
/// many peaks.
///
/// # Errors
/// [`Fault::NoSpot`] if nothing stands out, or the row is shorter than [`MIN_PIXELS`]. [`Fault::TwoSpots`] if
/// two spots stand out and their heights do not tell which is the laser's. [`Fault::SensorSilent`] if all
/// pixels read the same, which the noise of a sensor never allows.
pub fn find(row: &Row<'_>) -> Result<(Spot, WorkBudget), Fault> {
    let blocks = Blocks::of(row.light());
    find_in(row, blocks.sums())
}

/// As [`find`], with the row's blocks.
pub(crate) fn find_in(row: &Row<'_>, blocks: &[u16]) -> Result<(Spot, WorkBudget), Fault> {
    let light = row.light();
    if light.len() < MIN_PIXELS {
        return Err(NOTHING);
    }
    // The blocks of nearly all rows tell that the sensor is not silent.
    if blocks.iter().all(|sum| Some(sum) == blocks.first())
        && light.iter().all(|count| Some(count) == light.get(0))
    {
        return Err(Fault::SensorSilent);
    }
    let (background, darkest) = background(light, blocks).ok_or(NOTHING)?;
    let peaks = Peaks::of(background, darkest);
    let mut candidates = Candidates::new();
    let mut budget = WorkBudget::of_row();
    let highest = search(light, blocks, peaks, &mut candidates, &mut budget).ok_or(NOTHING)?;
    let candidate = choose(&candidates, light)?;
    // Noise may be as high: the estimator tells.
    match candidate.map(|it| it.sharpest()).or(highest) {
        Some(peak) => Ok((spot_of(&peak, light, background), budget)),
        None => Err(Fault::NoSpot {
            amplitude: candidates::least_height(background.noise),
        }),
    }
}

/// The fault of a row on which nothing stands out.
const NOTHING: Fault = Fault::NoSpot {
    amplitude: Counts::from_bits(0),
};

/// Units of the row's work budget for each peak that the search looks at. A peak takes 760 of the chip's
/// instructions, which are 19 units. With 19, repairs of rows on rough targets have too little left.
const WORK_OF_PEAK: usize = 15;
/// So many are free.
const FEW_PEAKS: usize = 32;

/// On a row of fewer pixels all of them are searched.
const SHORT: usize = 1024;

/// Lists the candidates. Returns the highest peak above the level. `None` if there is more light than a row
/// of spots has.
#[inline(never)]
fn search(
    light: Light<'_>,
    blocks: &[u16],
    mut peaks: Peaks,
    candidates: &mut Candidates,
    budget: &mut WorkBudget,
) -> Option<Option<Peak>> {
    if light.len() >= SHORT {
        peaks.search_blocks(blocks);
        peaks.candidates(candidates);
        if let [only] = candidates.as_slice()
            && only.is_wide_enough()
        {
            // The pixels near it tell whether it is one spot.
            let peak = only.peak;
            let reach = peak.pixels().saturating_mul(NEAR);
            let end = peak
                .middle
                .saturating_add(reach)
                .saturating_add(peak.pixels() / 2);
            if let Some(from) = end.checked_sub(peak.pixels().saturating_mul(2 * NEAR + 1))
                && let Some(near) = light.slice(from..end)
            {
                candidates.clear();
                peaks.search_near(near, from, peak.log2.saturating_sub(FINE_LOG2));
                peaks.candidates(candidates);
                return (!peaks.are_too_many()).then(|| peaks.highest());
            }
        }
    }
    peaks.clear();
    candidates.clear();
    peaks.search_pixels(light);
    peaks.candidates(candidates);
    let paid = peaks.seen().saturating_sub(FEW_PEAKS);
    budget.use_up_to(paid.saturating_mul(WORK_OF_PEAK));
    (!peaks.are_too_many()).then(|| peaks.highest())
}

/// On wider light, blocks of 8 pixels may not show a narrow spot.
const WIDEST_LOG2: u32 = 5;
/// Blocks to either side of a candidate in which its parts are searched: [`Candidate::is_part_of`] takes
/// those within three, and their sides are within one more.
const NEAR: usize = 4;
/// They are searched in blocks of an eighth.
const FINE_LOG2: u32 = 3;

// The widest candidate's part.
const _: () = assert!((2 * NEAR + 1) << WIDEST_LOG2 <= candidates::MOST_NEAR);

impl Candidate {
    /// Whether blocks of 8 pixels are fine enough for a spot so wide. The prominence of a width of 5 pixels
    /// falls by 1.67 from blocks of 8 pixels to those of 16, that of a narrower spot by up to 2.
    fn is_wide_enough(&self) -> bool {
        let Peak {
            log2,
            prominence,
            is_wide,
            ..
        } = self.peak;
        let coarser = u32::from(self.coarser);
        !is_wide
            && log2 <= WIDEST_LOG2
            && (log2 > BLOCK_LOG2 || 7 * coarser >= 4 * u32::from(prominence))
    }
}

/// Lists the candidates of all pixels that may be spots. `None` if the row shows none.
#[cold]
#[inline(never)]
fn list_all(row: &Row<'_>, spots: &mut Candidates) -> Option<()> {
    let light = row.light();
    let (background, darkest) = background(light, Blocks::of(light).sums())?;
    let mut peaks = Peaks::of(background, darkest);
    let mut all = Candidates::new();
    peaks.search_pixels(light);
    peaks.candidates(&mut all);
    list_spots(&all, light, spots);
    Some(())
}

/// Chooses the laser's spot: the highest candidate. `None` if there is none.
///
/// # Errors
/// [`Fault::TwoSpots`] if another one is about as high.
fn choose(all: &Candidates, light: Light<'_>) -> Result<Option<Candidate>, Fault> {
    let mut spots = Candidates::new();
    list_spots(all, light, &mut spots);
    let highest = spots.iter().copied().reduce(|highest, it| {
        // Of two at one place the more significant one counts, unless the other is much higher, or narrower
        // and as significant.
        let is_higher = if it.is_apart(&highest) {
            it.height > highest.height
        } else {
            let [least, other] = [highest, it].map(|it| it.peak.significance);
            4 * u32::from(it.height) > 5 * u32::from(highest.height)
                || it.peak.log2 < highest.peak.log2 && other >= least / 3
        };
        if is_higher { it } else { highest }
    });
    let Some(highest) = highest else {
        return Ok(None);
    };
    let is_other =
        |it: &&Candidate| it.is_apart(&highest) && has_similar_height(it.height, highest.height);
    match spots.iter().find(is_other) {
        Some(other) => Err(two_spots(highest.peak.middle, other.peak.middle)),
        None => Ok(Some(highest)),
    }
}

/// Whether two spots are so alike in height that nothing tells which is the laser's. A second spot of 50 % of
/// the first one's height must not count as alike, one of 80 % must. Blocks measure heights to a tenth, so
/// the limit is two thirds.
fn has_similar_height(height: u16, highest: u16) -> bool {
    3 * u32::from(height) > 2 * u32::from(highest)
}

fn two_spots(centre: usize, other: usize) -> Fault {
    Fault::TwoSpots {
        centre: Pixels::from_int(numeric::to_i32(centre)),
        other: Pixels::from_int(numeric::to_i32(other)),
    }
}

/// The candidates that may be spots: without light that is too wide, without the parts of a spot that speckle
/// breaks, without single pixels beside wider spots.
fn list_spots(all: &Candidates, light: Light<'_>, spots: &mut Candidates) {
    // Two spots together look like a wide one too, which is no part of another.
    let mut leaves = Candidates::new();
    for it in all {
        let is_in = |part: &Candidate| part.is_part_of(it) && !part.is_apart(it);
        if !all.iter().any(is_in) {
            // There is room for all.
            let _ = leaves.push(*it);
        }
    }
    let mut parts: Vec<Parts, { candidates::MOST }> = Vec::new();
    for whole in all {
        // There is room for all.
        let _ = parts.push(Parts::of(whole, &leaves, light));
    }
    let is_spot = |&(candidate, own): &(&Candidate, &Parts)| {
        // What is as significant as the whole is no lump of it.
        let is_lump = all.iter().zip(&parts).any(|(whole, parts)| {
            *parts == Parts::Lumps
                && candidate.is_part_of(whole)
                && candidate.peak.significance < whole.peak.significance
        });
        !candidate.peak.is_wide && !is_lump && *own != Parts::Two
    };
    let kept = || all.iter().zip(&parts).filter(is_spot);
    // Beside a wider spot, a spot of one pixel may be a bad one.
    let is_wide = kept().next().is_some_and(|(it, _)| it.peak.log2 > 2);
    for (candidate, _) in kept().filter(|(it, _)| !is_wide || it.peak.log2 > 0) {
        // There is room for all.
        let _ = spots.push(*candidate);
    }
}

/// What lies within a candidate.
#[derive(Clone, Copy, PartialEq)]
enum Parts {
    /// Nothing, or narrow spots on wide light.
    One,
    /// Two spots, which have nearly all of its light.
    Two,
    /// Lumps: speckle, or a hole in the spot.
    Lumps,
}

impl Parts {
    fn of(whole: &Candidate, leaves: &Candidates, light: Light<'_>) -> Self {
        let parts = || leaves.iter().filter(|it| it.is_part_of(whole));
        let Some(strongest) = parts().max_by_key(|it| it.height) else {
            return Self::One;
        };
        let like = || parts().filter(|it| 4 * u32::from(it.height) > u32::from(strongest.height));
        let number = numeric::count(like().map(|_| true));
        let other = like().find(|it| it.peak.middle != strongest.peak.middle);
        match (number, other) {
            (1, _) => Self::One,
            (2, Some(other)) if whole.is_of_two(strongest, other, light) => Self::Two,
            (2, Some(other)) if [strongest, other].into_iter().all(|it| it.is_fine(whole)) => {
                Self::One
            }
            _ => Self::Lumps,
        }
    }
}

impl Candidate {
    /// Whether it is nothing but two spots: they are far enough from each other for their width, a valley is
    /// between them, and they have seven eighths of the light.
    fn is_of_two(&self, one: &Self, other: &Self, light: Light<'_>) -> bool {
        let (left, right) = (
            one.place().min(other.place()),
            one.place().max(other.place()),
        );
        let apart = right.saturating_sub(left);
        let narrower = one.peak.pixels().min(other.peak.pixels());
        let level = self.peak.base;
        // To three eighths of the lower one. The mean of two neighbours counts, because of dead pixels.
        let lower = u32::from(one.height.min(other.height) / 4).saturating_mul(3);
        let most = numeric::add_u32(2 * u32::from(level), lower) >> candidates::FRACTION;
        let between = light.slice(left..right).unwrap_or_default();
        let mut twos = between.iter().zip(between.iter().skip(1));
        let has_valley = twos.any(|(a, b)| u32::from(a) + u32::from(b) <= most);
        let both = left.saturating_sub(apart / 2)..right.saturating_add(apart / 2);
        let reach = self.peak.pixels().saturating_mul(4);
        let middle = self.peak.middle;
        let all = middle.saturating_sub(reach)..middle.saturating_add(reach);
        let [both, all] = [both, all].map(|it| light_above(light, level, it));
        // Three blocks are 3.5 widths, if a width is 0.86 blocks.
        apart > narrower.saturating_mul(3)
            && has_valley
            && 2 * u32::from(one.height.max(other.height)) >= self.height.into()
            && both.saturating_mul(8) >= all.saturating_mul(7)
    }

    /// Whether it is at another place.
    pub(super) fn is_apart(&self, other: &Self) -> bool {
        let apart = self.peak.middle.abs_diff(other.peak.middle);
        apart > self.peak.pixels().max(other.peak.pixels())
    }

    /// Whether it is narrower than another by at least a factor of eight.
    fn is_fine(&self, whole: &Self) -> bool {
        whole.peak.log2.saturating_sub(self.peak.log2) > 2
    }

    /// Whether it is narrower than another, and within three widths of its middle. What is more than 32 times
    /// as wide is no spot that the narrower one is a part of.
    fn is_part_of(&self, whole: &Self) -> bool {
        let reach = whole.peak.pixels().saturating_mul(11) / 4;
        let finer = whole.peak.log2.saturating_sub(self.peak.log2);
        !whole.peak.is_wide
            && (1..6).contains(&finer)
            && self.peak.middle.abs_diff(whole.peak.middle) <= reach
    }
}

/// The light above a level in some pixels, in 1/16 counts: below 2^29.
fn light_above(light: Light<'_>, level: u16, pixels: Range<usize>) -> i64 {
    let part = light
        .slice(pixels.start..pixels.end.min(light.len()))
        .unwrap_or_default();
    let level = i64::from(level).saturating_mul(numeric::to_i32(part.len()).into());
    i64::from(part.sum())
        .saturating_mul(1 << candidates::FRACTION)
        .saturating_sub(level)
}

/// Makes a spot of a peak. Where the row beside it lies elsewhere than the level, that is its background.
fn spot_of(peak: &Peak, light: Light<'_>, background: Background) -> Spot {
    let beside = in_counts(peak.beside);
    let is_elsewhere = [beside, in_counts(peak.base)].into_iter().all(|side| {
        let apart = side.to_bits().abs_diff(background.level.to_bits());
        apart > in_counts(peak.prominence).to_bits().unsigned_abs() / 8
    });
    let near = || {
        let from = peak.middle.saturating_sub(NOISE_REACH);
        let to = peak.middle.saturating_add(NOISE_REACH).min(light.len());
        noise(&[light.slice(from..to)?])
    };
    let background = if is_elsewhere {
        Background {
            level: beside,
            // Bright light has more noise than the rest of the row.
            noise: near().unwrap_or_default().max(background.noise),
        }
    } else {
        background
    };
    let height = in_counts(peak.top)
        .to_bits()
        .saturating_sub(background.level.to_bits());
    let (centre, block_log2) = nearer_to_the_end(peak, light).unwrap_or((peak.middle, peak.log2));
    Spot {
        centre,
        block_log2,
        height: Counts::from_bits(height),
        background,
        black_level: background.level,
    }
}

/// The place and the block of light that the row's end cuts near its top.
fn nearer_to_the_end(peak: &Peak, light: Light<'_>) -> Option<(usize, u32)> {
    let log2 = peak.log2.checked_sub(1).filter(|_| peak.is_cut)?;
    let half = 1usize.wrapping_shl(log2);
    let is_first = peak.middle < light.len() / 2;
    let from_end = if is_first {
        peak.middle
    } else {
        light.len().saturating_sub(peak.middle)
    };
    if from_end > half.saturating_mul(4) {
        return None;
    }
    // Two blocks at the end, and the two beside them.
    let two = half.saturating_mul(2);
    let (outer, inner) = if is_first {
        (0..two, two..two.saturating_mul(2))
    } else {
        let end = light.len();
        let middle = end.saturating_sub(two);
        (middle..end, middle.saturating_sub(two)..middle)
    };
    let middle = half.saturating_add(half / 2);
    let place = if is_first {
        middle
    } else {
        light.len().saturating_sub(middle)
    };
    let [outer, inner] = [outer, inner].map(|it| light_above(light, peak.beside, it));
    (inner.saturating_mul(3) < outer.saturating_mul(2)).then_some((place, log2))
}

/// A height of a candidate in counts.
fn in_counts(height: u16) -> Counts {
    Counts::from_bits(
        i32::from(height).saturating_mul(1 << (Counts::FRACTION - candidates::FRACTION)),
    )
}

/// Pixels to either side of a spot in which its noise is measured.
const NOISE_REACH: usize = 256;

/// Finds the spot again in the next row, with a tenth of the work of [`find`]. Uses blocks of 8 pixels or
/// more that fit the width of the spot before, and the background and the noise of the row before. Calls
/// `find` instead if the spot is narrower than 4 pixels, has moved by more than its width and a block, or is
/// on another background: a sudden change of light changes the noise too, and noise might then pass for a
/// spot above the old background.
///
/// # Errors
/// As [`find`].
pub fn find_again(
    row: &Row<'_>,
    before: &Spot,
    width: Pixels,
) -> Result<(Spot, WorkBudget), Fault> {
    let blocks = Blocks::of(row.light());
    find_again_in(row, blocks.sums(), before, width)
}

/// As [`find_again`], with the row's blocks.
pub(crate) fn find_again_in(
    row: &Row<'_>,
    blocks: &[u16],
    before: &Spot,
    width: Pixels,
) -> Result<(Spot, WorkBudget), Fault> {
    if width < NARROWEST || row.light().len() < MIN_PIXELS {
        return find_in(row, blocks);
    }
    let reach = spot_reach(width);
    // The kernel fits a width of 0.9 of its block best, and widths of 0.75 or 1.5 nearly as well.
    let block_log2 = (BLOCK_LOG2..=LARGEST_BLOCK_LOG2)
        .take_while(|&log2| width >= Pixels::from_int((3 << log2) / 4))
        .last()
        .unwrap_or(BLOCK_LOG2);
    let groups = Groups {
        blocks,
        log2: block_log2 - BLOCK_LOG2,
    };
    let level = Counts::from_bits(before.background.level_bits());
    let background = under_the_kernel(level, block_log2);
    let above = |response: u32| in_q8(response).saturating_sub(background).max(0);
    let block = 1usize << block_log2;
    // Not negative: the width is at least half of the block that was chosen for it.
    let width = (width.to_bits() >> Pixels::FRACTION).cast_unsigned() as usize;
    let Some(peak) = groups.peak_near(before.centre >> block_log2) else {
        return find_in(row, blocks);
    };
    let response = above(peak.response);
    let significance = square(response.unsigned_abs()) >> block_log2;
    let centre = middle(peak.group, block_log2);
    // Another spot has two thirds of the peak's response or more: see [`has_similar_height`].
    // Both terms are below 2^29.
    let least_similar =
        (numeric::add_i32(background, response / 3 * 2).max(0) >> Counts::FRACTION).unsigned_abs();
    // [`find`] tells whether a weak response is only noise, because the spot is gone, and
    // whether the sensor is silent, because no pixel changes.
    if significance < needed(DETECTION, before.background.noise)
        || centre.abs_diff(before.centre) > width + block
        || has_background_changed(background, response, groups.beside(peak.group))
        || groups.has_another(peak.group, reach, least_similar)
    {
        return find_in(row, blocks);
    }
    let spot = Spot {
        centre,
        block_log2,
        height: height(response, block_log2),
        background: before.background,
        black_level: before.background.level,
    };
    Ok((spot, WorkBudget::of_row()))
}

/// A narrower spot is found by [`find`], in blocks of fewer pixels. With blocks of 8
/// pixels, a spot of this width stands out two thirds as much as with blocks of 4. If it then stands out too
/// little, `find` is called all the same.
const NARROWEST: Pixels = Pixels::from_int(4);

/// Whether the background beside the spot has changed by more than a quarter of the spot's response. All
/// three arguments are responses of the kernel, in Q24.8 counts. A smaller change moves no centre of a phase
/// table, and a quarter of a response does not pass for a whole one. The centroid, which subtracts the level,
/// then subtracts a level that is off by that change.
fn has_background_changed(background: i32, response: i32, beside: Option<i32>) -> bool {
    beside.is_none_or(|beside| beside.abs_diff(background) > response.unsigned_abs() / 4)
}

/// How far a spot reaches, in groups: a response at this distance or nearer belongs to the spot. A spot's
/// width is at most 1.5 groups: at two groups it has a third of its response left. A spot of less than 0.75
/// groups has at most 0.44 of its response left at two groups, if it lies between two groups. Light there is
/// another spot, which may be as near as five widths.
fn spot_reach(width: Pixels) -> usize {
    if width < Pixels::from_int(6) { 1 } else { 2 }
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

fn height(response: i32, block_log2: u32) -> Counts {
    Counts::from_bits(response >> (2 + block_log2.min(LARGEST_BLOCK_LOG2)))
}

/// The kernel's response to the background alone, in Q24.8 counts.
fn under_the_kernel(level: Counts, block_log2: u32) -> i32 {
    (level.to_bits()).saturating_mul(4 << block_log2.min(LARGEST_BLOCK_LOG2))
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

/// The background and where it is darkest. The level is the median over blocks of the largest size of which
/// the row has 16 or more.
#[inline(never)]
fn background(light: Light<'_>, blocks: &[u16]) -> Option<(Background, Counts)> {
    let sizes = 1..=LARGEST_BLOCK_LOG2;
    let log2 = sizes.take_while(|&log2| light.len() >> log2 >= 16).last()?;
    let mut sums: Vec<u32, MEDIAN_BLOCKS> = Vec::new();
    // A row has at most 32 of them.
    if let Some(larger) = log2.checked_sub(BLOCK_LOG2) {
        for group in blocks.chunks_exact(1usize.wrapping_shl(larger).max(1)) {
            let sum = match group {
                &[sum] => sum.into(),
                // 16 sums of 8 counts of 12 bits: each is below 2^15, and all are below 2^19.
                _ => dual_mac::dot(group, &[Pair(1, 1); LARGEST_GROUP / 2]).cast_unsigned(),
            };
            let _ = sums.push(sum);
        }
    } else {
        for block in light.groups(1usize.wrapping_shl(log2)) {
            let _ = sums.push(block.sum());
        }
    }
    let mean = |sum| Counts::from_bits(in_q8(sum) >> log2);
    let background = Background {
        level: mean(median(&sums)?),
        noise: noise(&[light])?,
    };
    let darkest = mean(*sums.iter().min()?);
    let dark_by = background.level.to_bits().abs_diff(darkest.to_bits());
    let noise = square(background.noise.to_bits().unsigned_abs());
    let is_noise = square(dark_by) <= noise.saturating_mul(DARK_BY_NOISE * DARK_BY_NOISE) >> log2;
    let darkest = if is_noise { background.level } else { darkest };
    Some((background, darkest))
}

/// In standard deviations of a block's mean. Noise alone makes a block so dark in one row of a thousand.
const DARK_BY_NOISE: u64 = 4;

/// Estimates the noise of a pixel from the mean absolute difference of neighbours, which is sigma 2/sqrt(pi)
/// for white noise. Takes the median of these means over pieces of the row, whose parts are given.
#[inline(never)]
pub(crate) fn noise(parts: &[Light<'_>]) -> Option<Counts> {
    /// 1/sqrt(12) of a count in Q8.
    const ROUNDING: i32 = 74;
    let pixels = (parts.iter()).fold(0, |all, part| part.len().saturating_add(all));
    let piece = pixels.div_ceil(MEDIAN_BLOCKS).max(8);
    let mut sums: Vec<u32, MEDIAN_BLOCKS> = Vec::new();
    for light in parts {
        // A step has the same size in words that rise and in words that fall.
        let (words, _) = light.words();
        for pixels in words.chunks_exact(piece) {
            // Two pixels in four are enough: on a row of 3648 the noise is then known to 3 %.
            let fours = pixels.as_chunks::<4>().0;
            // At most 32 steps of 12 bits: below 2^17, and in Q8 below 2^25.
            let _ = sums.push(dual_mac::sum_of_steps(fours));
        }
    }
    // All pieces have as many steps, at least two.
    let mean = in_q8(median(&sums)?).cast_unsigned();
    let mean = mean.checked_div(numeric::to_u32(piece) / 4)?;
    // sqrt(pi)/2 = 0.886227 as 58080/65536; a mean step is below 2^20 in Q8.
    let noise = (u64::from(mean) * 58_080) >> 16;
    let noise = numeric::i64_to_i32(noise.cast_signed());
    Some(Counts::from_bits(noise.max(ROUNDING)))
}

/// The median. Of an even number of values, the upper one of the middle two.
fn median(values: &[u32]) -> Option<u32> {
    order_statistic::ranked(values.len() / 2, values)
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
