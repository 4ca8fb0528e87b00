//! Tests whether another spot on the row is nearly as high.
//!
//! The coarse search compares the light that its kernel gathers, and a narrower or wider spot of equal height
//! gathers less or more. This check compares heights. It takes the sums over two neighbouring half widths, of
//! which the lower one counts, so that a single bad pixel is no spot.

use crate::centre::RowCentre;
use crate::fault::Fault;
use crate::numeric;
use crate::row::{Light, MAX_PIXELS};
use crate::spot::Spot;
use crate::units::{Counts, Pixels};

/// Widths from the centre to the nearest other spot. A closer one shows in the row's mirror image.
const NEAREST_OTHER: f32 = 4.0;

/// The least share of the spot's height that another spot has. The coarse search confuses two spots from a
/// share of 0.8 on. A box of half a width loses up to a tenth more of a spot that is 0.7 times as wide, or
/// that lies between two boxes.
const SHARE: f32 = 0.62;

/// The most boxes that are compared with the light beside them. Of 35,000 rows with flaws six have more boxes
/// as high as the spot.
const MOST_COMPARED: u32 = 512;

/// Searches all of the row for another spot. Called for a frame's first row only. `false` if the search has
/// not reached the row's end, because more boxes than [`MOST_COMPARED`] are as high as the spot.
///
/// # Errors
/// [`Fault::TwoSpots`] if there is another spot.
#[inline(never)]
pub(super) fn check(light: Light<'_>, spot: &Spot, found: &RowCentre) -> Result<bool, Fault> {
    let width = found.width.to_f32();
    // A width is at most 170 pixels: `as` cuts off, and saturates.
    let half = ((0.5 * width) as usize).clamp(1, MAX_PIXELS);
    let centre = usize::try_from(found.centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let separation = ((NEAREST_OTHER * width) as usize).min(MAX_PIXELS);
    let sum = |from: usize| Some(sum(light.slice(from..from.saturating_add(half))?));
    let height = |from: usize| Some(sum(from)?.min(sum(from.saturating_add(half))?));
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
            compared = numeric::add_u32(compared, 1);
            // The height above the light on both sides. So a background that rises is no spot, and neither is
            // the start or the end of its rise. The higher one of two spots counts, and the last one of two
            // equal ones.
            let above = |beside: u32| {
                let above = height.saturating_sub(beside);
                (above > enough && above >= highest).then_some(above)
            };
            if compared <= MOST_COMPARED
                && let Some(left) = before(from).and_then(above)
                && let Some(right) = behind(from).and_then(above)
            {
                highest = left.min(right);
                other = Some(from);
            }
        }
    };
    match half {
        1 => high_boxes::<1>(light, half, least, take),
        2 => high_boxes::<2>(light, half, least, take),
        3 => high_boxes::<3>(light, half, least, take),
        4 => high_boxes::<4>(light, half, least, take),
        5 => high_boxes::<5>(light, half, least, take),
        _ => high_boxes::<0>(light, half, least, take),
    }
    match other {
        Some(from) => Err(Fault::TwoSpots {
            centre: found.centre,
            // On a row of at most 2^12 pixels.
            other: Pixels::from_int(from.saturating_add(half) as i32),
        }),
        None => Ok(compared <= MOST_COMPARED),
    }
}

/// Calls `take` with the first pixel of every second box whose sum exceeds `least`. A spot needs two such
/// boxes side by side, and one of these is a second one. `PIXELS` is the number of pixels in a box, so that
/// the compiler knows it, or zero if it is `pixels`.
#[inline(always)]
fn high_boxes<const PIXELS: usize>(
    light: Light<'_>,
    pixels: usize,
    least: u32,
    take: &mut dyn FnMut(usize),
) {
    let pixels = if PIXELS == 0 { pixels.max(1) } else { PIXELS };
    let twice = pixels.saturating_mul(2);
    let mut visit = |first: usize, two: Light<'_>| {
        if let Some(one) = two.slice(..pixels)
            && sum(one) > least
        {
            take(first);
        }
    };
    let mut first = 0;
    for two in light.groups(twice) {
        visit(first, two);
        first = numeric::add_usize(first, twice);
    }
    let (_, rest) = light.split(first);
    visit(first, rest);
}

/// A sum of counts. A row has at most 2^12 pixels of 12 bits. Where words fall with light, a count is full
/// scale less a word.
#[inline(always)]
fn sum(counts: Light<'_>) -> u32 {
    let (words, inverted) = counts.words();
    let (fours, rest) = words.as_chunks::<4>();
    let add = |sum: u32, word: &u16| numeric::add_u32(sum, u32::from(*word));
    let sum = fours.iter().fold(0, |sum, four| four.iter().fold(sum, add));
    let sum = rest.iter().fold(sum, add);
    if inverted == 0 {
        sum
    } else {
        (words.len() as u32)
            .wrapping_mul(inverted.into())
            .wrapping_sub(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum over boxes of all sizes, as `check` calls it, on a row whose last box is not whole.
    #[test]
    fn every_second_box_above_the_limit_is_found() {
        let light: [u16; 99] =
            core::array::from_fn(|i| (i as u32).wrapping_mul(2_654_435_761) as u16 >> 4);
        for pixels in 1..=9 {
            let least = 2000 * pixels as u32;
            let mut found = [false; 99];
            let take = &mut |first: usize| {
                assert!(!found[first]);
                found[first] = true;
            };
            match pixels {
                1 => high_boxes::<1>((&light).into(), pixels, least, take),
                2 => high_boxes::<2>((&light).into(), pixels, least, take),
                5 => high_boxes::<5>((&light).into(), pixels, least, take),
                _ => high_boxes::<0>((&light).into(), pixels, least, take),
            }
            for (first, found) in found.into_iter().enumerate() {
                let is_second = first % (2 * pixels) == 0;
                let counts = light.get(first..first + pixels);
                let sum = counts.map(|counts| counts.iter().map(|&it| u32::from(it)).sum());
                assert_eq!(found, is_second && sum > Some(least), "{pixels} at {first}");
            }
        }
    }
}
