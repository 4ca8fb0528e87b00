//! Tests whether another spot on the row is nearly as high.
//!
//! The coarse search compares the light that its kernel gathers, and a narrower or wider spot of equal height
//! gathers less or more. This check compares heights. It takes the sums over two neighbouring half widths, of
//! which the lower one counts, so that a single bad pixel is no spot. A spot exceeds the light on both sides.
//! So a background that rises is no spot, and neither is the start or the end of its rise.

use core::ops::Range;

use crate::base::{Counts, Fault, Pixels, WorkBudget, numeric};
use crate::centre::RowCentre;
use crate::row::{BLOCK, Light, MAX_PIXELS, Row};
use crate::spot::Spot;

/// Widths from the centre to the nearest other spot. A closer one shows in the row's mirror image.
const NEAREST_OTHER: f32 = 4.0;
/// The least share of the spot's height that another spot has. The coarse search confuses two spots from a
/// share of 0.8 on. A box of half a width loses up to a tenth more of a spot that is 0.7 times as wide, or
/// that lies between two boxes.
const SHARE: f32 = 0.62;
/// The most boxes in [`NEAREST_OTHER`] widths, rounded up. A box has all whole pixels of half a width, at
/// least one: four widths have most boxes of one pixel, just below a width of 4.
const MOST_APART: usize = 16;
/// A spot further to the left replaces the highest one only if it is higher by one part in this many. So on a
/// row with a thousand rising spots, the highest one changes about fifty times.
const HIGHER: u16 = 8;
/// The places whose heights are compared in one go.
const PART: usize = 1024;
/// Heights of a part and of both sides, rounded up to whole fours.
const HEIGHTS: usize = PART + 2 * MOST_APART + 4;
/// The work of the comparison, without that of its pixels and places.
const WORK: usize = 240;
/// So many pixels are summed in one unit of work.
const PIXELS_IN_A_UNIT: usize = 20;
/// So many places are compared in one unit of work.
const PLACES_IN_A_UNIT: usize = 5;

