//! Lists the candidates of a row: all light that stands out of what is beside it, at every scale.
//!
//! At a scale of 2^k pixels the row is a sequence of means over as many pixels (a block), smoothed by the
//! kernel [1 2 1] / 4. A gaussian whose width is 0.9 blocks gives that kernel 89 to 97 % of the
//! signal-to-noise ratio of the best filter. A peak counts by its *prominence*: how far it rises above the
//! mean of its sides, each at its lowest within [`REACH`] blocks. It is at most twice what the peak rises
//! above its higher side. So a background that rises along the row takes nothing away from a spot, nor does
//! light beside or below it, and an edge is no peak.
//!
//! One pass over a scale finds its peaks: it climbs to a top until the row has fallen from it by more than
//! noise ([`RISES`]), then falls to the lowest height until the row has risen from there by as much.
//!
//! One light makes a peak at several scales. The most significant one, prominence^2 * 2^k, is the candidate.
//! It explains the peaks that a spot of its width makes at other scales ([`FINER`], [`COARSER`]). What is
//! more prominent than that is a candidate of its own: a narrow spot on a lamp, or a lamp under a spot. If
//! two peaks of one scale lie in the light of a wider one, and a valley parts them, both are candidates too.
//!
//! Heights are whole numbers of 1/16 counts: a mean of 12-bit counts fits 16 bits at every scale.

use core::cell::Cell;
use core::ops::RangeInclusive;

use heapless::Vec;

use crate::base::{Counts, numeric};
use crate::row::{BLOCK_LOG2, Background, Light, MAX_PIXELS};

/// Means have so many bits after the binary point.
pub(super) const FRACTION: u32 = 4;
/// The largest blocks have 2^7 pixels, for widths up to 130 pixels.
pub(super) const LARGEST_LOG2: u32 = 7;
/// The most pixels of a part that is searched by itself.
pub(super) const MOST_NEAR: usize = 288;
/// The most candidates of a row.
pub(super) const MOST: usize = 16;
/// The most peaks of all scales together.
const MOST_PEAKS: usize = 32;
/// If more peaks than this rise by more than noise, the row is no row of spots.
const MOST_SEEN: usize = 256;
/// The same in blocks: such a row has more than one light, and its pixels are searched.
const MOST_SEEN_IN_BLOCKS: usize = 20;
/// Pairs of pixels that may be bad. If a row has more of them, the others stay as they are.
const MOST_BAD: u32 = 256;
/// Blocks to either side of a peak in which its sides are searched. A width is at most 1.6 blocks: less than
/// a thousandth of a spot is left there.
const REACH: usize = 6;
/// The least prominence, in halves of a standard deviation of the smoothed noise. Noise gets there in one row
/// of 5000 (3648 pixels, all scales).
const PROMINENT: u32 = 11;
/// A side's lowest height counts as the row's level if it is at most so far below that level, in halves of a
/// standard deviation. Noise explains the difference.
const BELOW_LEVEL: u32 = 8;
/// The same above the level. Noise takes the lowest of six heights a standard deviation down, so a height
/// above is light that is beside the peak, or a wide light that the peak is a part of.
const ABOVE_LEVEL: u32 = 2;
/// A peak rises by more than this within three blocks on both sides, in halves of a standard deviation.
const RISES: u32 = 5;
/// The least height above the level of a peak that is the only one, in halves of a standard deviation. Noise
/// gets there in one row of forty: the estimator rejects those rows as too dim.
const DETECTED: u32 = 9;

/// The prominence at a scale that is so many steps finer, over that at the spot's own scale, in 1/64. For a
/// width w of 0.42 blocks, less than any of a scale. The kernel leaves a share of the height,
/// w / sqrt(w^2 + 0.58 * 4^-n). Of that, the share 1 - exp(-(6 * 2^-n)^2 / 2 (w^2 + 0.58 * 4^-n)) is above
/// the sides.
const FINER: [u32; 8] = [64, 98, 120, 101, 43, 12, 3, 1];
/// The same for a width of 0.75 blocks. At the next finer scale, light of at least that width has at most
/// 1.27 times the prominence.
const FINER_OF_BROAD: [u32; 8] = [64, 81, 75, 35, 11, 3, 1, 1];
/// The same for light that is too wide for a spot, at each scale: 1 - exp(-(6 * 2^k / 170)^2 / 2), for the
/// narrowest one of 170 pixels.
const AT_SCALE_OF_WIDE: [u32; 8] = [1, 1, 1, 3, 9, 30, 59, 64];
/// The same at a scale that is coarser. For a width of 1.6 blocks, the most of a scale.
const COARSER: [u32; 8] = [64, 51, 33, 18, 9, 5, 2, 1];
/// A peak is another light if its prominence is so many 1/64 of what the others explain.
const UNEXPLAINED: u32 = 80;

