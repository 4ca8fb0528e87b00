//! Measures the spot's width at half maximum. The centroid chooses its window by this width.
//!
//! The search goes outwards from the highest pixels to where the counts fall below half of the height. A
//! gaussian's full width there is sqrt(8 ln 2) = 2.3548 sigma. Sums over a quarter to a half of the coarse
//! search's block, about a quarter of sigma, smooth the counts. A sum over n pixels adds n^2/12 to sigma^2,
//! the pixel's own width included; this is subtracted again. Crossings are interpolated linearly. The width
//! found is up to a fifth too large for spots of 0.8 to 1.2 pixels, and up to 3 % from 2 pixels.

use crate::base::numeric::{self, product, root, saturated};
use crate::base::{Counts, Fault, Pixels};
use crate::centre::{RowCentre, position_on_row};
use crate::row::{LARGEST_COUNT, Light, MAX_PIXELS};
use crate::spot::Spot;

/// Sigma over a gaussian's full width at half maximum, 1 / sqrt(8 ln 2), Q31.
const SIGMA_PER_FULL_WIDTH: i32 = 911_952_339;
/// A gaussian's half width at half maximum over sigma, sqrt(2 ln 2), Q30.
const HALF_WIDTH: i32 = 1_264_234_385;
/// The pixel's own width squared, 1/12, Q32.
const OF_PIXEL: i64 = 357_913_941;
/// The narrowest and the widest spot. A hot pixel alone looks like a spot of 0.3. A spot of 0.6,
/// which is narrower than any optics makes it, looks like one of at least 0.55. At the other end
/// [`crate::spot::find`] gives up.
pub const WIDTHS: core::ops::RangeInclusive<Pixels> =
    Pixels::from_positive_f32(0.5)..=Pixels::from_int(170);

/// The half maximum of a spot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfMaximum {
    /// The highest place, on the row. `left` and `right` are the distances from here to where the counts fall
    /// to half: `None` where the row ends first.
    pub top: Pixels,
    /// To the left.
    pub left: Option<Pixels>,
    /// To the right.
    pub right: Option<Pixels>,
    /// Height of the smoothed counts above the level.
    pub height: Counts,
    /// Pixels that were summed.
    pub smoothed: u16,
}

/// Finds the width that chooses a window. If the centre of the row before is within a width of this
/// spot, this is the width of the row before. Otherwise the half maximum gives the width.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where the row ends before the counts fall to half, [`Fault::NoSpot`] where they
/// never do, or the width is outside [`WIDTHS`].
pub fn width(light: Light<'_>, spot: &Spot, before: Option<&RowCentre>) -> Result<Pixels, Fault> {
    let start = position_on_row(light, spot)?;
    if let Some(RowCentre { centre, width, .. }) = before {
        let moved = centre.to_bits().abs_diff(start.to_bits());
        if WIDTHS.contains(width) && moved <= width.to_bits().unsigned_abs() {
            return Ok(*width);
        }
    }
    let half = find(light, spot)?;
    let (Some(left), Some(right)) = (half.left, half.right) else {
        return Err(Fault::SpotAtEdge { centre: half.top });
    };
    let full_width = left.to_bits().saturating_add(right.to_bits());
    let width = half.sigma(Pixels::from_bits(full_width));
    if WIDTHS.contains(&width) {
        Ok(width)
    } else {
        Err(spot.no_spot())
    }
}

impl HalfMaximum {
    /// Converts a full width at half maximum to sigma, and subtracts the smoothing.
    pub fn sigma(&self, full_width: Pixels) -> Pixels {
        let smoothed = i32::from(self.smoothed);
        let sigma = saturated(product(full_width.to_bits(), SIGMA_PER_FULL_WIDTH) >> 31);
        // At most 2^6 pixels were summed: 2^41.
        let of_smoothing = numeric::mul_i64(product(smoothed, smoothed), OF_PIXEL);
        Pixels::from_bits(root(product(sigma, sigma).saturating_sub(of_smoothing)))
    }
}