/// Searches all of the row for another spot. Called for a frame's first row only. Returns `false` if
/// another spot is possible, but the budget is too small to search for it.
///
/// # Errors
/// [`Fault::TwoSpots`] if there is another spot.
#[inline(never)]
pub(crate) fn check(
    row: &Row<'_>,
    spot: &Spot,
    found: &RowCentre,
    mut budget: WorkBudget,
) -> Result<bool, Fault> {
    let light = row.light();
    let width = found.width.to_f32();
    let half = numeric::whole_usize(0.5 * width).clamp(1, MAX_PIXELS);
    let separation = numeric::whole_usize(NEAREST_OTHER * width).min(MAX_PIXELS);
    let apart = separation.div_ceil(half).clamp(1, MOST_APART);
    let centre = usize::try_from(found.centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let enough = numeric::whole_u32(SHARE * own_height(light, centre, half, apart) as f32);
    let level = spot.background.level_bits().unsigned_abs();
    let level = level.saturating_mul(numeric::to_u32(half)) >> Counts::FRACTION;
    let least = level.saturating_add(enough);
    // The sum of 2^(2 + shift) counts of 12 bits fits 14 bits after the shift.
    let size_log2 = usize::BITS.wrapping_sub(half.wrapping_sub(1).leading_zeros());
    let shift = size_log2.saturating_sub(2);
    let mut search = Search {
        half,
        apart,
        least,
        shift,
        above: limited(enough.wrapping_shr(shift)),
        other: None,
    };
    // Place k is the two boxes about pixel (k + 1) half. A spot has light on both sides. The spot itself is
    // between the places to its left and those to its right.
    let before = centre.saturating_sub(separation);
    let behind = centre.saturating_add(separation);
    let end = (light.len() / half).saturating_sub(apart.saturating_add(1));
    let left = before.div_ceil(half).saturating_sub(1);
    let right = behind / half;
    // On nearly all rows, no pixel there is high.
    let sides = [right.max(apart)..end, apart..left.min(end)]
        .map(|places| search.may_be_high(row, places.clone()).then_some(places));
    let of_pixels = light.len() / PIXELS_IN_A_UNIT;
    let of_places = light.len() / half / PLACES_IN_A_UNIT;
    let units = WORK.saturating_add(of_pixels).saturating_add(of_places);
    if sides.iter().any(Option::is_some) && budget.pay(units).is_none() {
        return Ok(false);
    }
    for places in sides.into_iter().flatten() {
        search.parts(row, places);
    }
    let Some(place) = search.other else {
        return Ok(true);
    };
    let other = numeric::to_i32(place.saturating_add(1).saturating_mul(half));
    Err(Fault::TwoSpots {
        centre: found.centre,
        other: Pixels::from_int(other),
    })
}

/// The height of the spot itself: the most that two boxes about its centre exceed the light beside them. The
/// spot may lie at the row's end, or on a slope.
fn own_height(light: Light<'_>, centre: usize, half: usize, apart: usize) -> u32 {
    // From two boxes before the centre up to it.
    let first = centre.saturating_sub(half.saturating_mul(2));
    let separation = half.saturating_mul(apart);
    let heights = |from: usize, to_left: usize| {
        let from = numeric::to_i32(from).saturating_sub(numeric::to_i32(to_left));
        heights(light, from, half)
    };
    let right = heights(first.saturating_add(separation), 0);
    let sides = heights(first, separation).into_iter().zip(right);
    let steps = (0..MAX_PIXELS).zip(heights(first, 0).into_iter().zip(sides));
    steps
        .filter(|(step, _)| first.saturating_add(offset(*step, half)) <= centre)
        .filter_map(|(_, (here, (left, right)))| {
            let beside = left.or(right)?.midpoint(right.or(left)?);
            Some(here?.saturating_sub(beside))
        })
        .max()
        .unwrap_or_default()
}

/// Steps of a box: [`heights`] are taken an eighth of a width apart.
const STEPS: usize = 4;

/// Pixels from the first step to another.
fn offset(step: usize, half: usize) -> usize {
    half.saturating_mul(step) / STEPS
}

/// For each step from a pixel on: the lower one of the sums of the two boxes that begin there. `None` if a
/// box reaches beyond the row.
fn heights(light: Light<'_>, from: i32, half: usize) -> [Option<u32>; 2 * STEPS + 1] {
    // The sums of the pixels from the first step on the row to each step. `None` off the row.
    let mut sums = [None; 4 * STEPS + 1];
    let mut last = None;
    for (step, sum) in (0..MAX_PIXELS).zip(&mut sums) {
        let pixel = from.saturating_add(numeric::to_i32(offset(step, half)));
        let Ok(pixel) = usize::try_from(pixel) else {
            continue;
        };
        let all = match last {
            None => (pixel <= light.len()).then_some(0),
            Some((before, sum)) => light.slice(before..pixel).map(|pixels| {
                // At most 22: `Light::sum` takes longer.
                pixels.iter().map(u32::from).fold(sum, numeric::add_u32)
            }),
        };
        let Some(all) = all else { break };
        last = Some((pixel, all));
        *sum = Some(all);
    }
    core::array::from_fn(|step| {
        let sum = |boxes: usize| *sums.get(step.saturating_add(boxes.saturating_mul(STEPS)))?;
        let (start, middle, end) = (sum(0)?, sum(1)?, sum(2)?);
        Some(end.saturating_sub(middle).min(middle.saturating_sub(start)))
    })
}

/// A search for the highest other spot. Place k is box k and box k + 1, and its height the lower one of their
/// sums.
struct Search {
    /// Pixels in a box.
    half: usize,
    /// Boxes from a place to the light beside it.
    apart: usize,
    /// Another spot's height exceeds this.
    least: u32,
    /// Heights are compared as their sums shifted right by so much: then they are below 2^14.
    shift: u32,
    /// Another spot exceeds the light on both sides by more than this, shifted.
    above: u16,
    /// The place of the highest other spot up to now.
    other: Option<usize>,
}

impl Search {
    /// Searches some places, from the last one to the first: the last one of two equal spots counts.
    #[cold]
    #[inline(never)]
    fn parts(&mut self, row: &Row<'_>, places: Range<usize>) {
        let mut heights = [0; HEIGHTS];
        let is_one_part = places.len() <= PART;
        let mut end = places.end;
        while end > places.start {
            let start = end.saturating_sub(PART).max(places.start);
            if is_one_part || self.may_be_high(row, start..end) {
                self.part(row.light(), start..end, &mut heights);
            }
            end = start;
        }
    }

    /// Whether the height at one of these places may exceed the least one. If both boxes of a place do, so
    /// does the mean of the blocks in which the two lie, and one pixel exceeds its part.
    #[inline(never)]
    fn may_be_high(&self, row: &Row<'_>, places: Range<usize>) -> bool {
        if places.is_empty() {
            return false;
        }
        let two = self.half.saturating_mul(2);
        let number = two.saturating_add(BLOCK - 1).div_ceil(BLOCK);
        let two_least = self.least.saturating_mul(2);
        let of = |number: usize| two_least.checked_div(numeric::to_u32(number));
        let (Some(of_block), Some(of_pixel)) = (of(number), of(two)) else {
            return true;
        };
        let end = places.end.saturating_add(1).saturating_mul(self.half);
        let pixels = places.start.saturating_mul(self.half)..end;
        let blocks = pixels.start / BLOCK..pixels.end.div_ceil(BLOCK);
        // A row without blocks is searched.
        let blocks = row.blocks().get(blocks);
        let may_exceed = |light: Option<Light<'_>>, of| light.is_none_or(|light| light.exceeds(of));
        may_exceed(blocks.map(Light::from), of_block)
            && may_exceed(row.light().slice(pixels), of_pixel)
    }

    /// Searches at most [`PART`] places.
    fn part(&mut self, light: Light<'_>, places: Range<usize>, heights: &mut [u16; HEIGHTS]) {
        // The boxes beside too.
        let first = places.start.saturating_sub(self.apart);
        let end = places.end.saturating_add(self.apart).saturating_add(1);
        let pixels = first.saturating_mul(self.half)..end.saturating_mul(self.half);
        let Some(light) = light.slice(pixels) else {
            return;
        };
        match self.half {
            1 => lower_chunks::<1>(light, self.shift, heights),
            2 => lower_chunks::<2>(light, self.shift, heights),
            3 => lower_chunks::<3>(light, self.shift, heights),
            4 => lower_chunks::<4>(light, self.shift, heights),
            5 => lower_chunks::<5>(light, self.shift, heights),
            6 => lower_chunks::<6>(light, self.shift, heights),
            7 => lower_chunks::<7>(light, self.shift, heights),
            8 => lower_chunks::<8>(light, self.shift, heights),
            9 => lower_chunks::<9>(light, self.shift, heights),
            10 => lower_chunks::<10>(light, self.shift, heights),
            11 => lower_chunks::<11>(light, self.shift, heights),
            12 => lower_chunks::<12>(light, self.shift, heights),
            half => lower_groups(light, half, self.shift, heights),
        }
        // The last box has no other one behind it.
        let of = |from: usize| {
            let heights = heights.get(from.saturating_add(1)..)?;
            heights.as_chunks().0.get(..places.len().div_ceil(4))
        };
        let (Some(right), Some(middle), Some(left)) =
            (of(0), of(self.apart), of(self.apart.saturating_mul(2)))
        else {
            return;
        };
        let mut highest = Highest {
            least: limited(self.least.wrapping_shr(self.shift)),
            above: self.above,
            number: None,
        };
        let fours = Fours {
            right,
            middle,
            left,
        };
        highest.compare(fours, places.len());
        self.above = highest.above;
        if let Some(number) = highest.number {
            self.other = Some(places.end.saturating_sub(number.saturating_add(1)));
        }
    }
}

/// Limited to 14 bits.
fn limited(height: u32) -> u16 {
    // Fits, because of the limit.
    height.min(0x3FFF) as u16
}

/// Writes the lower one of the sums of each box and the one behind it, shifted, from the last to the first.
/// The last has nothing behind it. The compiler knows how many pixels a box has.
#[inline(never)]
fn lower_chunks<const PIXELS: usize>(light: Light<'_>, shift: u32, to: &mut [u16]) {
    let (words, inverted) = light.words();
    let mut behind = 0;
    let mut lower = |words: [u16; PIXELS]| {
        let counts = words.map(|word| u32::from(word ^ inverted));
        let sum = counts.into_iter().fold(0, numeric::add_u32);
        lower_shifted(&mut behind, sum, shift)
    };
    let (rest, fours) = words.as_chunks::<PIXELS>().0.as_rchunks::<4>();
    let (to_fours, to_rest) = to
        .split_at_mut_checked(fours.as_flattened().len())
        .unwrap_or_default();
    let to_fours = to_fours.as_chunks_mut::<4>().0.iter_mut();
    for (to, &[a, b, c, d]) in to_fours.zip(fours.iter().rev()) {
        *to = [d, c, b, a].map(&mut lower);
    }
    for (to, &words) in to_rest.iter_mut().zip(rest.iter().rev()) {
        *to = lower(words);
    }
}

/// As [`lower_chunks`], for boxes of any size.
#[inline(always)]
fn lower_groups(light: Light<'_>, pixels: usize, shift: u32, to: &mut [u16]) {
    let mut behind = 0;
    for (to, group) in to.iter_mut().zip(light.groups(pixels).rev()) {
        *to = lower_shifted(&mut behind, group.sum(), shift);
    }
}

/// The lower one of a sum and the one behind it, shifted. It fits, because the shift leaves a sum of counts
/// at most 14 bits.
#[inline(always)]
fn lower_shifted(behind: &mut u32, sum: u32, shift: u32) -> u16 {
    let lower = core::mem::replace(behind, sum).min(sum);
    (lower.wrapping_shr(shift) & 0xffff) as u16
}

/// The highest other spot of some places.
struct Highest {
    /// What the heights exceed.
    least: u16,
    /// What the next one's height above the light on both sides exceeds.
    above: u16,
    /// The number of the highest one's place.
    number: Option<usize>,
}

/// Heights, and those on both sides, four at a time.
#[derive(Clone, Copy)]
struct Fours<'a> {
    right: &'a [[u16; 4]],
    middle: &'a [[u16; 4]],
    left: &'a [[u16; 4]],
}

