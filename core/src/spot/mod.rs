//! Finds the spot on a row: its place to a pixel, its width to a factor of two.
//!
//! First the search takes the level and the noise of the row's own background. Both are medians over blocks
//! of pixels, so a spot that fills less than half of the row does not change them. Then the kernel [1 2 1]
//! runs over sums of 8, 16 ... 128 pixels, and over the pixels and sums of 2 and 4 pixels where these may
//! show a spot that stands out more. A gaussian whose width is 0.9 of a block
//! gives that kernel 89 to 97 % of the signal-to-noise ratio of the best filter, depending on how it lies on
//! the blocks. Widths between two block sizes give 84 % or more. The spot is where the response stands
//! highest above its own noise. A background that rises along the row and would hide the spot is subtracted
//! first (`tilt`). If the highest response is that of light too wide for a spot, the search compares each
//! place with the light beside it (`narrow`). Last, the search tests whether the light is two spots
//! (`second_spot`).
//!
//! The row before tells the next row's place and width. [`find_again`] searches the peak of the kernel's
//! responses near that place. Then its sweep over the rest of the row only tests whether any response there
//! is similar to the peak.
//!
//! All sums are integers, and all results come from differences of counts: adding a constant to a row changes
//! nothing.

pub mod choice;
mod narrow;
pub mod region;
mod second_spot;
mod sums;
mod tilt;

use core::ops::Range;

use heapless::Vec;

use crate::base::work_budget::{self, WorkBudget};
use crate::base::{Counts, Fault, Pixels, numeric, order_statistic};
use crate::row::{BLOCK_LOG2, Background, Blocks, LARGEST_COUNT, Light, MAX_PIXELS, Row};
pub(crate) use crate::spot::sums::Coarse;
use crate::spot::sums::{Fine, Groups, Sums, sum_of};
use crate::spot::tilt::Tilt;

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

/// Finds the spot. Returns it with what the search leaves of the row's work budget.
///
/// # Errors
/// [`Fault::NoSpot`] if nothing stands out, or the row is shorter than [`MIN_PIXELS`]. [`Fault::TwoSpots`] if
/// two spots stand out and their heights do not tell which is the laser's. [`Fault::SensorSilent`] if all
/// pixels read the same, which the noise of a sensor never allows.
pub fn find(row: &Row<'_>) -> Result<(Spot, WorkBudget), Fault> {
    let blocks = Blocks::of(row.light());
    let mut budget = WorkBudget::of_row();
    let spot = find_in(row, blocks.sums(), &mut Coarse::new(), &mut budget)?;
    Ok((spot, budget))
}

/// As [`find`], with the row's blocks, and room for what follows from them.
pub(crate) fn find_in(
    row: &Row<'_>,
    blocks: &[u16],
    coarse: &mut Coarse,
    budget: &mut WorkBudget,
) -> Result<Spot, Fault> {
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
    let first = First::look(light, blocks, coarse).ok_or(NOTHING)?;
    match first.tilt() {
        None => first.search(budget),
        Some(tilt) => search_level(light, tilt, coarse, budget),
    }
}

/// The fault of a row on which nothing stands out.
const NOTHING: Fault = Fault::NoSpot {
    amplitude: Counts::from_bits(0),
};

const WORK_OF_ALL_SIZES: usize = 1100;
/// The work of searching a row again without its tilt.
const WORK_OF_LEVEL: usize = 1100;

// Only the search has paid yet, so it never has too little.
const _: () =
    assert!(WORK_OF_ALL_SIZES + WORK_OF_LEVEL + narrow::WORK <= work_budget::WHOLE as usize);

/// What blocks of 8 pixels and more show.
struct First<'a> {
    sums: Sums<'a>,
    background: Background,
    best: Candidate,
}

impl<'a> First<'a> {
    #[inline(never)]
    fn look(light: Light<'a>, blocks: &'a [u16], coarse: &'a mut Coarse) -> Option<Self> {
        coarse.sum(blocks);
        let sums = Sums::new(light, blocks, coarse);
        let level = sums.level()?;
        Some(Self {
            background: Background {
                level,
                noise: noise(&[light])?,
            },
            best: Candidate::best(&sums, level)?,
            sums,
        })
    }