/// Finds the half maximum: walks out from the highest place within a block of the spot's centre.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where the spot's centre is not on the row. [`Fault::NoSpot`] where nothing rises
/// above the level, or the counts do not fall to half within four blocks: a spot's width is at most two
/// blocks.
pub fn find(light: Light<'_>, spot: &Spot) -> Result<HalfMaximum, Fault> {
    let start = position_on_row(light, spot)?;
    let block = spot.block();
    let smoothed = (block / 2).max(1);
    // The spot's centre is on the row.
    let (before, near) = light.split(spot.centre.saturating_sub(block + smoothed / 2));
    let before = before.len();
    let near = near.slice(..2 * block + smoothed).unwrap_or(near);
    let Some((place, sum)) = highest(near, smoothed) else {
        return Err(Fault::SpotAtEdge { centre: start });
    };
    let first = before.saturating_add(place);
    // At most 64 counts of 12 bits in Q8: below 2^26.
    let in_sum = numeric::to_i32(smoothed);
    let level = numeric::mul_i32(spot.background.level_bits(), in_sum);
    let height = in_q8(sum).saturating_sub(level);
    if height <= 0 {
        return Err(spot.no_spot());
    }
    let half = numeric::add_i32(level, height / 2);
    let reach = 4 * block;
    // The sum moves by a pixel: one enters, and the one `smoothed` pixels further back leaves.
    let (left, from_top) = light.split(first);
    let (_, right) = from_top.split(smoothed);
    let (to_top, _) = light.split(first.saturating_add(smoothed));
    let left = left.iter().rev().zip(to_top.iter().rev());
    let left = walk(left, sum, half, reach);
    let right = walk(right.iter().zip(from_top.iter()), sum, half, reach);
    if left == Walk::NeverHalf || right == Walk::NeverHalf {
        return Err(spot.no_spot());
    }
    // A place is below 4096 pixels. The middle of a sum over n pixels is (n - 1) / 2 pixels to the right of
    // its first.
    let half_sum = (in_sum - 1) * (1 << (Pixels::FRACTION - 1));
    let first = Pixels::from_int(numeric::to_i32(first)).to_bits();
    Ok(HalfMaximum {
        top: Pixels::from_bits(first.saturating_add(half_sum)),
        left: left.distance(),
        right: right.distance(),
        height: Counts::from_bits(height / in_sum),
        smoothed: numeric::to_u16(smoothed),
    })
}

/// Finds where the sum over `pixels` neighbours is highest, and that sum: below 64 * 2^12. `None` where there
/// are fewer pixels.
fn highest(near: Light<'_>, pixels: usize) -> Option<(usize, i32)> {
    let (first, entering) = (near.slice(..pixels)?, near.slice(pixels..)?);
    let mut sum = first.iter().map(i32::from).fold(0, numeric::add_i32);
    let mut best = (0, sum);
    for (i, (enters, leaves)) in (1..MAX_PIXELS).zip(entering.iter().zip(near.iter())) {
        sum = moved(sum, enters, leaves);
        if sum > best.1 {
            best = (i, sum);
        }
    }
    Some(best)
}

fn moved(sum: i32, enters: u16, leaves: u16) -> i32 {
    numeric::add_i32(sum, i32::from(enters) - i32::from(leaves))
}

/// Converts a sum of at most [`MOST_SMOOTHED`] counts to Q8.
fn in_q8(sum: i32) -> i32 {
    numeric::mul_i32(sum, 1 << Counts::FRACTION)
}

/// The most pixels in a sum: half of the largest block.
const MOST_SMOOTHED: u32 = 64;

// Twice the largest sum fits in Q8.
const _: () =
    assert!((2 * LARGEST_COUNT as u64 * MOST_SMOOTHED as u64) << Counts::FRACTION < 1 << 31);

#[derive(Clone, Copy, PartialEq)]
enum Walk {
    /// The counts fell to half at this distance.
    Half(Pixels),
    Edge,
    NeverHalf,
}

impl Walk {
    const fn distance(self) -> Option<Pixels> {
        match self {
            Self::Half(distance) => Some(distance),
            Self::Edge | Self::NeverHalf => None,
        }
    }
}

/// Moves the sum by a pixel at a time until it falls below `half` (Q8). Each step is the count that enters
/// and the one that leaves.
fn walk(steps: impl Iterator<Item = (u16, u16)>, mut sum: i32, half: i32, reach: usize) -> Walk {
    let mut walked = 0;
    // The least whole sum that is not below half.
    let least = half.saturating_add((1 << Counts::FRACTION) - 1) >> Counts::FRACTION;
    for (enters, leaves) in steps.take(reach) {
        let next = moved(sum, enters, leaves);
        if next < least {
            // The sum before was not below half, so the quotient is within 0 and 1.
            let above = numeric::sub_i32(in_q8(sum), half);
            let fall = numeric::sub_i32(in_q8(sum), in_q8(next));
            let part = product(above, 1 << Pixels::FRACTION).checked_div(fall.into());
            let walked = product(numeric::to_i32(walked), 1 << Pixels::FRACTION);
            let distance = numeric::add_i64(walked, part.unwrap_or_default());
            return Walk::Half(Pixels::from_bits(saturated(distance)));
        }
        sum = next;
        walked += 1;
    }
    if walked < reach {
        Walk::Edge
    } else {
        Walk::NeverHalf
    }
}