impl Highest {
    /// Compares so many heights with those on both sides.
    fn compare(&mut self, fours: Fours<'_>, places: usize) {
        let mut first = 0;
        while let Some(behind) = self.next(fours, first) {
            first = behind.saturating_add(first);
            self.take(fours, first, places);
            first = first.saturating_add(1);
        }
    }

    /// Returns how many fours behind this one the first one is that has a higher spot.
    // Two heights at a time. In each difference, the highest bit of 16 is zero where a height exceeds the
    // other one.
    #[inline(never)]
    fn next(&self, fours: Fours<'_>, first: usize) -> Option<usize> {
        const ONES: u32 = 0x0001_0001;
        const HIGHEST: u32 = 0x8000;
        let two = |low: u16, high: u16| u32::from(low) | (u32::from(high) * 0x1_0000);
        let plus = |bits: u16| (HIGHEST | u32::from(bits)).wrapping_mul(ONES);
        let (least, above) = (plus(self.least), plus(self.above));
        let [right, middle, left] =
            [fours.right, fours.middle, fours.left].map(|it| it.get(first..).unwrap_or_default());
        right
            .iter()
            .zip(middle)
            .zip(left)
            .position(|((right, middle), left)| {
                let is_low = |a: usize, b: usize| {
                    let [left, middle, right] = [left, middle, right].map(|it| two(it[a], it[b]));
                    let low = above.wrapping_sub(middle);
                    low.wrapping_add(left) | low.wrapping_add(right) | least.wrapping_sub(middle)
                };
                !(is_low(0, 1) & is_low(2, 3)) & (HIGHEST * ONES) != 0
            })
    }