/// A peak of the row at a scale. Heights in 1/16 counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Peak {
    pub(super) log2: u32,
    /// The pixel to the right of its block's middle.
    pub(super) middle: usize,
    /// The row's smoothed height there.
    pub(super) top: u16,
    pub(super) prominence: u16,
    /// Prominence^2 * 2^k, which white noise makes alike at all scales. Below 2^40. Of two scales that are
    /// nearly alike the coarser one counts.
    pub(super) significance: u64,
    /// It rises above both sides by half of its height, and by more than noise.
    has_valley: bool,
    /// The mean of both sides at their lowest.
    pub(super) base: u16,
    /// The row beside it, where a spot has ended: the mean at four blocks to both sides.
    pub(super) beside: u16,
    /// The row's end cuts its light.
    pub(super) is_cut: bool,
    /// Of a candidate: the next finer scale shows that it is at least 0.75 blocks wide.
    is_broad: bool,
    /// It is too wide for a spot.
    pub(super) is_wide: bool,
}

/// A candidate for the laser's spot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// The peak at the scale of its width.
    pub(super) peak: Peak,
    /// The height, less at most a tenth that the kernel takes of its peaks at finer scales.
    pub(super) height: u16,
    /// The prominence at the next coarser scale.
    pub(super) coarser: u16,
    /// Its most significant peak at a finer scale. None if its parts are candidates.
    finer: Option<Peak>,
}

/// The candidates, the most significant first.
pub(super) type Candidates = Vec<Candidate, MOST>;

impl Peak {
    pub(super) fn pixels(&self) -> usize {
        1usize.wrapping_shl(self.log2)
    }

    /// A part of its light rises from where it does.
    fn base_of_part(&self, part: Self) -> Self {
        let base = if self.is_wide { part.base } else { self.base };
        Self { base, ..part }
    }

    /// Whether it is within a block of another.
    fn is_beside(&self, other: &Self) -> bool {
        self.middle.abs_diff(other.middle) <= self.pixels().max(other.pixels())
    }

    /// Whether it may be one of two spots in light of a height.
    fn is_part(&self, height: u16) -> bool {
        self.has_valley && 2 * u32::from(self.prominence) >= height.into()
    }

    /// The prominence that a candidate's light has at this peak's place and scale, in 1/64 of a unit.
    #[inline(never)]
    fn explained_by(&self, candidate: &Self) -> u32 {
        let apart = self.middle.abs_diff(candidate.middle);
        let is_finer = self.log2 < candidate.log2;
        // In half blocks of the coarser one.
        let reach = if is_finer {
            candidate.pixels().wrapping_mul(4)
        } else {
            self.pixels().wrapping_mul(5)
        };
        if apart.wrapping_mul(2) > reach {
            return 0;
        }
        let share = if is_finer && candidate.is_wide {
            AT_SCALE_OF_WIDE.get(self.log2 as usize).copied()
        } else if is_finer {
            let finer = candidate.log2.wrapping_sub(self.log2) as usize;
            let shares = if candidate.is_broad {
                FINER_OF_BROAD
            } else {
                FINER
            };
            shares.get(finer).copied()
        } else {
            let coarser = self.log2.wrapping_sub(candidate.log2) as usize;
            COARSER.get(coarser).copied()
        };
        u32::from(candidate.prominence).saturating_mul(share.unwrap_or_default())
    }
}

/// The significance of so many halves of a standard deviation, in the unit of a pixel's `variance`. A mean of
/// 2^k pixels has 2^-k of a pixel's variance. The smoothed row has 6/16 of the mean's variance.
fn significance_of(halves: u32, variance: u64) -> u64 {
    let halves = u64::from(halves);
    variance.saturating_mul(halves.saturating_mul(halves).saturating_mul(6)) / 64
}

/// The height that a spot of one pixel needs.
pub(super) fn least_height(noise: Counts) -> Counts {
    let noise = u64::from(noise.to_bits().unsigned_abs());
    let square = significance_of(DETECTED, noise.saturating_mul(noise));
    Counts::from_bits(i32::try_from(square.isqrt()).unwrap_or(i32::MAX))
}

/// A half of a standard deviation has so many bits after the binary point, beyond those of heights.
const HALF_FRACTION: u32 = 8;

