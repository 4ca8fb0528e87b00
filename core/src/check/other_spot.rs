//! Tests whether another spot on the row is nearly as high.
//!
//! The coarse search compares the light that its kernel gathers, and a narrower or wider spot of equal height
//! gathers less or more. This check compares heights. It takes the sums over two neighbouring half widths, of
//! which the lower one counts, so that a single bad pixel is no spot.

use core::ops::Range;

use crate::centre::RowCentre;
use crate::fault::Fault;
use crate::numeric;
use crate::row::{BLOCK, Light, MAX_PIXELS, Row};
use crate::spot::Spot;
use crate::units::{Counts, Pixels};

/// Widths from the centre to the nearest other spot. A closer one shows in the row's mirror image.
const NEAREST_OTHER: f32 = 4.0;

/// The least share of the spot's height that another spot has. The coarse search confuses two spots from a
/// share of 0.8 on. A box of half a width loses up to a tenth more of a spot that is 0.7 times as wide, or
/// that lies between two boxes.
const SHARE: f32 = 0.62;

/// The most boxes, higher than the light to their left, that are compared with the light to their right. Wide
/// light below the spot has no such boxes.
const MOST_COMPARED: u32 = 512;

/// Searches all of the row for another spot. Called for a frame's first row only. `false` if the search has
/// not reached the row's end, because more than [`MOST_COMPARED`] boxes rise as high as the spot.
///
/// # Errors
/// [`Fault::TwoSpots`] if there is another spot.
#[inline(never)]
pub(super) fn check(row: &Row<'_>, spot: &Spot, found: &RowCentre) -> Result<bool, Fault> {
    let light = row.light();
    let width = found.width.to_f32();
    // A width is at most 170 pixels: `as` cuts off, and saturates.
    let half = ((0.5 * width) as usize).clamp(1, MAX_PIXELS);
    let centre = usize::try_from(found.centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let separation = ((NEAREST_OTHER * width) as usize).min(MAX_PIXELS);
    let height = |from: usize| height(light, from, half);
    let before = |from: usize| height(from.checked_sub(separation)?);
    let behind = |from: usize| height(from.saturating_add(separation));
    // The spot itself may lie at the row's end, or on a slope.
    let own = |from: usize| {
        let (left, right) = (before(from), behind(from));
        let beside = left.or(right)?.midpoint(right.or(left)?);
        Some(height(from)?.saturating_sub(beside))
    };
    // Up to the centre, in steps of an eighth of a width: 16 at most.
    let first = centre.saturating_sub(half.wrapping_mul(2));
    let step = (half / 4).max(1);
    let near = (0..16usize).map(|i| first.saturating_add(i.wrapping_mul(step)));
    let near = near.filter(|&from| from <= centre);
    let own = near.filter_map(own).max().unwrap_or_default();
    let enough = (SHARE * own as f32) as u32;
    let far = |from: usize| from.saturating_add(half).abs_diff(centre) > separation;
    // Boxes side by side. Nearly all do not stand out from the level under the spot.
    let level = spot.background.level_bits().unsigned_abs();
    let level = level.saturating_mul(half as u32) >> Counts::FRACTION;
    let least = level.saturating_add(enough);
    let (mut compared, mut highest, mut other) = (0, enough, None);
    let take = &mut |first: usize| {
        // The box with the one before it, and with the one behind it.
        for from in [first.checked_sub(half), Some(first)].into_iter().flatten() {
            if compared > MOST_COMPARED || !far(from) {
                continue;
            }
            let Some(height) = height(from).filter(|height| *height > least) else {
                continue;
            };
            // The height above the light on both sides. So a background that rises is no spot, and neither is
            // the start or the end of its rise. The higher one of two spots counts, and the last one of two
            // equal ones.
            let above = |beside: u32| {
                let above = height.saturating_sub(beside);
                (above > enough && above >= highest).then_some(above)
            };
            let Some(left) = before(from).and_then(above) else {
                continue;
            };
            compared = numeric::add_u32(compared, 1);
            if compared <= MOST_COMPARED
                && let Some(right) = behind(from).and_then(above)
            {
                highest = left.min(right);
                other = Some(from);
            }
        }
    };
    high_boxes(row, half, least, take);
    match other {
        Some(from) => Err(Fault::TwoSpots {
            centre: found.centre,
            // On a row of at most 2^12 pixels.
            other: Pixels::from_int(from.saturating_add(half) as i32),
        }),
        None => Ok(compared <= MOST_COMPARED),
    }
}

/// The lower one of two boxes side by side.
#[inline(always)]
fn height(light: Light<'_>, from: usize, half: usize) -> Option<u32> {
    let (words, inverted) = light.words();
    let words = words.get(from..)?;
    if half == 1 {
        let [a, b] = *words.first_chunk()?;
        return Some((a ^ inverted).min(b ^ inverted).into());
    }
    let two = light.slice(from..from.saturating_add(half.saturating_mul(2)))?;
    let (first, second) = two.split(half);
    Some(first.sum().min(second.sum()))
}

/// Calls `take` with the first pixel of every second box whose sum exceeds `least`. A spot needs two such
/// boxes side by side, and one of these is a second one.
///
/// A box has at most the light of the row's blocks in which it lies: only where these exceed `least` are
/// boxes summed.
fn high_boxes(row: &Row<'_>, pixels: usize, least: u32, take: &mut dyn FnMut(usize)) {
    let light = row.light();
    let pixels = pixels.max(1);
    let twice = pixels.saturating_mul(2).max(1);
    // The boxes that begin on some pixels.
    let mut visit = |begins: Range<usize>| {
        let number = begins
            .start
            .saturating_add(twice.wrapping_sub(1))
            .checked_div(twice);
        let mut first = number.unwrap_or_default().saturating_mul(twice);
        while first < begins.end {
            let one = light.slice(first..first.saturating_add(pixels));
            if one.is_some_and(|one| one.sum() > least) {
                take(first);
            }
            first = first.saturating_add(twice);
        }
    };
    let blocks = row.blocks();
    // A box that begins in a block lies in that block and in those behind it, so many in all.
    let reach = pixels.saturating_add(BLOCK - 1).div_ceil(BLOCK);
    let whole = blocks.len().saturating_mul(BLOCK) == light.len();
    if !whole || blocks.len() < reach {
        visit(0..light.len());
        return;
    }
    let pixels_of = |block: usize| {
        let begin = block.saturating_mul(BLOCK);
        begin..begin.saturating_add(BLOCK)
    };
    let see = &mut |block| visit(pixels_of(block));
    if reach == 2 {
        high_pairs(blocks, least, see);
    } else {
        high_blocks(blocks, reach, least, see);
    }
    // Fewer blocks than that are behind the last ones.
    visit(pixels_of(blocks.len().saturating_sub(reach)).start..light.len());
}

/// As [`high_blocks`] for two blocks.
#[inline(never)]
fn high_pairs(blocks: &[u16], least: u32, see: &mut dyn FnMut(usize)) {
    const PART: usize = 8;
    // A block with no other block behind it but the last is left to the caller.
    let blocks = blocks.split_last().map_or(blocks, |(_, blocks)| blocks);
    let (parts, rest) = blocks.as_chunks::<PART>();
    let mut before = 0;
    for (number, part) in (0..MAX_PIXELS).zip(parts) {
        let mut last = before;
        // All are below 2^31: the highest bit is set where a pair exceeds `least`.
        let bits = part.iter().fold(0, |bits, &block| {
            let pair = numeric::add_u32(last, block.into());
            last = block.into();
            bits | least.wrapping_sub(pair)
        });
        if bits >> 31 != 0 {
            see_pairs(before, part, number.saturating_mul(PART), least, see);
        }
        before = last;
    }
    let number = parts.len().saturating_mul(PART);
    see_pairs(before, rest, number, least, see);
}

/// Calls `see` with the first block of each pair that exceeds `least`: the first pair is that of `before` and
/// the block at `number`.
#[cold]
fn see_pairs(before: u32, blocks: &[u16], number: usize, least: u32, see: &mut dyn FnMut(usize)) {
    let mut before = before;
    for (block, &next) in (number..usize::MAX).zip(blocks) {
        if numeric::add_u32(before, next.into()) > least
            && let Some(first) = block.checked_sub(1)
        {
            see(first);
        }
        before = next.into();
    }
}

/// Calls `see` with each block that has so many blocks behind it, if it and all but the last of these
/// together exceed `least`.
// A loop out of line, so that it keeps nothing but sums.
#[inline(never)]
fn high_blocks(blocks: &[u16], number: usize, least: u32, see: &mut dyn FnMut(usize)) {
    let (first, entering) = blocks.split_at_checked(number).unwrap_or_default();
    let mut sum = first
        .iter()
        .map(|&sum| sum.into())
        .fold(0, numeric::add_u32);
    for ((block, &leaves), &enters) in (0..MAX_PIXELS).zip(blocks).zip(entering) {
        if sum > least {
            see(block);
        }
        // A row has at most 2^12 pixels of 12 bits, and a block that leaves was in the sum.
        sum = numeric::add_u32(sum, enters.into()).wrapping_sub(leaves.into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::{Blocks, Geometry};

    /// Boxes of all sizes, on rows with and without blocks, and with a last box that is not whole.
    #[test]
    fn every_second_box_above_the_limit_is_found() {
        let words: [u16; 104] =
            core::array::from_fn(|i| (i as u32).wrapping_mul(2_654_435_761) as u16 >> 4);
        let mut blocks = Blocks::NONE;
        for (length, pixels) in (96..=104).flat_map(|length| (1..=20).map(move |it| (length, it))) {
            let geometry = Geometry {
                words: 104,
                light: 0..length,
                shielded: 0..0,
                ..crate::sensor_heads::tcd1304dg()
            };
            let row = geometry.row_and_blocks(&words, &mut blocks).expect("a row");
            let light = row.light();
            for row in [row, geometry.row(&words).expect("a row")] {
                let least = 2400 * pixels as u32;
                let mut found = [false; 104];
                let take = &mut |first: usize| {
                    assert!(!found[first]);
                    found[first] = true;
                };
                high_boxes(&row, pixels, least, take);
                for (first, found) in found.into_iter().enumerate() {
                    let is_second = first % (2 * pixels) == 0;
                    let counts = light.slice(first..first + pixels);
                    let sum = counts.map(|counts| counts.iter().map(u32::from).sum());
                    assert_eq!(found, is_second && sum > Some(least), "{pixels} at {first}");
                }
            }
        }
    }
}