    #[cold]
    #[inline(never)]
    fn take(&mut self, fours: Fours<'_>, four: usize, places: usize) {
        let of = |it: &[[u16; 4]]| it.get(four).copied().unwrap_or_default();
        let beside = of(fours.right).into_iter().zip(of(fours.left));
        let first = four.saturating_mul(4);
        for ((number, height), (right, left)) in (first..places).zip(of(fours.middle)).zip(beside) {
            let above = height.saturating_sub(right.max(left));
            if height > self.least && above > self.above {
                self.above = limited(u32::from(above) + u32::from(above / HIGHER));
                self.number = Some(number);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::{Blocks, Polarity};
    use crate::tests::{bare, found_at, hash, row, spot_at, uniform};

    const LEVEL: u16 = 300;

    const CENTRE: usize = 1200;

    /// A spot at [`CENTRE`] that is as high as its level and its noise.
    fn spot() -> Spot {
        spot_at(CENTRE, 1, LEVEL.into(), (LEVEL.into(), LEVEL.into()))
    }

    /// The pixel of the other spot, whatever the words' polarity, and with and without blocks.
    fn other<const N: usize>(light: &[u16; N], width: f32) -> Option<usize> {
        let found = found_at(CENTRE as f32, width);
        let other = |row: &Row<'_>| match check(row, &spot(), &found, WorkBudget::of_row()) {
            Err(Fault::TwoSpots { other, .. }) => Some(other.to_f32() as usize),
            _ => None,
        };
        let others = [Polarity::Rising, Polarity::Falling].map(|polarity| {
            let geometry = bare(N, polarity);
            let words = light.map(|count| count ^ geometry.inverted());
            let mut blocks = Blocks::NONE;
            let row = geometry.part_and_blocks(&words, &geometry.light, &mut blocks);
            let plain = geometry.row(&words).expect("a row");
            [other(&row.expect("a row")), other(&plain)]
        });
        assert!(
            others.iter().flatten().all(|&it| it == others[0][0]),
            "{others:?}"
        );
        others[0][0]
    }

    /// Another spot is as high as the spot, or there is none. Only a look for one takes from the budget.
    #[test]
    fn without_budget_a_row_that_may_have_another_spot_is_not_passed() {
        let mut small = WorkBudget::of_row();
        assert_eq!(small.pay(small.left() + 1), None);
        assert_eq!(small.pay(small.left() - WORK + 1), Some(()));
        let found = found_at(CENTRE as f32, 4.0);
        for (another, is_passed) in [(CENTRE, true), (CENTRE + 200, false)] {
            let light: [u16; 2000] = core::array::from_fn(|i| {
                let nearest = i.abs_diff(CENTRE).min(i.abs_diff(another));
                LEVEL + if nearest <= 8 { 1000 } else { 0 }
            });
            let check = |budget| check(&row(&light), &spot(), &found, budget);
            assert_eq!(check(small), Ok(is_passed), "{another}");
            assert_eq!(check(WorkBudget::of_row()).is_ok(), is_passed);
        }
    }

    fn boxes(width: f32) -> (usize, usize) {
        let half = ((0.5 * width) as usize).max(1);
        (half, ((4.0 * width) as usize).div_ceil(half))
    }

    /// A comb of lines as high as the spot has one such line as far off on either side of each. It ends at a
    /// line that has none beside it.
    #[test]
    fn a_comb_is_searched_to_its_ends() {
        for width in [10.5, 1.0, 2.5, 3.9, 4.0, 6.5, 17.0, 24.5, 30.0] {
            let (half, apart) = boxes(width);
            let period = half * apart;
            let comb: [u16; 3651] = core::array::from_fn(|i| match i {
                _ if i.abs_diff(CENTRE) <= 4 * half => LEVEL + 1000,
                _ if i.abs_diff(CENTRE) <= 2 * period => LEVEL,
                _ if i % period < 2 * half => LEVEL + 1000,
                _ => LEVEL,
            });
            assert_eq!(other(&comb, width), None, "{width}");
            for line in [1, comb.len() / period - 2] {
                let mut light = comb;
                for dark in [line - 1, line + 1] {
                    light[dark * period..][..2 * half].fill(LEVEL);
                }
                assert_eq!(other(&light, width), Some(line * period + half), "{width}");
            }
        }
    }

    /// At the row's ends and in its middle: two boxes at each step about the centre, and two on each side.
    #[test]
    fn the_own_height_is_that_of_its_definition() {
        let light: [u16; 700] = core::array::from_fn(|i| (hash(i + 1) >> 21) as u16);
        for half in [1, 2, 3, 7, 13, 85usize] {
            let apart = 5;
            let box_of = |from: i64| {
                let pixels = from..from + half as i64;
                let sum = pixels.map(|i| light.get(usize::try_from(i).ok()?).copied());
                sum.map(|it| it.map(u32::from)).sum::<Option<u32>>()
            };
            let two = |from: i64| Some(box_of(from)?.min(box_of(from + half as i64)?));
            let ends = [0, 1, half, 2 * half, apart * half, 350, 698, 699];
            for centre in ends.into_iter().chain(700 - 2 * half..700) {
                let from = centre.saturating_sub(2 * half);
                let steps = (0..=2 * STEPS).map(|step| from + half * step / STEPS);
                let heights = steps.filter(|&pixel| pixel <= centre).filter_map(|pixel| {
                    let (pixel, off) = (pixel as i64, (apart * half) as i64);
                    // The sides begin a whole number of boxes from the first step.
                    let beside = match (two(pixel - off), two(pixel + off)) {
                        (Some(left), Some(right)) => left.midpoint(right),
                        (one, other) => one.or(other)?,
                    };
                    Some(two(pixel)?.saturating_sub(beside))
                });
                let expected = heights.max().unwrap_or_default();
                let found = own_height((&light).into(), centre, half, apart);
                assert_eq!(found, expected, "{centre}, {half}");
            }
        }
    }

    /// On rows of random light, by the definition: a spot is found if there is one, and none is higher by
    /// more than an eighth.
    #[test]
    fn nearly_the_highest_spot_is_found() {
        let mut random = 1;
        let mut numbers = [0; 2];
        for number in 0..600 {
            let width = [1.0, 1.9, 2.3, 3.9, 4.2, 5.0, 6.6, 9.9][number % 8];
            let (half, apart) = boxes(width);
            // From a few bright boxes to many.
            let bright = 1 << (number % 11);
            let end = 2300 + number % 19;
            let mut count = LEVEL;
            let light: [u16; 2330] = core::array::from_fn(|i| {
                if i % (2 * half) == 0 {
                    let is_bright = uniform(&mut random) * 1024.0 < bright as f32 && i < end;
                    let above = (uniform(&mut random) * 2000.0) as u16;
                    count = LEVEL + if is_bright { above } else { 0 };
                }
                let is_spot = i.abs_diff(CENTRE) <= 2 * half;
                if is_spot { LEVEL + 1500 } else { count }
            });
            let sums: [u32; 2330] = core::array::from_fn(|i| {
                let sum = |i: usize| {
                    let light = light.iter().skip(i).take(half);
                    light.map(|&it| u32::from(it)).sum()
                };
                u32::min(sum(i * half), sum((i + 1) * half))
            });
            let places = light.len() / half - 1;
            let own = own_height((&light).into(), CENTRE, half, apart);
            let enough = (SHARE * own as f32) as u32;
            let score = |place: usize| {
                let pixel = (place + 1) * half;
                let beside = sums[place - apart].max(sums[place + apart]);
                let above = sums[place].saturating_sub(beside);
                let is_spot = pixel.abs_diff(CENTRE) > (4.0 * width) as usize
                    && sums[place] > u32::from(LEVEL) * half as u32 + enough
                    && above > enough;
                is_spot.then_some(above)
            };
            let highest = (apart..places - apart).filter_map(score).max();
            let found = other(&light, width).map(|pixel| pixel / half - 1);
            let height = found.map(|place| score(place).expect("a spot"));
            assert_eq!(height.is_some(), highest.is_some(), "{number}");
            let most = height.map(|it| it + it / 8);
            assert!(most >= highest, "{number}: {height:?} of {highest:?}");
            numbers[usize::from(found.is_some())] += 1;
        }
        assert!(numbers.iter().all(|&number| number > 50), "{numbers:?}");
    }
}