/// A scale, and its limits in 1/16 counts.
#[derive(Clone, Copy, Default)]
struct Scale {
    log2: u32,
    /// The kernel's sum is 2^`sum_log2` heights.
    sum_log2: u32,
    /// After [`BELOW_LEVEL`], [`ABOVE_LEVEL`], [`RISES`], [`DETECTED`] and [`PROMINENT`].
    below_level: u32,
    above_level: u32,
    rises: u32,
    detected: u32,
    prominent: u32,
}

impl Scale {
    /// `half` is a half of a standard deviation of the smoothed pixels, in 2^-[`HALF_FRACTION`] of 1/16
    /// counts.
    fn of(log2: u32, half: u32) -> Self {
        // 2^16 / sqrt(2^k): the mean of twice as many pixels has 1/sqrt(2) of the noise.
        const SHARES: [u64; 8] = [65_536, 46_341, 32_768, 23_170, 16_384, 11_585, 8192, 5793];
        let share = SHARES.get(log2 as usize).copied().unwrap_or_default();
        // Below 2^32 times 2^17, then 2^32 times 2^4.
        let half = numeric::mul_u64(half.into(), share) >> 16;
        let limit = |halves: u64| {
            u32::try_from(numeric::mul_u64(half, halves) >> HALF_FRACTION).unwrap_or(u32::MAX)
        };
        Self {
            log2,
            sum_log2: 2,
            below_level: limit(BELOW_LEVEL.into()),
            above_level: limit(ABOVE_LEVEL.into()),
            rises: limit(RISES.into()),
            detected: limit(DETECTED.into()),
            prominent: limit(PROMINENT.into()),
        }
    }

    fn pixels(self) -> u32 {
        1u32.wrapping_shl(self.log2)
    }

    #[inline(always)]
    fn smoothed(self, &[left, middle, right]: &[u16; 3]) -> u32 {
        // Four of 16 bits.
        numeric::add_u32(u32::from(left) + u32::from(right), 2 * u32::from(middle))
            .wrapping_shr(self.sum_log2)
    }

    /// The smoothed height at a block. An end has none.
    fn smooth(self, means: &[u16], block: usize) -> Option<u32> {
        let first = block.checked_sub(1)?;
        Some(self.smoothed(means.get(first..)?.first_chunk()?))
    }

    /// The smoothed height so many blocks to a peak's right, or left.
    fn beside(self, means: &[u16], block: usize, distance: usize, is_right: bool) -> Option<u32> {
        let block = if is_right {
            numeric::add_usize(block, distance)
        } else {
            block.checked_sub(distance)?
        };
        self.smooth(means, block)
    }

    /// Height^2 * 2^k, and 1/64 of it more for each step of k: of two scales that are nearly alike the
    /// coarser one counts. Below 2^40.
    fn significance(self, height: u32) -> u64 {
        let height = u64::from(numeric::to_u16(height as usize));
        let square = numeric::mul_u64(numeric::mul_u64(height, height), self.pixels().into());
        numeric::mul_u64(square, u64::from(self.log2.wrapping_add(64))) / 64
    }
}

/// The peaks of a row at the scales that were searched.
pub(super) struct Peaks {
    /// The row's level, and the variance of an unlit pixel in 1/256 counts^2.
    level: u16,
    variance: u64,
    /// A half of the standard deviation of the smoothed pixels, for [`Scale::of`].
    half: u32,
    /// Where the row is darkest: the level, or less.
    darkest: u16,
    /// The scale that is searched.
    scale: Scale,
    found: Vec<Peak, MOST_PEAKS>,
    /// The places in `found`, that of the most significant one first.
    order: Vec<u8, MOST_PEAKS>,
    /// How many peaks were looked at.
    seen: usize,
    /// More than so many are too many: the search ends.
    most: usize,
    are_too_many: bool,
    /// The highest one above the level, prominent or not, and how significant that height is.
    highest: Option<(u64, Peak)>,
    /// The first pixel of the part that is searched, and whether the part is the whole row.
    first: usize,
    is_whole: bool,
}

impl Peaks {
    /// None yet, above this background.
    pub(super) fn of(background: Background, darkest: Counts) -> Self {
        let dark_by = background.level_bits().saturating_sub(darkest.to_bits());
        let dark_by =
            u16::try_from(dark_by.max(0) >> (Counts::FRACTION - FRACTION)).unwrap_or(u16::MAX);
        let level = background.level_bits() >> (Counts::FRACTION - FRACTION);
        let level = numeric::i32_to_u16(level);
        let noise = u64::from(background.noise.to_bits().unsigned_abs());
        let variance = noise.saturating_mul(noise) >> 8;
        let half = significance_of(1, variance.saturating_mul(1 << (2 * HALF_FRACTION))).isqrt();
        Self {
            level,
            variance,
            half: u32::try_from(half).unwrap_or(u32::MAX),
            darkest: level.saturating_sub(dark_by),
            scale: Scale::default(),
            found: Vec::new(),
            order: Vec::new(),
            seen: 0,
            most: MOST_SEEN,
            are_too_many: false,
            highest: None,
            first: 0,
            is_whole: true,
        }
    }

