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

/// Searches all of the row for another spot. Called for a frame's first row only.
///
/// # Errors
/// [`Fault::TwoSpots`] if there is another spot.
#[inline(never)]
pub(super) fn check(light: Light<'_>, spot: &Spot, found: &RowCentre) -> Result<(), Fault> {
    let width = found.width.to_f32();
    // A width is at most 170 pixels: `as` cuts off, and saturates.
    let half = ((0.5 * width) as usize).clamp(1, MAX_PIXELS);
    let centre = usize::try_from(found.centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let separation = ((NEAREST_OTHER * width) as usize).min(MAX_PIXELS);
    // At most 2^12 pixels of 12 bits: a row has no more.
    let sum = |from: usize| -> Option<u32> {
        let pixels = light.slice(from..from.saturating_add(half))?;
        Some(
            pixels
                .iter()
                .fold(0, |sum, count| numeric::add_u32(sum, count.into())),
        )
    };
    let height = |from: usize| Some(sum(from)?.min(sum(from.saturating_add(half))?));
    let beside = |from: usize| {
        let left = from.checked_sub(separation).and_then(height);
        (left, height(from.saturating_add(separation)))
    };
    // The height above the light on both sides. So a background that rises is no spot, and neither is the
    // start or the end of its rise.
    let above = |from: usize| match beside(from) {
        (Some(left), Some(right)) => Some(height(from)?.saturating_sub(left.max(right))),
        _ => None,
    };
    // The spot itself may lie at the row's end, or on a slope.
    let own = |from: usize| {
        let (left, right) = beside(from);
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
    // One box after the other, each summed once. Nearly all boxes do not stand out from the level under the
    // spot: these are skipped.
    let level = spot.background.level_bits().unsigned_abs();
    let level = level.saturating_mul(half as u32) >> Counts::FRACTION;
    let least = level.saturating_add(enough);
    let (mut before, mut other) = (0, None);
    let mut to = 0usize;
    for _ in 0..light.len() {
        let Some(sum) = sum(to) else {
            break;
        };
        let from = to.saturating_sub(half);
        to = to.saturating_add(half);
        if before.min(sum) > least && far(from) {
            other = other.max(above(from).map(|above| (above, from)));
        }
        before = sum;
    }
    match other {
        Some((above, from)) if above > enough => Err(Fault::TwoSpots {
            centre: found.centre,
            // On a row of at most 2^12 pixels.
            other: Pixels::from_int(from.saturating_add(half) as i32),
        }),
        _ => Ok(()),
    }
}
