//! Tests that every estimator makes before it returns a centre: no saturated pixel, and a small enough
//! uncertainty.

use core::ops::Range;

use crate::base::{Counts, Fault, Pixels, numeric};
use crate::row::{Light, Row};
use crate::spot::Spot;

/// The uncertainty of a centre must be at most the width over this. Noise alone may look like a dimmer spot.
const DIMMEST: f32 = 8.0;

/// Rejects a spot with a saturated pixel within two widths of the centre: its top is lost.
///
/// # Errors
/// [`Fault::Saturated`] with the number of such pixels.
#[inline]
pub fn check_saturation(row: &Row<'_>, centre: Pixels, width: f32) -> Result<(), Fault> {
    // Most rows are saturated nowhere near.
    if !row.reaches_saturation(two_widths(centre, width)) {
        return Ok(());
    }
    match count_saturated_pixels(row, centre, width) {
        0 => Ok(()),
        pixels => Err(Fault::Saturated { pixels }),
    }
}

/// Counts the saturated pixels within two widths of the centre.
#[inline(never)]
pub fn count_saturated_pixels(row: &Row<'_>, centre: Pixels, width: f32) -> u16 {
    let (light, saturation) = (row.light(), row.saturated_from());
    let Range { start, end } = two_widths(centre, width);
    let near = light.slice(start.min(light.len())..end.min(light.len()));
    near.into_iter()
        .flat_map(Light::iter)
        .fold(0, |pixels, count| {
            u16::saturating_add(pixels, (count >= saturation).into())
        })
}

/// The pixels within two widths of the centre, to one pixel.
fn two_widths(centre: Pixels, width: f32) -> Range<usize> {
    let centre = usize::try_from(centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let reach = numeric::whole_usize(2.0 * width);
    let start = centre.saturating_sub(reach).saturating_sub(1);
    start..centre.saturating_add(reach).saturating_add(2)
}

/// Rejects a centre whose uncertainty is more than an eighth of the width, or is not a number. `uncertainty`
/// and `width` are in pixels, `amplitude` in counts.
///
/// # Errors
/// [`Fault::TooDim`], with the height at which the uncertainty would be small enough, if the noise did not
/// grow with the light.
#[inline]
pub fn check_uncertainty(amplitude: f32, uncertainty: f32, width: f32) -> Result<(), Fault> {
    if uncertainty * DIMMEST <= width {
        return Ok(());
    }
    Err(too_dim(amplitude, uncertainty, width))
}

#[cold]
fn too_dim(amplitude: f32, uncertainty: f32, width: f32) -> Fault {
    Fault::TooDim {
        amplitude: Counts::from_f32(amplitude),
        needed: Counts::from_f32(amplitude * uncertainty * DIMMEST / width),
    }
}

/// Converts the spot's pixel to a position.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where it is not on the row.
pub fn position_on_row(light: Light<'_>, spot: &Spot) -> Result<Pixels, Fault> {
    match i32::try_from(spot.centre) {
        // A row has at most 4096 pixels: Q16 holds them.
        Ok(centre) if spot.centre < light.len() => Ok(Pixels::from_int(centre)),
        _ => Err(Fault::SpotAtEdge {
            centre: Pixels::MAX,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_within_two_widths_count_as_saturated() {
        let mut light = [100u16; 64];
        let count = |light: &[u16], saturation, centre, width| {
            let row = Row::new(light, &[], saturation).expect("12 bits");
            count_saturated_pixels(&row, centre, width)
        };
        let centre = Pixels::from_f32(32.5);
        assert_eq!(count(&light, 4095, centre, 2.0), 0);
        (light[27], light[32], light[37]) = (4095, 2500, 4095);
        for (saturation, centre, width, expected) in [
            (4095, centre, 2.0, 2),
            (2501, centre, 2.0, 2),
            (2500, centre, 2.0, 3),
            (4095, centre, 1.4, 0),
            (4095, Pixels::MAX, f32::MAX, 2),
        ] {
            assert_eq!(count(&light, saturation, centre, width), expected);
        }
        assert_eq!(count(&[], 4095, Pixels::MIN, f32::NAN), 0);
    }

    #[test]
    fn an_eighth_of_the_width() {
        let [amplitude, needed] = [100, 200].map(Counts::from_int);
        let too_dim = Err(Fault::TooDim { amplitude, needed });
        assert_eq!(check_uncertainty(100.0, 0.25, 2.0), Ok(()));
        assert_eq!(check_uncertainty(100.0, 0.5, 2.0), too_dim);
        for (uncertainty, width) in [(f32::NAN, 2.0), (0.1, f32::NAN)] {
            assert!(check_uncertainty(100.0, uncertainty, width).is_err());
        }
    }
}