    /// Searches the sums of the row's blocks of 8 pixels, and larger ones.
    pub(super) fn search_blocks(&mut self, blocks: &[u16]) {
        let mut means = [0; MAX_PIXELS / 16];
        // 16 counts of 12 bits fit 16 bits.
        dual_mac::sum_pairs(blocks, &mut means);
        self.most = MOST_SEEN_IN_BLOCKS;
        // A sum of 8 counts is half a height.
        let scale = Scale::of(BLOCK_LOG2, self.half);
        self.search_scale(
            blocks,
            Scale {
                sum_log2: 1,
                ..scale
            },
        );
        self.search(&mut means, blocks.len() / 2, BLOCK_LOG2 + 1..=LARGEST_LOG2);
        self.most = MOST_SEEN;
    }

    /// Searches the pixels, and larger blocks.
    #[inline(never)]
    pub(super) fn search_pixels(&mut self, light: Light<'_>) {
        self.search_part(&mut [0; MAX_PIXELS], light, 0..=LARGEST_LOG2);
    }

    /// Searches a part of the row, beside what was found in its blocks: in blocks of 2^`log2` pixels and
    /// more, but of less than 8.
    #[inline(never)]
    pub(super) fn search_near(&mut self, light: Light<'_>, first: usize, log2: u32) {
        (self.first, self.is_whole) = (first, false);
        self.search_part(&mut [0; MOST_NEAR], light, log2..=BLOCK_LOG2 - 1);
        (self.first, self.is_whole) = (0, true);
    }

    fn search_part(&mut self, means: &mut [u16], light: Light<'_>, scales: RangeInclusive<u32>) {
        let mut number = light.len();
        for (mean, count) in means.iter_mut().zip(light.iter()) {
            // 12 bits.
            *mean = count.wrapping_shl(FRACTION);
        }
        self.mend(means.get_mut(..number).unwrap_or_default());
        for _ in 0..*scales.start() {
            number = dual_mac::halve(means.get_mut(..number).unwrap_or_default());
        }
        self.search(means, number, scales);
    }

    /// Mends bad pixels. One that is higher than both its neighbours by more than any spot makes it counts as
    /// high as a spot would, and one that is much lower as high as they are. It also differs from the other
    /// pixel of its pair, so only pairs that differ are looked at.
    fn mend(&self, heights: &mut [u16]) {
        let noise = self.variance.isqrt();
        let slack = u32::try_from(noise.saturating_mul(8)).unwrap_or(u32::MAX);
        // Heights are below 2^16.
        let most_step = slack.min(1 << 16);
        let heights = Cell::from_mut(heights).as_slice_of_cells();
        let height = |cell: &Cell<u16>| u32::from(cell.get());
        let beside = |pixel: Option<usize>| {
            let cell = pixel.and_then(|pixel| heights.get(pixel));
            cell.map_or(self.level.into(), height)
        };
        let mended = |left: u32, here: u32, right: u32| {
            let mended = self.without_bad(left, here, right, slack);
            numeric::to_u16(mended as usize)
        };
        let mut most = MOST_BAD;
        let (pairs, last) = heights.as_chunks::<2>();
        for (pair, [one, other]) in (0..MAX_PIXELS).zip(pairs) {
            let step = height(one).wrapping_sub(height(other));
            if step.wrapping_add(most_step) > 2 * most_step {
                let (first, second) = (height(one), height(other));
                let pixel = pair.saturating_mul(2);
                let (left, right) = (beside(pixel.checked_sub(1)), beside(pixel.checked_add(2)));
                // The flank of a spot.
                let rises = left <= first && first <= second && second <= right;
                if rises || left >= first && first >= second && second >= right {
                    continue;
                }
                one.set(mended(left, first, second));
                other.set(mended(first, second, right));
                most = most.saturating_sub(1);
                if most == 0 {
                    return;
                }
            }
        }
        for last in last {
            let left = beside(heights.len().checked_sub(2));
            last.set(mended(left, height(last), self.level.into()));
        }
    }

