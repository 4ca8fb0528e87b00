//! What limits a distance: each part of its error, as a standard deviation.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::Design;
use super::geometry::{COMB_SLIT_UM, COMB_SLITS};
use super::light::width_behind_slit;

/// A design at one distance.
#[derive(Clone, Debug, PartialEq)]
pub struct At {
    /// The distance in mm.
    pub distance: f64,
    /// The spot's centre in pixels.
    pub centre: f64,
    /// The spot's sigma in pixels.
    pub width: f64,
    /// What a pixel stands for, in micrometres.
    pub um_a_pixel: f64,
    /// The noise of a row at the Cramér-Rao bound, in micrometres.
    pub noise_of_a_row: f64,
    /// The size of a speckle at the slit, in micrometres.
    pub speckle_size: f64,
    /// The parts of the error of a frame: their names, and their sizes in micrometres.
    pub parts: [(&'static str, f64); 6],
}

impl At {
    /// The root of the sum of the squares of the parts, in micrometres.
    pub fn total(&self) -> f64 {
        let squares = self.parts.iter().map(|(_, um)| um * um);
        squares.sum::<f64>().sqrt()
    }

    /// The largest part.
    pub fn limit(&self) -> &'static str {
        let largest = self.parts.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        largest.map_or("", |part| part.0)
    }
}

impl Design {
    /// What the design gives at a distance in mm.
    pub fn at(&self, distance: f64) -> At {
        let geometry = &self.geometry;
        let um_a_pixel = 1000.0 * geometry.mm_a_pixel(distance);
        let width = self.width(distance);
        let slits = if self.options.comb { COMB_SLITS } else { 1 } as f64;
        let row = um_a_pixel * self.centre_noise(width) / slits.sqrt();
        let rows = f64::from(self.options.rows);
        let speckle = self.speckle(distance, slits);
        let of_map = pixels(width, 0.01 * self.options.pixels);
        let rounding = quantisation(width, self.options.height);
        let noise = row / um_a_pixel / rows.sqrt();
        let rounding = um_a_pixel * rounding / (slits * rows).sqrt();
        let parts = [
            ("noise", row / rows.sqrt()),
            ("quantisation", rounding),
            ("speckle", speckle),
            ("pixels", um_a_pixel * of_map / slits.sqrt()),
            ("calibration", self.calibration(distance, noise, slits)),
            ("temperature", self.warming(distance)),
        ];
        At {
            distance,
            centre: geometry.centre(distance),
            width,
            um_a_pixel,
            noise_of_a_row: row,
            speckle_size: 1000.0 * self.wavelength * geometry.range(distance) / self.options.spot,
            parts,
        }
    }

    /// The spot's sigma in pixels: light behind the slit, the laser spot's image, and the pixel, in
    /// quadrature.
    pub fn width(&self, distance: f64) -> f64 {
        let geometry = &self.geometry;
        let range = geometry.range(distance);
        let slit = match self.options.comb {
            true => COMB_SLIT_UM / 1000.0,
            false => self.slit,
        };
        let point = width_behind_slit(slit, range, geometry.focal, self.wavelength);
        let scale = geometry.focal / range * geometry.viewing_angle(distance).cos();
        // A beam's standard deviation is a quarter of its 1/e^2 diameter.
        let image = 0.25 * self.options.spot * scale;
        (point / geometry.pitch)
            .hypot(image / geometry.pitch)
            .hypot(1.0 / 12f64.sqrt())
    }

    /// The Cramér-Rao bound of a row's centre in pixels: the smallest error of any unbiased method with this
    /// noise. Height, width and level are even functions about the centre and its own derivative is odd, so
    /// they cost nothing.
    fn centre_noise(&self, width: f64) -> f64 {
        // No row is longer: a wider spot covers the sensor.
        let reach = (6.0 * width).min(20_000.0) as i32 + 3;
        let of_pixel = |i| {
            let x = f64::from(i) / width;
            let light = self.options.height * (-0.5 * x * x).exp();
            let slope = light * x / width;
            slope * slope
                / (self.options.noise * self.options.noise + light / self.options.electrons)
        };
        let information: f64 = (-reach..=reach).map(of_pixel).sum();
        information.sqrt().recip()
    }

    /// What speckle leaves, in micrometres: s / sqrt(2 (n M - 1)), with s the laser spot's standard deviation
    /// as a distance, n slits and M equal patterns. For n M = 1, one slit on metal, it has no bound,
    /// because a spot may be dark. The factor 1.3 is from the simulation, where it is 1.26 to 1.5.
    fn speckle(&self, distance: f64, slits: f64) -> f64 {
        let s = 250.0 * self.options.spot / self.geometry.viewing_angle(distance).tan();
        let patterns = slits * self.options.surface.patterns();
        match patterns > 1.0 {
            true => s / (2.0 * (patterns - 1.0)).sqrt(),
            false => 1.3 * s,
        }
    }

    /// The error of the fitted curve at a distance, in micrometres. Its points lie evenly along the row, and
    /// each weighs by its own error. `noise` is that of a point in pixels.
    ///
    /// By D, K and xp, D + K/(x - xp) has the derivatives 1, 1/(x - xp) and K/(x - xp)^2: these span the
    /// parabolas in the distance.
    fn calibration(&self, distance: f64, noise: f64, slits: f64) -> f64 {
        let geometry = &self.geometry;
        let half = 0.5 * (self.options.far - self.options.near);
        let terms = |at: f64| {
            let t = (at - self.options.near) / half - 1.0;
            Vector3::new(1.0, t, t * t)
        };
        let ends = [self.options.far, self.options.near];
        let [first, last] = ends.map(|distance| geometry.centre(distance));
        let step = (last - first) / f64::from(self.options.points - 1);
        let mut information = Matrix3::zeros();
        for i in 0..self.options.points {
            let at = geometry.distance(first + step * f64::from(i));
            let um = (self.speckle(at, slits))
                .hypot(self.options.stage)
                .hypot(1000.0 * geometry.mm_a_pixel(at) * noise);
            information += terms(at) * terms(at).transpose() / (um * um);
        }
        let terms = terms(distance);
        // Without an inverse the points do not tell the three parameters apart.
        information.try_inverse().map_or(f64::INFINITY, |inverse| {
            (terms.dot(&(inverse * terms))).sqrt()
        })
    }

    /// By how much the distance changes, in micrometres, when frame and mount warm up after the calibration:
    /// baseline and slit-to-sensor grow alike, the chip with the pixels does not.
    fn warming(&self, distance: f64) -> f64 {
        let growth = 1.0 + 1e-6 * self.options.expansion * self.options.warmer;
        let mut warm = self.geometry;
        warm.baseline *= growth;
        warm.focal *= growth;
        1000.0 * (warm.distance(self.geometry.centre(distance)) - distance).abs()
    }
}

/// Rounding to whole counts as an error of the centre in pixels: white noise of 1/sqrt(12) counts.
fn quantisation(width: f64, height: f64) -> f64 {
    (2.0 / PI.sqrt() * width / 12.0).sqrt() / height
}

/// Pixels whose response differs by this part, as an error of the centre in pixels: of a least-squares fit,
/// sum(g'^2 g^2) / sum(g'^2)^2 of a gaussian g is sigma / sqrt(2 pi).
fn pixels(width: f64, deviation: f64) -> f64 {
    deviation * (width / (2.0 * PI).sqrt()).sqrt()
}
