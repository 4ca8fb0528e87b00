//! The lens's captures: images in, the centres of gaussians in the plane out, in f64.

use std::f64::consts::{PI, TAU};

use crate::paper::apparatus::{self, AXIS, Aperture, LASER};
use crate::paper::camera::{BLACK_LEVEL, PITCH, ROWS};
use crate::paper::lens_effects::{Flare, Place};
use crate::paper::plane_gaussian::PlaneGaussian;
use simulator::field::{Image, Scattering, Surface, View, lens_image, lens_mean};

/// Pixels to either side of the image that is simulated, around the spot. The spot is 5 to 15 pixels wide;
/// what lies further out is too dark to move a fit of its core. The ghost and the veil reach beyond, and are
/// cut.
pub const SIZE: usize = 64;

const AXIS_ROW: f64 = (ROWS as f64 - 1.0) / 2.0;

struct Window {
    /// The spot's centre on the sensor, in pixels.
    centre: f64,
    /// The sensor's column and row of the first pixel.
    first: [usize; 2],
}

impl Window {
    fn around(distance: f64) -> Self {
        let centre = apparatus::centre(Aperture::Lens, distance);
        Self {
            centre,
            first: [centre.round() as usize - SIZE / 2, ROWS / 2 - SIZE / 2],
        }
    }

    /// Places of columns and rows from the spot's centre, in metres.
    fn places(&self) -> [Vec<f64>; 2] {
        let along = |first: usize, centre: f64| {
            let place = |pixel| (pixel as f64 - centre) * PITCH;
            (first..first + SIZE).map(place).collect()
        };
        let [column, row] = self.first;
        [along(column, self.centre), along(row, AXIS_ROW)]
    }

    /// The spot's distance from the optical axis, in metres.
    fn field(&self) -> f64 {
        (self.centre - AXIS) * PITCH
    }

    fn add_flare(&self, flare: &Flare, image: &mut Image) {
        let place = |column, row| Place { column, row };
        let [column, row] = self.first.map(|first| first as f64);
        let centre = place(self.centre, AXIS_ROW);
        flare.add(&mut image.light, SIZE, place(column, row), centre, AXIS_ROW);
    }
}

/// The image of a view, and the sensor's column at which it begins.
pub fn image(surface: &Surface, view: &View) -> anyhow::Result<(Image, usize)> {
    let window = Window::around(view.distance);
    let [columns, rows] = window.places();
    let lens = apparatus::lens();
    let mut image = lens_image(surface, view, &lens, window.field(), &columns, &rows)?;
    window.add_flare(&Flare::CHOSEN, &mut image);
    Ok((image, window.first[0]))
}

/// The centre of the gaussian that fits the mean image of all surfaces best, in pixels: what defocus, coma,
/// distortion and flare leave where there is neither speckle nor noise. `None` where no gaussian fits.
pub fn centre_without_speckle(distance: f64, flare: Option<&Flare>) -> Option<f64> {
    let window = Window::around(distance);
    let [columns, rows] = window.places();
    let (lens, view) = (apparatus::lens(), View::at(distance));
    let (surface, field) = (Scattering::surface(), window.field());
    let mut image = lens_mean(&LASER, &surface, &view, &lens, field, &columns, &rows);
    if let Some(flare) = flare {
        window.add_flare(flare, &mut image);
    }
    Some(fitted(&image.light)?.x + window.first[0] as f64)
}

pub fn density(surface: &Surface, view: &View) -> anyhow::Result<f64> {
    let field = (apparatus::centre(Aperture::Lens, view.distance) - AXIS) * PITCH;
    Ok(lens_image(surface, view, &apparatus::lens(), field, &[0.0], &[0.0])?.density)
}

/// The centre of a capture, by the one method, in pixels from the image's first column; not a number where
/// there is none.
pub fn centres(counts: &[u16]) -> Vec<f64> {
    vec![fitted(&without_black(counts)).map_or(f64::NAN, |fit| fit.x)]
}

fn fitted(light: &[f32]) -> Option<PlaneGaussian> {
    let start = PlaneGaussian::of_moments(light, SIZE)?;
    PlaneGaussian::fit(light, SIZE, start)
}

/// The paper's way: the black level is taken off, and what is below is zero. From the 960,000 pixels beside
/// the spot, the level is known to a thousandth of a count.
fn without_black(counts: &[u16]) -> Vec<f32> {
    let light = |&count: &u16| (f32::from(count) - BLACK_LEVEL as f32).max(0.0);
    counts.iter().map(light).collect()
}