    /// A pixel that is not bad stays. The narrowest spot has a width of 0.5 pixels, and its neighbours have
    /// at least 0.2 of its height.
    #[inline(never)]
    fn without_bad(&self, left: u32, here: u32, right: u32, slack: u32) -> u32 {
        if (left.min(right)..=left.max(right)).contains(&here) {
            return here;
        }
        let above = |height: u32| height.saturating_sub(self.level.into());
        let five = |height: u32| above(height).saturating_mul(5).saturating_add(slack);
        let most = five(left.max(right)).saturating_add(self.level.into());
        let darker = left.min(right);
        if here > most {
            most
        } else if five(here) < above(darker) {
            darker
        } else {
            here
        }
    }

    fn search(&mut self, means: &mut [u16], number: usize, scales: RangeInclusive<u32>) {
        let mut number = number;
        for log2 in scales {
            let Some(at_scale) = means.get_mut(..number) else {
                return;
            };
            if number < 4 || self.are_too_many {
                return;
            }
            self.search_scale(at_scale, Scale::of(log2, self.half));
            number = dual_mac::halve(at_scale);
        }
    }

    /// Looks at the peaks of a scale. The row's ends are dark.
    #[inline(never)]
    fn search_scale(&mut self, means: &[u16], scale: Scale) {
        self.scale = scale;
        // As the sums. Limited, so that differences are below 2^22.
        let sum_of = |height: u32| height.min(1 << 20).wrapping_shl(scale.sum_log2);
        let rises = sum_of(scale.rises);
        let least = sum_of(u32::from(self.darkest).saturating_add(scale.detected));
        let mut sums = Sums::of(means);
        let number = sums.means.len();
        let mut sum = sums.next();
        while let Some(first) = sum {
            if first <= least {
                sum = sums.next_above(least);
                continue;
            }
            let (top, behind, next) = sums.climb(first, rises);
            // A peak falls within three blocks, or ends with the row. The first sum is that of block 1.
            if next.is_none() || behind.saturating_sub(sums.means.len()) <= 3 {
                let height = top.wrapping_shr(scale.sum_log2);
                self.see(means, number.saturating_sub(behind), height);
            }
            sum = next.and_then(|next| sums.fall(next, rises));
        }
    }

    /// Looks at a peak of the scale: keeps it if it is prominent, or the highest.
    #[inline(never)]
    fn see(&mut self, means: &[u16], block: usize, top: u32) {
        let scale = self.scale;
        let left = means.get(..=block).unwrap_or_default();
        let right = means.get(block..).unwrap_or_default();
        if self.are_too_many {
            return;
        }
        let Some(left) = Side::of(top, scale, left.iter().rev()) else {
            return;
        };
        let Some(right) = Side::of(top, scale, right.iter()) else {
            return;
        };
        self.seen = numeric::add_usize(self.seen, 1);
        self.are_too_many = self.seen > self.most;
        let level = u32::from(self.level);
        let foot = |side: &Side| {
            let lowest = level.saturating_sub(scale.below_level);
            let highest = level.saturating_add(scale.above_level);
            let is_level = (lowest..=highest).contains(&side.lowest);
            if is_level { level } else { side.lowest }
        };
        let (mut left_foot, mut right_foot) = (foot(&left), foot(&right));
        let is_cut = self.is_whole && left.ends != right.ends && {
            let (cut, other) = if left.ends {
                (left, right)
            } else {
                (right, left)
            };
            let beside = scale.beside(means, block, 4, left.ends);
            is_cut(top, &cut, &other, beside)
        };
        if is_cut && left.ends {
            left_foot = right_foot;
        } else if is_cut {
            right_foot = left_foot;
        }
        let base = left_foot.midpoint(right_foot);
        let above_higher_side = top.saturating_sub(left_foot.max(right_foot));
        let prominence = top
            .saturating_sub(base)
            .min(above_higher_side.saturating_mul(2));
        let above_level = top.saturating_sub(level);
        let is_high = above_level >= scale.detected && prominence.saturating_mul(2) >= above_level;
        let height = scale.significance(above_level);
        let is_highest = is_high && self.highest.is_none_or(|(other, _)| height > other);
        if !is_highest && prominence < scale.prominent {
            return;
        }
        let least = self.least(above_level);
        let significance = scale.significance(prominence);
        let at_four = [true, false].map(|is_right| scale.beside(means, block, 4, is_right));
        let beside = match at_four {
            [Some(behind), Some(before)] => before.midpoint(behind),
            // Nearer, because the background may rise.
            _ if is_cut => scale.beside(means, block, 3, left.ends).unwrap_or(base),
            _ => base,
        };
        let half = 1usize.wrapping_shl(scale.log2) / 2;
        let middle = block.wrapping_shl(scale.log2).saturating_add(half);
        let mut peak = Peak {
            log2: scale.log2,
            middle: self.first.saturating_add(middle),
            top: numeric::to_u16(top as usize),
            prominence: numeric::to_u16(prominence as usize),
            significance,
            has_valley: above_higher_side.saturating_mul(2) >= top.saturating_sub(base)
                && scale.significance(above_higher_side) >= least,
            base: numeric::to_u16(base as usize),
            beside: numeric::to_u16(beside as usize),
            is_cut,
            is_broad: false,
            is_wide: false,
        };
        peak.is_wide = self.is_wide(means, &peak, block);
        if is_highest && !peak.is_wide {
            self.highest = Some((height, peak));
        }
        if significance >= least {
            self.take(peak);
        }
    }

