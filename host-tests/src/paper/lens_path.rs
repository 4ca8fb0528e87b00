//! The lens's captures: images in, the centres of gaussians in the plane out, in f64.

use crate::paper::apparatus::{self, Aperture, BASELINE, LASER, TABLE};
use crate::paper::camera::{self, BLACK_LEVEL, Exposure, PITCH, ROWS};
use crate::paper::data_set::DataSet;
use crate::paper::lens_effects::{Flare, Place};
use crate::paper::materials::{MATERIALS, Material};
use crate::paper::plane_gaussian::PlaneGaussian;
use crate::paper::slit_path::PEAK;
use crate::paper::stub_field::{Surface, lens_image};

/// Pixels to either side of the image that is simulated, around the spot. The spot is 5 to 15 pixels wide; what lies further
/// out is too dark to move a fit of its core. The ghost and the veil reach beyond, and are cut.
pub const SIZE: usize = 64;

/// The row on the optical axis.
const AXIS_ROW: f64 = (ROWS as f64 - 1.0) / 2.0;

/// The centres of the captures at a position: a value for the one method, not a number where there is none.
pub fn centres(set: &DataSet, surface: &Surface, position: usize, distance: f64) -> Vec<Vec<f64>> {
    let (exposure, first) = expose(set, surface, distance);
    let mut counts = Vec::with_capacity(SIZE * SIZE);
    (0..set.captures)
        .map(|capture| {
            let mut random = camera::noise(set.noise_seed(), position as u64, capture as u64);
            exposure.capture(&mut random, &mut counts);
            let light = without_black(&counts);
            let fit = PlaneGaussian::of_moments(&light, SIZE)
                .and_then(|start| PlaneGaussian::fit(&light, SIZE, start));
            vec![fit.map_or(f64::NAN, |fit| fit.x + first as f64)]
        })
        .collect()
}

/// The paper's way: the black level is taken off, and what is below is zero. From the 960,000 pixels beside the spot, the level is
/// known to a thousandth of a count.
fn without_black(counts: &[u16]) -> Vec<f32> {
    counts
        .iter()
        .map(|&count| (f32::from(count) - BLACK_LEVEL as f32).max(0.0))
        .collect()
}

/// The light of a position, and the sensor's column at which it begins.
pub fn expose(set: &DataSet, surface: &Surface, distance: f64) -> (Exposure, usize) {
    let centre = apparatus::centre(Aperture::Lens, distance);
    let first = centre.round() as usize - SIZE / 2;
    let first_row = ROWS / 2 - SIZE / 2;
    let along = |first: usize, centre: f64| -> Vec<f64> {
        (first..first + SIZE)
            .map(|pixel| (pixel as f64 - centre) * PITCH)
            .collect()
    };
    let mut image = lens_image(
        surface,
        &set.view(distance),
        &apparatus::lens(),
        &along(first, centre),
        &along(first_row, AXIS_ROW),
    );
    let place = |column, row| Place { column, row };
    Flare::CHOSEN.add(
        &mut image.light,
        SIZE,
        place(first as f64, first_row as f64),
        place(centre, AXIS_ROW),
        AXIS_ROW,
    );
    let counts = (PEAK * brightness(&MATERIALS[set.material], distance)) as f32;
    (
        Exposure::new(image.light.iter().map(|light| counts * light)),
        first,
    )
}

/// The image's mean brightness at a distance, over its mean along the table: the material's lobe, the square of the way to the lens,
/// and the area over which defocus spreads the light.
fn brightness(material: &Material, distance: f64) -> f64 {
    let at = |distance: f64| {
        let way = BASELINE.hypot(distance);
        let lobe = material.lobe.brightness((BASELINE / distance).atan());
        lobe / (way * way) / area(distance)
    };
    const SAMPLES: usize = 64;
    let mean: f64 = (0..SAMPLES)
        .map(|i| at(TABLE.0 + (TABLE.1 - TABLE.0) * (i as f64 + 0.5) / SAMPLES as f64))
        .sum::<f64>()
        / SAMPLES as f64;
    at(distance) / mean
}

/// The variance of the mean image along a row, in m^2: of the laser's spot, of the disc of a point out of focus, and of
/// diffraction (a gaussian of 0.42 lambda N fits Airy's disc best). The light's area goes with it.
fn area(distance: f64) -> f64 {
    let lens = apparatus::lens();
    let (image, way) = (apparatus::image_distance(), BASELINE.hypot(distance));
    let spot = LASER.waist_diameter / 4.0 * image / way;
    let disc = lens.diameter / 4.0 * (1.0 - image * (1.0 / lens.focal_length - 1.0 / way));
    let airy = 0.42 * LASER.wavelength * image / lens.diameter;
    spot * spot + disc * disc + airy * airy
}
