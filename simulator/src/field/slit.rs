//! Through a slit: Fresnel diffraction in both directions.

use anyhow::Result;

use super::complex::{Matrix, phasor};
use super::fresnel::fresnel_by_table;
use super::laser::Laser;
use super::quadrature::gauss_legendre;
use super::source::{Lit, RowSums};
use super::surface::{REACH, Surface};
use super::{Image, View};

/// A slit before a sensor, narrow along the sensor's rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlitAperture {
    /// Its width along the rows, in metres.
    pub width: f64,
    /// Its height across the rows, in metres.
    pub height: f64,
    /// z: from it to the sensor, in metres.
    pub to_sensor: f64,
}

impl SlitAperture {
    /// The paper's: 200 um x 3 mm, 50 mm before the sensor.
    pub fn nominal() -> Self {
        Self {
            width: 200e-6,
            height: 3e-3,
            to_sensor: 0.05,
        }
    }

    /// Places across the slit's width, all positive ones and then their negatives, and the weights of
    /// Gauss-Legendre quadrature in metres. Enough of them for the waves from the beam's edge to the farthest
    /// of the image's columns.
    pub(super) fn places(&self, lit: &Lit, laser: &Laser, columns: &[f64]) -> Vec<(f64, f64)> {
        let half = 0.5 * self.width;
        let farthest = columns.iter().fold(0.0f64, |far, x| far.max(x.abs()));
        // Turns from the slit's middle to its edge. n nodes integrate a wave of as many turns over their
        // whole length by 1e-5 from n = pi turns + 6 on.
        let turns = half / laser.wavelength
            * (farthest / self.to_sensor
                + REACH * lit.beam.radius / lit.range
                + 0.5 * half * (1.0 / lit.range + 1.0 / self.to_sensor));
        let pairs = (0.5 * std::f64::consts::PI * turns + 3.0).ceil() as usize;
        let nodes = gauss_legendre(2 * pairs);
        let right = nodes.iter().map(|&(x, weight)| (x * half, weight * half));
        let left = right.clone().map(|(x, weight)| (-x, weight));
        right.chain(left).collect()
    }

    /// From places in the slit's width (rows) to columns X of the image: Fresnel's kernel exp(i k (X - u)^2 /
    /// 2z), without the phase that a column has in common.
    pub(super) fn across(
        &self,
        lit: &Lit,
        laser: &Laser,
        places: &[(f64, f64)],
        columns: &[f64],
    ) -> Matrix {
        let scale = 1.0 / (self.to_sensor * laser.wavelength);
        Matrix::from_fn(places.len(), columns.len(), |row, column| {
            let (u, weight) = places[row];
            let (re, im) = phasor(lit.of_place(u) + u * (0.5 * u - columns[column]) * scale);
            (weight as f32 * re, weight as f32 * im)
        })
    }

    /// From rows of scatterers (columns) to rows Y of the image: Fresnel's integral over the slit's height,
    ///
    /// ```text
    /// int exp(i k ((v - y)^2 / 2R + (Y - v)^2 / 2z)) dv
    ///   = exp(i k (Y - y)^2 / 2(R + z)) sqrt(lambda z' / 2) [F(t(h/2)) - F(t(-h/2))],
    /// t(v) = sqrt(2 / lambda z') (v - (y z + Y R) / (R + z)),  1/z' = 1/R + 1/z,  F = C + i S,
    /// ```
    ///
    /// times the beam's amplitude and wavefront at y.
    pub(super) fn along(&self, lit: &Lit, laser: &Laser, rows: &[f64]) -> Matrix {
        let (range, z) = (lit.range, self.to_sensor);
        let both = range + z;
        // 1/sqrt(lambda z' / 2)
        let scale = (2.0 * both / (laser.wavelength * range * z)).sqrt();
        let half = 0.5 * self.height;
        let beam = |&y: &f64| {
            let (amplitude, _) = lit.of_row(y, y);
            (
                amplitude / scale as f32,
                0.5 * y * y * lit.beam.curvature / laser.wavelength,
            )
        };
        let beams: Vec<(f32, f64)> = lit.y.iter().map(beam).collect();
        Matrix::from_fn(rows.len(), lit.y.len(), |row, column| {
            let (place, y) = (rows[row], lit.y[column]);
            let middle = (y * z + place * range) / both;
            let (c1, s1) = fresnel_by_table(scale * (half - middle));
            let (c0, s0) = fresnel_by_table(scale * (-half - middle));
            let (amplitude, turns) = beams[column];
            let (re, im) = phasor(turns + 0.5 * (place - y).powi(2) / (both * laser.wavelength));
            let (c, s) = (amplitude * (c1 - c0), amplitude * (s1 - s0));
            (re * c - im * s, re * s + im * c)
        })
    }