/// Columns of the region around the spot in which the paper takes centroids (section 3).
const REGION: f64 = 320.0;

/// The centroid, eq. (2), of the mean light of all surfaces in the paper's region, in pixels: what flare
/// makes of it. The region reaches so far that the ghost and the veil count with all their light and all
/// their distance, where a fit of the spot's core hardly sees them.
pub fn centroid_without_speckle(distance: f64, flare: &Flare) -> f64 {
    let spot = apparatus::centre(Aperture::Lens, distance);
    let ghost = AXIS - flare.ghost.magnification * (spot - AXIS);
    let radius = flare.ghost.radius / PITCH;
    let width = flare.veil.width / PITCH;
    // Light a column, with all rows summed: a disc's is a half ellipse.
    let ghost_at = |column: f64| {
        let u = (column - ghost) / radius;
        flare.ghost.share * 2.0 / (PI * radius) * (1.0 - u * u).max(0.0).sqrt()
    };
    let veil_at = |column: f64| {
        let u = (column - AXIS) / width;
        flare.veil.share / (TAU.sqrt() * width) * (-0.5 * u * u).exp()
    };
    let (mut sum, mut moment) = (1.0, spot);
    for i in 0..REGION as usize {
        let column = spot + i as f64 + 0.5 - REGION / 2.0;
        let light = ghost_at(column) + veil_at(column);
        sum += light;
        moment += light * column;
    }
    moment / sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::lens_effects::Ghost;
    use rayon::prelude::*;
    use simulator::with;

    /// A ghost that is wholly in the region moves the centroid towards the ghost by share / (1 + share) of
    /// the way. A ghost outside the region does nothing.
    #[test]
    fn a_ghost_in_the_region_moves_the_centroid() {
        let flare = with(Flare::CHOSEN, |it| it.veil.share = 0.0);
        let Ghost {
            share,
            radius,
            magnification,
        } = flare.ghost;
        let mut inside = 0;
        for step in 0..=420 {
            let distance = 0.6 + 0.001 * f64::from(step);
            let spot = apparatus::centre(Aperture::Lens, distance);
            let way = -(1.0 + magnification) * (spot - AXIS);
            let pulled = centroid_without_speckle(distance, &flare) - spot;
            if way.abs() + radius / PITCH < REGION / 2.0 - 1.0 {
                inside += 1;
                let expected = share / (1.0 + share) * way;
                assert!((pulled - expected).abs() < 5e-3, "{pulled} {expected}");
            } else if way.abs() > REGION / 2.0 + radius / PITCH {
                assert_eq!(pulled, 0.0);
            }
        }
        println!("the ghost is in the region at {inside} of 421 distances");
        assert!(inside > 20);
    }

    /// Without speckle, distortion, defocus and coma leave an error that eq. (1) cannot follow: a cubic,
    /// largest at the ends of the table. Flare moves a least-squares fit by less than a hundredth of this
    /// error.
    #[test]
    fn the_lens_has_its_largest_errors_at_the_ends() {
        let distances = [0.6, 0.68, 0.77, 0.81, 0.9, 0.96, 1.02];
        let centres = |flare: Option<&Flare>| -> Vec<(f64, f64)> {
            distances
                .par_iter()
                .map(|&distance| {
                    let centre = centre_without_speckle(distance, flare).expect("a spot");
                    (centre, distance)
                })
                .collect()
        };
        let points = centres(Some(&Flare::CHOSEN));
        let curve = calibration::fit::eq1::fit(&points).expect("a fit").curve;
        let error = |&(centre, distance): &(f64, f64)| (curve.distance(centre) - distance) * 1e6;
        let errors: Vec<f64> = points.iter().map(error).collect();
        let moved = points.iter().zip(centres(None));
        let moved = moved.map(|(with, without)| (with.0 - without.0).abs());
        let moved = moved.fold(0.0, f64::max);
        println!("errors in um: {errors:.0?}; flare moves fits by {moved:.5} px");
        // The distortion alone: 0.2 % of 759 pixels at one end, of 669 at the other, is 1.0 and 0.7 px, of
        // which eq. (1) leaves a quarter.
        assert!(errors[0].abs().min(errors[6].abs()) > 30.0);
        assert!(moved < 0.01);
    }
}
