//! Coherent light from a rough surface, through a slit or a lens, onto a sensor: speckle by summation of the
//! field.
//!
//! A laser beam falls on a rough surface at normal incidence, and the aperture looks at the spot from the
//! side. Coordinates in metres: on the surface x along the baseline, towards the aperture, and y across; in
//! the aperture u and v, and on the sensor X and Y, in the directions of x and y as seen along the line of
//! sight; origins where the beam's axis and the line of sight run. The sensor is taken as square to the line
//! of sight: that the chief ray leans by up to 6 degrees to the axis is left out.
//!
//! The path from a scatterer (x, y) to (u, v), to second order (Fresnel's approximation), with the aperture R
//! away under the angle theta to the beam:
//!
//! ```text
//! R - x sin(theta) + ((u - x cos(theta))^2 + (v - y)^2) / 2R
//! ```
//!
//! to which the beam's curved wavefront adds (x^2 + y^2) / 2 rho, and a scatterer in the material its extra
//! path. As the path splits into a part with x and a part with y, so do all sums.
//!
//! Spectrum and wavelength: the phases that the roughness and the depth of the material scramble are those of
//! each wavelength; the aperture's diffraction is that of the middle of the spectrum, as a line 1 nm wide
//! changes its pattern by 0.15 % of its width.

mod complex;
mod fresnel;
pub(crate) mod laser;
mod lens;
mod mean;
pub(crate) mod quadrature;
mod slit;
mod source;
mod surface;

pub use fresnel::fresnel;
pub use laser::{Beam, Laser, SpectralLine};
pub use lens::{LensAperture, lens_image};
pub use mean::{lens_mean, slit_mean};
pub use slit::{SlitAperture, slit_image};
pub use surface::{Scattering, Surface};

/// Where the target stands, and which part of it the beam hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// d: from the laser to the target along the beam, in metres.
    pub distance: f64,
    /// b: from the laser to the aperture, in metres.
    pub baseline: f64,
    /// The place on the surface, x and y in metres, that the beam's axis hits: the beam wanders over the
    /// surface as the table moves.
    pub lateral: [f64; 2],
}

impl View {
    /// The target at a distance in metres, the aperture 0.3 m beside the laser, and the beam in the middle of
    /// the surface.
    pub fn at(distance: f64) -> Self {
        Self {
            distance,
            baseline: 0.3,
            lateral: [0.0; 2],
        }
    }

    /// R: from the laser spot to the aperture, in metres.
    pub fn range(&self) -> f64 {
        libm::hypot(self.baseline, self.distance)
    }

    /// Sine of the angle between the beam and the line of sight.
    pub fn sin_angle(&self) -> f64 {
        self.baseline / self.range()
    }

    /// Its cosine.
    pub fn cos_angle(&self) -> f64 {
        self.distance / self.range()
    }
}

/// Light on the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns of the image.
    pub columns: usize,
    /// Row by row. Unit: the mean over all surfaces, without texture, at the geometric centre (X = Y = 0) in
    /// this view.
    pub light: Vec<f32>,
    /// That unit: the share of all light that passes the aperture, in the mean, that falls on a square metre
    /// at the geometric centre. Light times this is comparable between views through the same aperture.
    pub density: f64,
}

impl Image {
    /// A row's light.
    pub fn row(&self, row: usize) -> &[f32] {
        &self.light[row * self.columns..][..self.columns]
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.light.len() / self.columns
    }

    /// An image of every `step`-th row of `rows` rows becomes one of all rows, by linear interpolation. Along
    /// the slit the pattern varies slowly, but for faint fringes of the slit's ends: with every fourth row
    /// the frame's centre moves by 0.02 pixels. Rows after the last computed one repeat it; [`every`] gives
    /// the places to compute.
    pub fn with_rows_between(&self, step: usize, rows: usize) -> Self {
        let mut light = Vec::with_capacity(rows * self.columns);
        let last = self.rows() - 1;
        for row in 0..rows {
            let (from, to) = ((row / step).min(last), (row / step + 1).min(last));
            let share = (row % step) as f32 / step as f32;
            let pairs = self.row(from).iter().zip(self.row(to));
            light.extend(pairs.map(|(a, b)| a + share * (b - a)));
        }
        Self { light, ..*self }
    }
}

/// The places of every `step`-th row, and of one after the last where needed: the rows between them are
/// [`Image::with_rows_between`]. Rows are evenly spaced, in metres, at least one, and so is the step.
pub fn every(rows: &[f64], step: usize) -> Vec<f64> {
    let pitch = rows.get(1).map_or(0.0, |next| next - rows[0]);
    let count = (rows.len() - 1).div_ceil(step) + 1;
    let row = |i| rows[0] + (i * step) as f64 * pitch;
    (0..count).map(row).collect()
}

#[cfg(test)]
mod tests;
