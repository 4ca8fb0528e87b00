//! Places along a range of centres, at which curves have values.

/// Places at which a calibration has its errors and its own spot, evenly over the calibration's centres.
pub const PLACES: usize = 9;

/// The last of [`PLACES`] before a point, and the share of the way to the next one, 0 to 1. `along` is
/// limited to 0 to 1; not-a-number counts as 0.
pub(crate) fn place_at(along: f32) -> (usize, f32) {
    const LAST: usize = PLACES - 1;
    let place = if along > 0.0 { along } else { 0.0 } * LAST as f32;
    let index = super::numeric::whole_usize(place).min(LAST - 1);
    let part = place - index as f32;
    (index, if part < 1.0 { part } else { 1.0 })
}
