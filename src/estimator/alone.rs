//! Whether another spot on the row is nearly as high.
//!
//! The coarse search compares what its kernel gathers; a narrower or a wider spot of the same height gathers less or more. Here it is the height: the
//! sum over half a width, and that over the next, of which the lower counts, so that a single bad pixel is no spot.

use crate::estimator::RowCentre;
use crate::proven;
use crate::reading::Fault;
use crate::row::MAX_PIXELS;
use crate::units::Pixels;

/// Closer than so many widths it would be seen in the row's mirror image.
const APART: f32 = 4.0;

/// The other has this share of the height at least, as in the coarse search. 0.8 is where two spots are no longer told apart by it, and a box of half a width takes off up to a tenth
/// more of a spot that is 0.7 times as wide.
const SHARE: f32 = 0.66;

/// Looks over all of the row, which the search of a frame's first row does too.
///
/// # Errors
/// [`Fault::TwoSpots`].
#[inline(never)]
pub(super) fn is_alone(light: &[u16], found: &RowCentre) -> Result<(), Fault> {
    let width = found.width.to_f32();
    // A width is at most 170 pixels: `as` cuts off, and saturates.
    let half = ((0.5 * width) as usize).clamp(1, MAX_PIXELS);
    let centre = usize::try_from(found.centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let apart = ((APART * width) as usize).min(MAX_PIXELS);
    // Below 2^7 * 2^12.
    let sum = |from: usize| -> Option<u32> {
        let pixels = light.get(from..from.saturating_add(half))?;
        Some(
            pixels
                .iter()
                .fold(0, |sum, &count| proven::add_u32(sum, count.into())),
        )
    };
    let height = |from: usize| Some(sum(from)?.min(sum(from.saturating_add(half))?));
    let beside = |from: usize| {
        let left = from.checked_sub(apart).and_then(height);
        (left, height(from.saturating_add(apart)))
    };
    // Above what is beside it, so that a background that rises is no spot, and nor is where it begins or ends.
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
    let near = centre.saturating_sub(half.wrapping_mul(2))..=centre;
    let own = near.filter_map(own).max().unwrap_or_default();
    let enough = (SHARE * own as f32) as u32;
    let far = |from: usize| from.saturating_add(half).abs_diff(centre) > apart;
    let other = (0..light.len())
        .filter(|&from| far(from) && height(from).is_some_and(|height| height > enough))
        .filter_map(|from| Some((above(from)?, from)))
        .max();
    match other {
        Some((above, from)) if above > enough => Err(Fault::TwoSpots {
            centre: found.centre,
            // On a row of at most 2^12 pixels.
            other: Pixels::from_int(from.saturating_add(half) as i32),
        }),
        _ => Ok(()),
    }
}