    /// The least significance of a peak of this height. No sensor has more than half a count of shot noise,
    /// squared, for each count.
    fn least(&self, above_level: u32) -> u64 {
        let shot = u64::from(above_level).saturating_mul(8);
        significance_of(PROMINENT, self.variance.saturating_add(shot)).max(1)
    }

    /// Whether the light is wider than a spot can be. A gaussian of 170 pixels has 15 to 18 % left 384 pixels
    /// away, one of 200 pixels 23 to 25 %. They are taken above the darkest part of the row, because wide
    /// light raises the level of the rest. Near the row's end, which may cut the light, 256 pixels to the
    /// other side count. Such light falls by at most 2 * 4^(k - 6) of its height within the reach of a peak:
    /// what is more prominent is a narrower spot on it.
    fn is_wide(&self, means: &[u16], peak: &Peak, block: usize) -> bool {
        if peak.log2 < BLOCK_LOG2 {
            return false;
        }
        let above = |height: u32| height.saturating_sub(self.darkest.into());
        let at = |block: Option<usize>| self.scale.smooth(means, block?).map(above);
        // Distances in 128 pixels.
        let blocks = |distance: usize| distance.wrapping_shl(LARGEST_LOG2.wrapping_sub(peak.log2));
        let left = |distance| at(block.checked_sub(blocks(distance)));
        let right = |distance| at(Some(block.saturating_add(blocks(distance))));
        let top = above(peak.top.into());
        let most = u64::from(top).wrapping_shl(peak.log2.saturating_mul(2)) / (1 << 11);
        if u64::from(peak.prominence) > most {
            return false;
        }
        let beside = match (left(3), right(3)) {
            (Some(left), Some(right)) => Some(left.midpoint(right)),
            (None, _) => right(2),
            (_, None) => left(2),
        };
        beside.is_some_and(|beside| beside > top / 5)
    }

    /// Keeps the most significant peaks.
    fn take(&mut self, peak: Peak) {
        let is_before = |&at: &u8| {
            let other = self.found.get(usize::from(at));
            other.is_some_and(|other| other.significance >= peak.significance)
        };
        let place = self.order.partition_point(is_before);
        let mut new = numeric::to_u8(self.found.len());
        if self.found.push(peak).is_ok() {
            // Below `MOST_PEAKS`.
            let _ = self.order.push(new);
        } else if let Some(&last) = self.order.get(place..).and_then(<[u8]>::last)
            && let Some(least) = self.found.get_mut(usize::from(last))
        {
            (*least, new) = (peak, last);
        }
        for at in self.order.get_mut(place..).unwrap_or_default() {
            new = core::mem::replace(at, new);
        }
    }

    /// Forgets what was found: the next search covers it.
    pub(super) fn clear(&mut self) {
        self.found.clear();
        self.order.clear();
        self.seen = 0;
        self.are_too_many = false;
        self.highest = None;
    }

    /// The highest peak above the row's level, prominent or not.
    pub(super) fn highest(&self) -> Option<Peak> {
        self.highest.map(|(_, peak)| peak)
    }

    /// Whether there is more light than a row of spots has.
    pub(super) fn are_too_many(&self) -> bool {
        self.are_too_many
    }

    /// How many peaks were looked at.
    pub(super) fn seen(&self) -> usize {
        self.seen
    }