    /// The background's tilt, if it may hide the spot.
    fn tilt(&self) -> Option<Tilt> {
        let height = self.best.height();
        self.sums.tilt_that_may_hide(height, self.background.noise)
    }

    /// Searches a row whose tilt hides nothing.
    #[inline(never)]
    fn search(&self, budget: &mut WorkBudget) -> Result<Spot, Fault> {
        let (sums, best, background) = (&self.sums, &self.best, self.background);
        // The width is tested first, because the other test takes much more time.
        if !best.is_too_wide(sums, background.level)
            && best.is_best_of_all_sizes(sums, background)
            && let Some(found) = take(sums, best, background, budget)
        {
            return found;
        }
        search_all_sizes(sums, background, budget)
    }
}

#[cold]
#[inline(never)]
fn search_all_sizes(
    sums: &Sums<'_>,
    background: Background,
    budget: &mut WorkBudget,
) -> Result<Spot, Fault> {
    budget.pay(WORK_OF_ALL_SIZES).ok_or(NOTHING)?;
    let mut fine = Fine::new();
    fine.sum(sums.light);
    let sums = sums.with(&fine);
    let Background { level, noise } = background;
    let mut best = Candidate::best(&sums, level).ok_or(NOTHING)?;
    if best.block_log2 == 0 && best.is_one_pixel(&sums, level) {
        // The highest response is that of a hot pixel. Larger blocks may show the spot that it hides.
        best = Candidate::all(&sums, level)
            .fold(None, |best: Option<Candidate>, candidate| {
                let is_better =
                    (best.as_ref()).is_none_or(|best| candidate.significance >= best.significance);
                if is_better && !candidate.is_one_pixel(&sums, level) {
                    Some(candidate)
                } else {
                    best
                }
            })
            .ok_or(NOTHING)?;
    }
    let is_dim = best.significance < needed(narrow::LEAST_CONTRAST, noise);
    let may_hide_another =
        best.is_too_wide(&sums, level) || is_dim && sums.has_darker_background(level, noise);
    if may_hide_another {
        budget.pay(narrow::WORK).ok_or(NOTHING)?;
        if let Some(found) = narrow::find(&sums, noise, budget) {
            return found;
        }
    }
    if best.significance < needed(DETECTION, noise) {
        return Err(Fault::NoSpot {
            amplitude: best.height(),
        });
    }
    take(&sums, &best, background, budget).unwrap_or(Err(NOTHING))
}

/// Takes a candidate for the spot, if there is no other spot. `None` where the sums do not hold what this
/// needs.
fn take(
    sums: &Sums<'_>,
    best: &Candidate,
    background: Background,
    budget: &mut WorkBudget,
) -> Option<Result<Spot, Fault>> {
    let block = sums.highest(best.block_log2)?;
    let spot = Spot {
        centre: middle(block, best.block_log2),
        block_log2: best.block_log2,
        height: best.height(),
        background,
        black_level: background.level,
    };
    // What this paid counts only if it found out something.
    let mut left = *budget;
    let found = second_spot::check(sums, spot, &mut left)?;
    *budget = left;
    Some(found)
}

/// Searches a row without its tilt, and adds the tilt at the spot to the background's level.
#[cold]
#[inline(never)]
fn search_level(
    light: Light<'_>,
    tilt: Tilt,
    coarse: &mut Coarse,
    budget: &mut WorkBudget,
) -> Result<Spot, Fault> {
    /// Aligned to 4 bytes, as `dual_mac` is fast with.
    #[repr(align(4))]
    struct Aligned([u16; MAX_PIXELS]);
    let mut untilted = Aligned([0; MAX_PIXELS]);
    // A row has no more pixels.
    let untilted = untilted.0.get_mut(..light.len()).unwrap_or_default();
    let lowest = tilt.subtract_from(light, untilted);
    let untilted = Light::from(&*untilted);
    budget.pay(WORK_OF_LEVEL).ok_or(NOTHING)?;
    let blocks = Blocks::of(untilted);
    let first = First::look(untilted, blocks.sums(), coarse).ok_or(NOTHING)?;
    let spot = first.search(budget)?;
    let lowest = lowest.saturating_mul(1 << Counts::FRACTION);
    let level = spot.background.level.to_bits().saturating_add(lowest);
    let level = Counts::from_bits(level.saturating_add(tilt.height_at(light, spot.centre)));
    Ok(Spot {
        background: Background {
            level,
            ..spot.background
        },
        black_level: level,
        ..spot
    })
}

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
    let mut budget = WorkBudget::of_row();
    let coarse = &mut Coarse::new();
    let spot = find_again_in(row, blocks.sums(), coarse, before, width, &mut budget)?;
    Ok((spot, budget))
}

