//! The lens's captures: images in, the centres of gaussians in the plane out, in f64.

use crate::field::{Image, Surface, View, lens_image};
use crate::paper::apparatus::{self, AXIS, Aperture};
use crate::paper::camera::{BLACK_LEVEL, PITCH, ROWS};
use crate::paper::lens_effects::{Flare, Place};
use crate::paper::plane_gaussian::PlaneGaussian;

/// Pixels to either side of the image that is simulated, around the spot. The spot is 5 to 15 pixels wide; what lies further
/// out is too dark to move a fit of its core. The ghost and the veil reach beyond, and are cut. With 96
/// pixels the mean error changes by 0.2 %.
pub const SIZE: usize = 64;

/// The row on the optical axis.
const AXIS_ROW: f64 = (ROWS as f64 - 1.0) / 2.0;

/// The image of a view, and the sensor's column at which it begins.
///
/// # Errors
/// The spot is larger than the surface.
pub fn image(surface: &Surface, view: &View) -> anyhow::Result<(Image, usize)> {
    let centre = apparatus::centre(Aperture::Lens, view.distance);
    let first = centre.round() as usize - SIZE / 2;
    let first_row = ROWS / 2 - SIZE / 2;
    let along = |first: usize, centre: f64| -> Vec<f64> {
        (first..first + SIZE)
            .map(|pixel| (pixel as f64 - centre) * PITCH)
            .collect()
    };
    let mut image = lens_image(
        surface,
        view,
        &apparatus::lens(),
        (centre - AXIS) * PITCH,
        &along(first, centre),
        &along(first_row, AXIS_ROW),
    )?;
    let place = |column, row| Place { column, row };
    Flare::CHOSEN.add(
        &mut image.light,
        SIZE,
        place(first as f64, first_row as f64),
        place(centre, AXIS_ROW),
        AXIS_ROW,
    );
    Ok((image, first))
}

/// The image's density, see [`Image`].
///
/// # Errors
/// The spot is larger than the surface.
pub fn density(surface: &Surface, view: &View) -> anyhow::Result<f64> {
    let field = (apparatus::centre(Aperture::Lens, view.distance) - AXIS) * PITCH;
    Ok(lens_image(surface, view, &apparatus::lens(), field, &[0.0], &[0.0])?.density)
}

/// The centre of a capture, by the one method, in pixels from the image's first column; not a number where there is none.
pub fn centres(counts: &[u16]) -> Vec<f64> {
    let light = without_black(counts);
    let fit = PlaneGaussian::of_moments(&light, SIZE)
        .and_then(|start| PlaneGaussian::fit(&light, SIZE, start));
    vec![fit.map_or(f64::NAN, |fit| fit.x)]
}

/// The paper's way: the black level is taken off, and what is below is zero. From the 960,000 pixels beside the spot, the level is
/// known to a thousandth of a count.
fn without_black(counts: &[u16]) -> Vec<f32> {
    counts
        .iter()
        .map(|&count| (f32::from(count) - BLACK_LEVEL as f32).max(0.0))
        .collect()
}