    /// The candidates, the most significant first.
    #[inline(never)]
    pub(super) fn candidates(&self, candidates: &mut Candidates) {
        if self.are_too_many {
            return;
        }
        let in_order = self
            .order
            .iter()
            .filter_map(|&at| self.found.get(usize::from(at)));
        for &peak in in_order {
            if candidates.is_full() {
                return;
            }
            if explain(candidates, peak) {
                continue;
            }
            // A peak of the same light may have been taken for that of a wider one.
            let finer = candidates.iter_mut().find_map(|it| {
                let height = it.height;
                let is_own = |own: &mut Peak| own.is_beside(&peak) && own.is_part(height);
                it.finer
                    .take_if(is_own)
                    .map(|own| it.peak.base_of_part(own))
            });
            for peak in finer.into_iter().chain([peak]) {
                if finer == Some(peak) || !explain(candidates, peak) {
                    let candidate = Candidate::of(peak, candidates);
                    // If there is no room, there are more than matter.
                    let _ = candidates.push(candidate);
                }
            }
        }
    }
}

impl Candidate {
    /// The pixel where it is highest.
    pub(super) fn place(&self) -> usize {
        self.finer.map_or(self.peak.middle, |finer| finer.middle)
    }

    /// Its peak. Of a spot of two pixels the highest one tells best where it is.
    pub(super) fn sharpest(&self) -> Peak {
        let pixel = self.finer.filter(|_| self.peak.log2 == 1);
        let middle = pixel.map_or(self.peak.middle, |pixel| pixel.middle);
        Peak {
            middle,
            ..self.peak
        }
    }

    /// A candidate beside those that were found before.
    fn of(peak: Peak, others: &Candidates) -> Self {
        // What stands on wider light is measured from there. Wider light has the others' in it.
        let narrower = (others.iter())
            .filter(|it| it.peak.log2 < peak.log2)
            .fold(0u32, |all, it| {
                all.saturating_add(peak.explained_by(&it.peak))
            });
        let height = u32::from(peak.top.saturating_sub(peak.base)).saturating_sub(narrower / 64);
        Self {
            peak,
            height: numeric::to_u16(height as usize),
            coarser: 0,
            finer: None,
        }
    }
}

/// Whether a peak is that of the candidates' light.
fn explain(candidates: &mut Candidates, peak: Peak) -> bool {
    let explained = (candidates.iter()).fold(0u32, |all, it| {
        all.saturating_add(peak.explained_by(&it.peak))
    });
    // Below 2^16 * 2^12.
    if u32::from(peak.prominence).saturating_mul(64 * 64) > explained.saturating_mul(UNEXPLAINED) {
        return false;
    }
    let nearest = (candidates.iter_mut())
        .filter(|it| peak.explained_by(&it.peak) > 0)
        .min_by_key(|it| it.peak.log2.abs_diff(peak.log2));
    let Some(of) = nearest else { return true };
    if of.peak.log2.wrapping_add(1) == peak.log2 {
        of.coarser = of.coarser.max(peak.prominence);
    }
    if of.peak.log2 <= peak.log2 {
        return true;
    }
    let is_part = peak.is_part(of.height);
    let (whole, own) = (of.peak, of.finer);
    if is_part && own.is_some_and(|own| !own.is_beside(&peak)) {
        of.finer = None;
    }
    if is_part {
        // With another one like it, both are parts of the candidate.
        let others = own.filter(|own| !own.is_beside(&peak));
        let is_other = |it: &Candidate| {
            it.peak.log2 < whole.log2
                && it.peak.explained_by(&whole) > 0
                && !it.peak.is_beside(&peak)
        };
        if others.is_some() || candidates.iter().any(is_other) {
            for peak in others.into_iter().chain([peak]) {
                let part = whole.base_of_part(peak);
                // If there is no room, there are more parts than matter.
                let _ = candidates.push(Candidate::of(part, &Candidates::new()));
            }
            return true;
        }
    }
    let Some(of) = candidates.iter_mut().find(|it| it.peak == whole) else {
        return true;
    };
    of.finer = of.finer.or(Some(peak));
    let is_next = peak.log2.wrapping_add(1) == whole.log2;
    if is_next && 4 * u32::from(peak.prominence) <= 5 * u32::from(whole.prominence) {
        of.peak.is_broad = true;
    }
    // Finer scales show more of the height.
    if of.peak.log2.saturating_sub(peak.log2) <= 2 {
        of.height = of.height.max(peak.top.saturating_sub(of.peak.base));
    }
    true
}

/// Whether the row's end cuts the light: the other side counts then. The light ends there, as its height at
/// four blocks tells. A background that rises towards the end falls on.
fn is_cut(top: u32, cut: &Side, other: &Side, beside: Option<u32>) -> bool {
    let fallen = top.saturating_sub(other.lowest);
    let rest = beside.unwrap_or(top).saturating_sub(other.lowest);
    top.saturating_sub(cut.lowest).saturating_mul(2) < fallen && rest.saturating_mul(12) <= fallen
}