/// As [`find_again`], with the row's blocks, and room for what [`find`] makes of them.
pub(crate) fn find_again_in(
    row: &Row<'_>,
    blocks: &[u16],
    coarse: &mut Coarse,
    before: &Spot,
    width: Pixels,
    budget: &mut WorkBudget,
) -> Result<Spot, Fault> {
    if width < NARROWEST || row.light().len() < MIN_PIXELS {
        return find_in(row, blocks, coarse, budget);
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
        return find_in(row, blocks, coarse, budget);
    };
    let response = above(peak.response);
    let significance = square(response.unsigned_abs()) >> block_log2;
    let centre = middle(peak.group, block_log2);
    // Another spot has two thirds of the peak's response or more: see `second_spot::has_similar_height`.
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
        return find_in(row, blocks, coarse, budget);
    }
    Ok(Spot {
        centre,
        block_log2,
        height: height(response, block_log2),
        background: before.background,
        black_level: before.background.level,
    })
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

/// The highest response of the kernel [1 2 1] on blocks of up to four pixels. Zero for fewer than three
/// blocks.
fn highest_response<const N: usize>(mut blocks: impl Iterator<Item = [u16; N]>) -> u32 {
    let (Some(first), Some(second)) = (blocks.next(), blocks.next()) else {
        return 0;
    };
    let (first, second) = (sum_of(first), sum_of(second));
    let (mut last, mut last_two) = (second, numeric::add_u32(first, second));
    blocks.map(sum_of).fold(0, |highest, block| {
        let two = numeric::add_u32(last, block);
        let response = numeric::add_u32(last_two, two);
        (last, last_two) = (block, two);
        highest.max(response)
    })
}

