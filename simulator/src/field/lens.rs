//! Through a lens: a round pupil with defocus and coma, and a square of pixels behind it.

use std::f64::consts::PI;

use anyhow::Result;

use super::complex::{Matrix, phasor};
use super::laser::Laser;
use super::source::{Lit, RowSums};
use super::surface::{REACH, Surface};
use super::{Image, View};

/// A lens before a sensor. It has defocus and, where asked for, coma; a distorted image is one whose centre
/// is moved, which the caller does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensAperture {
    /// Diameter of the pupil in metres.
    pub diameter: f64,
    /// Focal length in metres.
    pub focal_length: f64,
    /// R of a target that is in focus, in metres.
    pub focus_distance: f64,
    /// Seidel coma W131: waves at the pupil's edge for an image `full_field` from the axis; 0 for none.
    /// Positive: the tail points away from the axis, and the centroid with it, by lambda z W131 / a.
    pub coma: f64,
    /// From the axis to the edge of the image along the row, in metres.
    pub full_field: f64,
    /// A pixel's side in metres.
    pub pixel: f64,
    /// Samples across a pixel: 2 leave 1 % of its finest detail, see [`lens_image`].
    pub samples: usize,
}

impl LensAperture {
    /// The paper's 50 mm lens at f/12, in focus at a range in metres, without coma; half of a row of 1920
    /// pixels of 5.86 um.
    pub fn nominal(focus_distance: f64) -> Self {
        Self {
            diameter: 50e-3 / 12.0,
            focal_length: 50e-3,
            focus_distance,
            coma: 0.0,
            full_field: 5.63e-3,
            pixel: 5.86e-6,
            samples: 2,
        }
    }

    /// z: from the lens to the sensor, in metres: 1/z = 1/f - 1/R of what is in focus.
    pub fn to_sensor(&self) -> f64 {
        1.0 / (1.0 / self.focal_length - 1.0 / self.focus_distance)
    }

    /// Places of samples behind pixels.
    fn samples(&self, pixels: &[f64]) -> Vec<f64> {
        let n = self.samples as f64;
        let samples = |&middle: &f64| {
            (0..self.samples).map(move |i| middle + ((i as f64 + 0.5) / n - 0.5) * self.pixel)
        };
        pixels.iter().flat_map(samples).collect()
    }
}

/// The pupil of a view: everything that does not depend on the surface.
pub(super) struct Pupil<'a> {
    lit: &'a Lit,
    wavelength: f64,
    lens: &'a LensAperture,
    /// Places across the pupil, the positive ones first and then their negatives, for u and v alike.
    pub places: Vec<f64>,
    /// From rows of scatterers (columns) to v (rows).
    pub along: Matrix,
    /// The pupil's transmission and phase, v by u.
    pub transmission: Matrix,
}

impl<'a> Pupil<'a> {
    /// A pupil for light to `reach` metres from the geometric centre of the image, which is `field` metres
    /// from the axis.
    pub fn new(
        lit: &'a Lit,
        laser: &Laser,
        lens: &'a LensAperture,
        field: f64,
        reach: f64,
    ) -> Self {
        let z = lens.to_sensor();
        let coma = lens.coma * field / lens.full_field;
        // A grid of n places repeats the image after n lambda z / diameter, which must be farther than from
        // the window's edge to the light's edge on the other side: the spot's image with its defocus, coma
        // (whose tail is 6 waves of it long) and some diffraction.
        let airy = laser.wavelength * z / lens.diameter;
        let defocus = 0.5 * lens.diameter * z * (1.0 / lit.range - 1.0 / lens.focus_distance).abs();
        let light = REACH * lit.beam.radius * z / lit.range + defocus;
        let pairs = (0.5 * ((reach + light) / airy + 6.0 * coma.abs() + 5.0)).ceil() as usize;
        let pairs = pairs.max(16);
        let step = 0.5 * lens.diameter / pairs as f64;
        let right = (0..pairs).map(|i| (i as f64 + 0.5) * step);
        let places: Vec<f64> = right.clone().chain(right.map(|u| -u)).collect();
        let along = Matrix::from_fn(places.len(), lit.y.len(), |row, column| {
            let (amplitude, turns) = lit.of_row(lit.y[column], places[row]);
            let (re, im) = phasor(turns);
            (amplitude * re, amplitude * im)
        });
        let transmission = Matrix::from_fn(places.len(), places.len(), |row, column| {
            let (u, v) = (places[column], places[row]);
            let covered = covered(u, v, step, 0.5 * lens.diameter) * step * step;
            let square = u * u + v * v;
            // Against the wave from R, which is in `along` and `of_place`, the lens sets that from where it
            // is in focus: the difference is the defocus r^2/2 (1/R - 1/R_focus). Seidel's coma is W131
            // (field / full field) (r/a)^3 cos(angle to the row).
            let focus = -0.5 * square / (lens.focus_distance * laser.wavelength);
            let coma = coma * square * u / (0.5 * lens.diameter).powi(3);
            let (re, im) = phasor(lit.of_place(u) + focus + coma);
            (covered as f32 * re, covered as f32 * im)
        });
        Self {
            lit,
            wavelength: laser.wavelength,
            lens,
            places,
            along,
            transmission,
        }
    }

