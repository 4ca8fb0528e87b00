//! Places along a range of centres, at which curves have values.

use super::numeric;

/// Places at which a calibration has its errors and its own spot, evenly over the calibration's centres.
pub const PLACES: usize = 9;

/// The last of [`PLACES`] before a point, and the share of the way to the next one, Q16. `along` is the share
/// of the way from the first to the last, Q16, and limited to 0 to 1.
pub(crate) fn place_at(along: i32) -> (usize, i32) {
    const LAST: usize = PLACES - 1;
    let places = along.clamp(0, 1 << 16).wrapping_mul(numeric::to_i32(LAST));
    let index = usize::try_from(places >> 16)
        .unwrap_or_default()
        .min(LAST - 1);
    (
        index,
        places.wrapping_sub(numeric::to_i32(index).wrapping_mul(1 << 16)),
    )
}