/// These tests are not paid from the budget, so their number has a limit: where more blocks stand out, all
/// sizes are searched. A spot that fits blocks of 8 pixels stands out on less than ten of them.
const MOST_TRIED: u32 = 16;
/// On a row of fewer pixels all sizes are searched.
const SHORT: usize = 1024;
/// How much darker than the level noise makes a pixel, in standard deviations: one in 30,000 is darker.
const DARKEST: i32 = 4;

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
        let significance = square(response.unsigned_abs()) >> block_log2.min(LARGEST_BLOCK_LOG2);
        Some(Self {
            block_log2,
            response,
            significance,
        })
    }

    /// The candidates of all sizes that the sums hold.
    fn all(sums: &Sums<'_>, level: Counts) -> impl Iterator<Item = Self> {
        (sums.smallest_log2()..=LARGEST_BLOCK_LOG2)
            .filter_map(move |log2| Self::new(sums, log2, level))
    }

    /// The most significant one; of equal ones, that of the larger blocks.
    fn best(sums: &Sums<'_>, level: Counts) -> Option<Self> {
        Self::all(sums, level).max_by_key(|candidate| candidate.significance)
    }

    /// Whether no block of fewer than 8 pixels has a more significant response. `false` where that takes a
    /// search of all sizes.
    ///
    /// A kernel on fewer pixels has its middle in one block of 8, and lies within the kernel about that
    /// block. There each pixel has at least the weight that it has in the smaller kernel. So the smaller
    /// kernel responds with at most as much, if no pixel is darker than the level. Pixels of weight 32 may be
    /// darker: as a darker part of the background is, and by [`DARKEST`] standard deviations of noise each.
    /// (Dead pixels are darker still, but then the spot is not where they are.) Only where the larger kernel
    /// responds that much are the smaller ones tried.
    fn is_best_of_all_sizes(&self, sums: &Sums<'_>, background: Background) -> bool {
        let Background { level, noise } = background;
        let root = self.root_of_significance();
        let shadow = (level.to_bits()).saturating_sub(sums.darkest(level).to_bits());
        let darkest = noise.to_bits().saturating_mul(DARKEST);
        let darkest = darkest.saturating_add(shadow);
        let least = root.saturating_sub(darkest.saturating_mul(32));
        // Elsewhere noise alone would respond as much, by six standard deviations: sqrt(6 * 8) * 6 = 42. A
        // short row does not tell how dark its background is.
        if least < noise.to_bits().saturating_mul(42) || sums.light.len() < SHORT {
            return false;
        }
        // What responds with more, background included.
        let least = least.saturating_add(under_the_kernel(level, BLOCK_LOG2));
        let least = (least >> Counts::FRACTION).max(0).unsigned_abs();
        let mut tried = 0;
        let is_better = &mut |block: usize, _| {
            tried = numeric::add_u32(tried, 1);
            if tried > MOST_TRIED {
                return false;
            }
            let end = block.saturating_add(1).wrapping_shl(BLOCK_LOG2);
            self.is_better_than_fine(sums.light, block.wrapping_shl(BLOCK_LOG2)..end, level)
        };
        // The larger kernel does not have its middle on the blocks of the row's ends. The last block may have
        // no other to pair with.
        let last = (sums.number(BLOCK_LOG2) / 2 * 2).saturating_sub(1);
        let end = last.wrapping_shl(BLOCK_LOG2)..sums.light.len();
        is_better(0, 0)
            && self.is_better_than_fine(sums.light, end, level)
            && (sums.parts(BLOCK_LOG2))
                .filter(|&(highest, _)| highest > least)
                .all(|(_, blocks)| sums.all_above(BLOCK_LOG2, blocks, least, is_better))
    }

    /// Whether no kernel on blocks of 1, 2 or 4 pixels is more significant with its middle on these pixels.
    #[inline(never)]
    fn is_better_than_fine(&self, light: Light<'_>, pixels: Range<usize>, level: Counts) -> bool {
        let near = |around: usize| {
            let to = pixels.end.saturating_add(around).min(light.len());
            let near = light.slice(pixels.start.saturating_sub(around)..to);
            near.unwrap_or_default()
        };
        // A kernel on up to 16 pixels responds with at most 16 times the brightest one's light. Over the root
        // of its block's 4 pixels, that is 8 times.
        let brightest = near(4).iter().max().map_or(0, u32::from);
        if 8 * i64::from(in_q8(brightest).saturating_sub(level.to_bits()))
            <= i64::from(self.root_of_significance())
        {
            return true;
        }
        let is_better = |response, block_log2| {
            let response = above(response, block_log2, level).max(0);
            square(response.unsigned_abs()) >> block_log2 <= self.significance
        };
        is_better(highest_response(near(1).chunks::<1>()), 0)
            && is_better(highest_response(near(2).chunks::<2>()), 1)
            && is_better(highest_response(near(4).chunks::<4>()), 2)
    }

    /// The root of the significance, rounded down by up to 3 %. Q24.8 counts.
    fn root_of_significance(&self) -> i32 {
        // 1/sqrt(2^block_log2), Q8, for blocks of 8 to 128 pixels.
        let factor = match self.block_log2 {
            3 => 90,
            4 => 64,
            5 => 45,
            6 => 32,
            _ => 22,
        };
        numeric::i64_to_i32((i64::from(self.response) * factor) >> 8)
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

fn height(response: i32, block_log2: u32) -> Counts {
    Counts::from_bits(response >> (2 + block_log2.min(LARGEST_BLOCK_LOG2)))
}

/// A response above the background, in Q24.8 counts.
fn above(response: u32, block_log2: u32, level: Counts) -> i32 {
    in_q8(response).saturating_sub(under_the_kernel(level, block_log2))
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