    /// From places of the pupil (rows) to places of the image (columns): exp(-i k X u / z).
    fn to_image(&self, image: &[f64]) -> Matrix {
        let scale = 1.0 / (self.wavelength * self.lens.to_sensor());
        Matrix::from_fn(self.places.len(), image.len(), |row, column| {
            phasor(-self.places[row] * image[column] * scale)
        })
    }

    /// The mean over all surfaces at places (X, Y), before any normalisation.
    pub fn mean_at(&self, image: &[(f64, f64)]) -> Vec<f64> {
        let light = self.lit.mean_places(self.lens.diameter);
        let fields = self.lit.mean_fields(&light, &self.places);
        let scale = 1.0 / (self.wavelength * self.lens.to_sensor());
        let places = &self.places;
        let mut at_v = Matrix::zeros(light.len(), places.len());
        let mut waves = Matrix::zeros(light.len(), self.lit.y.len());
        let mut mean_at = |(x, y): (f64, f64)| {
            let mut pupil = Matrix::from_fn(places.len(), places.len(), |v, u| {
                phasor(-(places[u] * x + places[v] * y) * scale)
            });
            pupil.multiply_elements(&self.transmission);
            at_v.set_product(&fields, &pupil.transposed());
            waves.set_product(&at_v, &self.along);
            let pairs = waves.row_sums().into_iter().zip(&light);
            pairs.map(|(sum, (_, light))| sum * light).sum()
        };
        image.iter().map(|&place| mean_at(place)).collect()
    }

    /// The mean at the geometric centre, before any normalisation, and [`Image::density`].
    pub fn mean_at_centre(&self) -> (f64, f64) {
        let mean = self.mean_at(&[(0.0, 0.0)])[0];
        let area = 0.25 * PI * self.lens.diameter.powi(2);
        let spread = (self.wavelength * self.lens.to_sensor()).powi(2);
        (mean, mean / (spread * area * self.lit.light()))
    }
}

/// The light that a lens lets onto the sensor, in pixels whose middles are at columns X and rows Y in metres
/// from the geometric centre, which is `field` metres along the row from the axis of the lens.
///
/// A pixel's light is the mean of `samples` x `samples` places in it: the finest detail is lambda z /
/// diameter, 8.3 um at f/12, no more than a pixel and a half.
///
/// # Errors
/// If the beam is larger than the surface.
pub fn lens_image(
    surface: &Surface,
    view: &View,
    lens: &LensAperture,
    field: f64,
    columns: &[f64],
    rows: &[f64],
) -> Result<Image> {
    let laser = &surface.laser;
    let lit = Lit::new(laser, &surface.scattering, view);
    lit.check(surface)?;
    let pupil = Pupil::new(&lit, laser, lens, field, reach(columns, rows));
    let across = pupil.to_image(&lens.samples(columns));
    let along = pupil.to_image(&lens.samples(rows)).transposed();
    let places = pupil.places.len();
    let mut sums = RowSums::new(&lit, surface, &pupil.places[..places / 2]);
    let mut fields = sums.fields();
    let mut behind = Matrix::zeros(places, places);
    let mut spread = Matrix::zeros(places, across.columns);
    let mut waves = Matrix::zeros(along.rows, across.columns);
    let (mean, density) = pupil.mean_at_centre();
    let mut light = vec![0.0; along.rows * across.columns];
    for term in &surface.terms {
        sums.set_fields(term, &mut fields);
        behind.set_product(&pupil.along, &fields);
        behind.multiply_elements(&pupil.transmission);
        spread.set_product(&behind, &across);
        waves.set_product(&along, &spread);
        waves.add_light((term.weight / mean) as f32, &mut light);
    }
    Ok(Image {
        columns: columns.len(),
        light: pixels(&light, columns.len(), lens.samples),
        density,
    })
}

/// The farthest of an image's pixels from the geometric centre, in metres.
pub(super) fn reach(columns: &[f64], rows: &[f64]) -> f64 {
    let places = columns.iter().chain(rows);
    places.fold(0.0, |reach, place| reach.max(place.abs()))
}

/// Means over `samples` x `samples` values.
fn pixels(values: &[f32], columns: usize, samples: usize) -> Vec<f32> {
    let stride = columns * samples;
    let share = 1.0 / (samples * samples) as f32;
    values
        .chunks_exact(stride * samples)
        .flat_map(|rows| {
            (0..columns).map(move |column| {
                let sum: f32 = (0..samples)
                    .flat_map(|row| &rows[row * stride + column * samples..][..samples])
                    .sum();
                sum * share
            })
        })
        .collect()
}

/// The share of a square about (u, v) that lies within a circle about the origin, by 8 by 8 points.
fn covered(u: f64, v: f64, side: f64, radius: f64) -> f64 {
    const POINTS: i32 = 8;
    let (middle, diagonal) = ((u * u + v * v).sqrt(), 0.5f64.sqrt() * side);
    if middle + diagonal <= radius {
        return 1.0;
    }
    if middle - diagonal >= radius {
        return 0.0;
    }
    let offset = |i: i32| ((f64::from(i) + 0.5) / f64::from(POINTS) - 0.5) * side;
    let is_inside = |i: &i32| {
        let (u, v) = (u + offset(i % POINTS), v + offset(i / POINTS));
        u * u + v * v < radius * radius
    };
    (0..POINTS * POINTS).filter(is_inside).count() as f64 / f64::from(POINTS * POINTS)
}