/// Updates the width after a row, for an estimator whose window came from the old width. The width moves a
/// quarter of the way to what the counts at the two half maxima say. So it follows the spot over the rows,
/// and a row's noise hardly moves it.
///
/// If a gaussian is wider than assumed by a small part p, the count there is 0.5 + ln(2) p of the height.
pub fn follow(light: Light<'_>, spot: &Spot, centre: Pixels, width: Pixels) -> Pixels {
    /// 1 / ln 2, Q30.
    const PER_LN2: i32 = 1_549_082_005;
    // A width is below 2^8 pixels. The pixel's own width adds to it.
    let squared = product(width.to_bits(), width.to_bits());
    let sigma = root(numeric::add_i64(squared, OF_PIXEL));
    let level = spot.background.level_bits();
    let reach = saturated(product(sigma, HALF_WIDTH) >> 30);
    let above = |place: i32| interpolated(light, place).map(|count| numeric::sub_i32(count, level));
    let centre = centre.to_bits();
    let (Some(top), Some(left), Some(right)) = (
        above(centre),
        above(centre.saturating_sub(reach)),
        above(centre.saturating_add(reach)),
    ) else {
        return width;
    };
    // Each within 2^20. The ratio of their mean to the top, less a half, has Q24.
    let ratio = product(numeric::add_i32(left, right), 1 << 23).checked_div(top.max(1).into());
    let over_half = saturated(ratio.unwrap_or_default()).saturating_sub(1 << 23);
    let wider = (product(over_half, PER_LN2) >> 30).clamp(-(1 << 23), 1 << 23);
    // A quarter of it.
    let sigma = saturated(i64::from(sigma) + (product(sigma, numeric::i64_to_i32(wider)) >> 26));
    let squared = numeric::sub_i64(product(sigma, sigma), OF_PIXEL);
    let width = Pixels::from_bits(root(squared));
    width.max(*WIDTHS.start()).min(*WIDTHS.end())
}

/// The count at a place between two pixels (Q16.16). Returns Q24.8, below 2^20.
fn interpolated(light: Light<'_>, place: i32) -> Option<i32> {
    let pixel = usize::try_from(place >> Pixels::FRACTION).ok()?;
    let [left, right] = light.slice(pixel..)?.chunks().next()?;
    // To 8 bits of a pixel.
    let part = (place >> (Pixels::FRACTION - Counts::FRACTION)) & 0xFF;
    Some(i32::from(left) * (256 - part) + i32::from(right) * part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{found_at, gaussian, spot_at};

    /// In pixels.
    fn follow(light: Light<'_>, spot: &Spot, centre: Pixels, width: f32) -> f32 {
        super::follow(light, spot, centre, Pixels::from_f32(width)).to_f32()
    }

    fn row(centre: f32, width: f32) -> [u16; 1000] {
        core::array::from_fn(|i| (200.0 + 3000.0 * gaussian(i, centre, width)) as u16)
    }

    fn spot(centre: usize, block_log2: u32) -> Spot {
        spot_at(centre, block_log2, 1000.0, (200.0, 1.0))
    }

    /// The rows hold sampled gaussians. A spot of this width that pixels integrate has a sigma of
    /// sqrt(width^2 + 1/12). Any block that the coarse search may choose gives the width.
    #[test]
    fn the_width_of_a_gaussian() {
        for (width, block_log2, tolerance) in [
            (1.2, 0, 0.07),
            (2.0, 1, 0.03),
            (2.0, 2, 0.03),
            (10.5, 3, 0.01),
            (10.5, 4, 0.01),
            (60.0, 5, 0.01),
            (60.0, 7, 0.01),
        ] {
            let sampled = libm::sqrtf(width * width + 1.0 / 12.0);
            for phase in [0.0, 0.2, 0.5] {
                let light = row(500.0 + phase, sampled);
                let found = super::width((&light).into(), &spot(500, block_log2), None);
                let found = found.expect("a width").to_f32();
                println!("{width} at {phase}: {found}");
                assert!((found / width - 1.0).abs() < tolerance, "{width}: {found}");
            }
        }
    }

    #[test]
    fn the_row_before_serves_while_it_is_near() {
        let light = row(500.0, 10.0);
        let width = |before| {
            let before = found_at(before, 9.0);
            let found = width((&light).into(), &spot(500, 3), Some(&before));
            found.expect("a width").to_f32()
        };
        assert_eq!(width(492.0), 9.0);
        assert!((width(490.0) - 10.0).abs() < 0.1);
    }

    #[test]
    fn following_arrives() {
        for (width, start) in [(2.0, 1.4), (10.5, 7.0), (10.5, 16.0)] {
            let light = row(500.3, width);
            let centre = Pixels::from_f32(500.3);
            let found = (0..30).fold(start, |width, _| {
                follow((&light).into(), &spot(500, 3), centre, width)
            });
            println!("{width} from {start}: {found}");
            assert!((found / width - 1.0).abs() < 0.03, "{width}: {found}");
        }
    }

    #[test]
    fn a_cut_spot_has_one_side() {
        let light = row(5.0, 10.0);
        let half = find((&light).into(), &spot(6, 3)).expect("half of it");
        assert!(half.left.is_none() && half.right.is_some());
        let found = width((&light).into(), &spot(6, 3), None);
        assert!(matches!(found, Err(Fault::SpotAtEdge { .. })));
    }

    #[test]
    fn counts_that_never_fall_to_half_are_no_spot() {
        let mut light = [300u16; 1000];
        light[999] = 200;
        for block_log2 in [0, 3, 7, 31] {
            let found = width((&light).into(), &spot(500, block_log2), None);
            assert!(matches!(found, Err(Fault::NoSpot { .. })), "{found:?}");
        }
    }
}