/// A side of a peak.
#[derive(Clone, Copy)]
struct Side {
    /// The lowest height on the way from the peak, up to [`REACH`] blocks or to where the row is higher than
    /// it.
    lowest: u32,
    /// The row ends within three blocks.
    ends: bool,
}

impl Side {
    /// Of a peak of this height, with the means from its block on. `None` if it does not rise by more than
    /// noise within three blocks.
    #[inline(always)]
    fn of<'a>(
        top: u32,
        scale: Scale,
        mut means: impl ExactSizeIterator<Item = &'a u16>,
    ) -> Option<Self> {
        let ends = means.len() < 5;
        let mut next = || means.next().map(|&mean| u32::from(mean));
        let mut lowest = top;
        if let (Some(first), Some(mut last)) = (next(), next()) {
            // Sums of 16 bits: below 2^18.
            let mut last_two = numeric::add_u32(first, last);
            for block in 0..REACH {
                let Some(mean) = next() else { break };
                let two = numeric::add_u32(last, mean);
                let height = numeric::add_u32(last_two, two).wrapping_shr(scale.sum_log2);
                (last, last_two) = (mean, two);
                if height > top {
                    break;
                }
                lowest = lowest.min(height);
                if block == 2 && top.saturating_sub(lowest) <= scale.rises {
                    return None;
                }
            }
        }
        (ends || top.saturating_sub(lowest) > scale.rises).then_some(Self { lowest, ends })
    }
}

/// The kernel's sums over a row's blocks.
struct Sums<'a> {
    means: core::slice::Iter<'a, u16>,
    last: u32,
    last_two: u32,
}

impl<'a> Sums<'a> {
    fn of(means: &'a [u16]) -> Self {
        let mut means = means.iter();
        let mut next = || means.next().copied().map_or(0, u32::from);
        let (first, last) = (next(), next());
        Self {
            last_two: numeric::add_u32(first, last),
            means,
            last,
        }
    }

    /// Climbs from a sum until one is lower than the top by more than `rises`. Returns the top, how many sums
    /// are behind it, and that lower sum; `None` if the row ends.
    #[inline(always)]
    fn climb(&mut self, mut top: u32, rises: u32) -> (u32, usize, Option<u32>) {
        loop {
            let mut next = self.next();
            while let Some(here) = next
                && here >= top
            {
                top = here;
                next = self.next();
            }
            let behind = numeric::add_usize(self.means.len(), next.is_some().into());
            loop {
                match next {
                    Some(here) if here >= top => {
                        top = here;
                        break;
                    }
                    Some(here) if top.wrapping_sub(here) <= rises => next = self.next(),
                    end => return (top, behind, end),
                }
            }
        }
    }

    /// Falls from a sum until one is higher than the lowest by more than `rises`. Returns that one; `None` if
    /// the row ends.
    #[inline(always)]
    fn fall(&mut self, mut lowest: u32, rises: u32) -> Option<u32> {
        loop {
            let here = self.next()?;
            let rise = here.wrapping_sub(lowest).cast_signed();
            if rise > rises.cast_signed() {
                return Some(here);
            }
            if rise < 0 {
                lowest = here;
            }
        }
    }

    /// The next sum above a limit.
    #[inline(never)]
    fn next_above(&mut self, limit: u32) -> Option<u32> {
        loop {
            self.skip_dark(limit / 4);
            for _ in 0..8 {
                let sum = self.next()?;
                if sum > limit {
                    return Some(sum);
                }
            }
        }
    }

    /// Leaves out heights of which none is above a limit, eight at a time.
    #[inline(always)]
    fn skip_dark(&mut self, limit: u32) {
        if self.last.max(self.last_two.wrapping_sub(self.last)) > limit {
            return;
        }
        let rest = self.means.as_slice();
        let limit = u16::try_from(limit).unwrap_or(u16::MAX);
        let dark = dual_mac::blocks_at_most(rest.as_chunks().0, limit);
        let (dark, rest) = rest
            .split_at_checked(dark.saturating_mul(dual_mac::BLOCK))
            .unwrap_or_default();
        if let [.., first, last] = dark {
            self.last = u32::from(*last);
            self.last_two = u32::from(*first) + self.last;
            self.means = rest.iter();
        }
    }
}

impl Iterator for Sums<'_> {
    type Item = u32;

    #[inline(always)]
    fn next(&mut self) -> Option<u32> {
        // Sums of 16 bits: below 2^18.
        let mean = u32::from(*self.means.next()?);
        let two = numeric::add_u32(self.last, mean);
        let four = numeric::add_u32(self.last_two, two);
        (self.last, self.last_two) = (mean, two);
        Some(four)
    }
}
