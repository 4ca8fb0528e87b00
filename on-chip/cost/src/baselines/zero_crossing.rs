//! Where as much light lies to the right as to the left, within a box: the zero of
//!
//! S(i) = y(i + 1) + ... + y(i + L) - y(i - 1) - ... - y(i - L).
//!
//! The zero is interpolated: x = i + S(i) / D, D = S(i) - S(i + 1). L = 2.161 sigma is the best in white
//! noise, 1.084 of the bound; in shot noise alone it is 1.37 of it. With f = S(i) / D the zero's weights are
//! -f and 1 - f for pixels i and i + 1, f - 1 and f for i - L and i + 1 + L, and 1 for those between. So
//!
//! u^2 = (noise^2 (2 L - 4 f (1 - f)) + g (sum of w^2 y')) / D^2.
//!
//! Between the pixels S is not straight: the bias is up to 0.019 pixel (width 0.8), 0.011 (1.2), 0.006 (2),
//! and falls as 1 / width^2. Its mean over the phases is in u. L is at most 368 pixels, so S and the light in
//! Q8 are below 2^30.

use slitrange::base::fault::Fault;
use slitrange::base::units::{Counts, Pixels};
use slitrange::centre::half_width;
use slitrange::centre::plausible::{check_saturation, position_on_row};
use slitrange::centre::{RowCentre, WidthClass};
use slitrange::row::{Geometry, Light, Row};
use slitrange::spot::Spot;

use super::check_uncertainty_in_noise;

/// Length of half the box over sigma: l above.
const HALF_BOX: f32 = 2.161;

/// A gaussian's light within the box over height times sigma: sqrt(2 pi) (2 Phi(l) - 1).
const LIGHT: f32 = 2.429_6;

/// Error of the interpolation, root mean square over the phases, in pixels times width squared.
const NOT_STRAIGHT: f32 = 0.015;

/// The centre of a spot that [`slitrange::spot::find`] found.
///
/// # Errors
/// See [`slitrange::centre::centre`].
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let light = row.light();
    let start = position_on_row(light, spot)?;
    let width = half_width::width(light, spot, before)?;
    check_saturation(row, start, width)?;
    // From 1 to 368, because a width is from 0.5 to 170: `as` cuts off after a half was added.
    let half_box = (HALF_BOX * width + 0.5) as usize;
    let edge = Fault::SpotAtEdge { centre: start };
    // The coarse search is good to half a block, and a block is at most about two widths.
    let reach = 2usize << spot.block_log2.min(7);
    let crossing = match slide(light, spot.centre, half_box, reach) {
        Slide::Crossing(crossing) => crossing,
        Slide::Edge => return Err(edge),
        Slide::None => return Err(spot.no_spot()),
    };
    // The pixels of the box about the pixel before the zero, and about the one after.
    let first = crossing.pixel.checked_sub(half_box).ok_or(edge)?;
    let pixels = light
        .slice(first..crossing.pixel.saturating_add(half_box).saturating_add(2))
        .ok_or(edge)?;
    let level = spot.background.level_bits();
    let gathered =
        (sum(pixels) * (1 << Counts::FRACTION) - level * pixels.len() as i32) as f32 / 256.0;
    if gathered <= 0.0 {
        // A step from one level to another changes the sign too.
        return Err(spot.no_spot());
    }
    let slope = crossing.slope as f32;
    let part = crossing.before as f32 / slope;
    // A pixel below 4096, and a part of one.
    let at = Pixels::from_bits(
        crossing.pixel as i32 * (1 << Pixels::FRACTION) + Pixels::from_f32(part).to_bits(),
    );
    check_saturation(row, at, width)?;
    let (noise, shot) = spot.background.variances(geometry);
    // Pixels i and i + 1 + L weigh f, i + 1 and i - L weigh 1 - f; the middle ones hold nearly all the light.
    let missing = 1.0 - part * part + 1.0 - (1.0 - part) * (1.0 - part);
    let amplitude = gathered / (LIGHT * width);
    let variance = noise * (2.0 * half_box as f32 - 4.0 * part * (1.0 - part))
        + shot * (gathered - missing * amplitude).max(0.0);
    let bend = NOT_STRAIGHT / (width * width);
    let uncertainty = dual_mac::square_root(variance / (slope * slope) + bend * bend);
    check_uncertainty_in_noise(amplitude, uncertainty, width, spot.background.noise)?;
    Ok(RowCentre {
        centre: at,
        uncertainty: Pixels::from_f32(uncertainty),
        amplitude: Counts::from_f32(amplitude),
        width: Pixels::from_f32(half_width::follow(light, spot, at, width)),
        class: WidthClass::default(),
        shape: Default::default(),
        misfit: false,
    })
}

/// Where S changes sign.
struct Crossing {
    /// The last pixel where it is positive.
    pixel: usize,
    /// S there.
    before: i32,
    /// By how much it is less a pixel later: at least `before`.
    slope: i32,
}

/// What came of sliding.
enum Slide {
    Crossing(Crossing),
    /// The box came to the row's end.
    Edge,
    /// No change of sign within reach.
    None,
}

/// The sum of the counts in a box, which has at most 738 pixels.
#[inline(always)]
fn sum(pixels: Light<'_>) -> i32 {
    pixels.iter().map(i32::from).sum()
}

/// Slides the box from a pixel to where S changes sign, at most `reach` pixels.
fn slide(light: Light<'_>, start: usize, half_box: usize, reach: usize) -> Slide {
    let Some(first) = start.checked_sub(half_box) else {
        return Slide::Edge;
    };
    let beyond = start.saturating_add(half_box).saturating_add(1);
    let (Some(left), Some(right)) = (light.slice(first..start), light.slice(start + 1..beyond))
    else {
        return Slide::Edge;
    };
    let mut here = sum(right) - sum(left);
    // S(i) - S(i + 1) = y(i) + y(i + 1) - y(i + 1 + L) - y(i - L).
    let falls = |at: u16, next: u16, enters: u16, leaves: u16| {
        i32::from(at) + i32::from(next) - i32::from(enters) - i32::from(leaves)
    };
    let from = |pixel: usize| light.slice(pixel..).unwrap_or_default().iter();
    let until = |pixel: usize| light.slice(..pixel).unwrap_or_default().iter().rev();
    let mut slid = 0;
    if here > 0 {
        let steps = from(start)
            .zip(from(start + 1))
            .zip(from(beyond))
            .zip(from(first));
        for (((at, next), enters), leaves) in steps.take(reach) {
            let slope = falls(at, next, enters, leaves);
            let next = here - slope;
            if next <= 0 {
                return Slide::Crossing(Crossing {
                    pixel: start.saturating_add(slid),
                    before: here,
                    slope,
                });
            }
            here = next;
            slid += 1;
        }
    } else {
        let steps = until(start)
            .zip(until(start + 1))
            .zip(until(beyond))
            .zip(until(first));
        for (((at, next), enters), leaves) in steps.take(reach) {
            let slope = falls(at, next, enters, leaves);
            let next = here + slope;
            if next > 0 {
                return Slide::Crossing(Crossing {
                    pixel: start.saturating_sub(slid).saturating_sub(1),
                    before: next,
                    slope,
                });
            }
            here = next;
            slid += 1;
        }
    }
    if slid < reach {
        Slide::Edge
    } else {
        Slide::None
    }
}