    /// Mean |field|^2 in each column, from light at each place of the beam.
    pub(super) fn mean_across(
        &self,
        lit: &Lit,
        places: &[(f64, f64)],
        across: &Matrix,
    ) -> Vec<f64> {
        let u: Vec<f64> = places.iter().map(|&(u, _)| u).collect();
        let from = lit.mean_places(self.width);
        let fields = lit.mean_fields(&from, &u);
        let mut waves = Matrix::zeros(fields.rows, across.columns);
        waves.set_product(&fields, across);
        let mut mean = vec![0.0; across.columns];
        for (row, (_, light)) in from.into_iter().enumerate() {
            let (re, im) = waves.row(row);
            for (mean, (re, im)) in mean.iter_mut().zip(re.iter().zip(im)) {
                *mean += light * f64::from(re * re + im * im);
            }
        }
        mean
    }

    /// The mean at the geometric centre, before any normalisation, and [`Image::density`].
    pub(super) fn mean_at_centre(
        &self,
        lit: &Lit,
        laser: &Laser,
        places: &[(f64, f64)],
    ) -> (f64, f64) {
        let across = self.mean_across(lit, places, &self.across(lit, laser, places, &[0.0]))[0];
        let along = self.along(lit, laser, &[0.0]).row_sums()[0];
        let through = lit.light() * self.width * self.height;
        let spread = (laser.wavelength * self.to_sensor).powi(2);
        (across * along, across * along / (spread * through))
    }
}

/// The light that a slit lets onto the sensor, at columns X and rows Y in metres from the geometric centre:
/// at the pixels' middles, as the pattern's finest detail, lambda z / width, is 28 pixels of the paper's
/// sensor.
///
/// # Errors
/// If the beam is larger than the surface.
pub fn slit_image(
    surface: &Surface,
    view: &View,
    slit: &SlitAperture,
    columns: &[f64],
    rows: &[f64],
) -> Result<Image> {
    let laser = &surface.laser;
    let lit = Lit::new(laser, &surface.scattering, view);
    lit.check(surface)?;
    let places = slit.places(&lit, laser, columns);
    let across = slit.across(&lit, laser, &places, columns);
    let along = slit.along(&lit, laser, rows);
    let right: Vec<f64> = places[..places.len() / 2].iter().map(|&(u, _)| u).collect();
    let mut sums = RowSums::new(&lit, surface, &right);
    let mut fields = sums.fields();
    let mut spread = Matrix::zeros(lit.y.len(), columns.len());
    let mut waves = Matrix::zeros(rows.len(), columns.len());
    let (mean, density) = slit.mean_at_centre(&lit, laser, &places);
    let mut light = vec![0.0; rows.len() * columns.len()];
    for term in &surface.terms {
        sums.set_fields(term, &mut fields);
        spread.set_product(&fields, &across);
        waves.set_product(&along, &spread);
        waves.add_light((term.weight / mean) as f32, &mut light);
    }
    Ok(Image {
        columns: columns.len(),
        light,
        density,
    })
}
