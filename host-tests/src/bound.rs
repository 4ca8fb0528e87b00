//! The Cramér-Rao bound: the smallest standard deviation that any unbiased estimate of a spot's centre can have, when its
//! amplitude, width and black level are unknown too.

use nalgebra::{Matrix4, Vector4};
use phase_tables::gaussian;

/// A spot and the noise on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Sigma in pixels.
    pub width: f64,
    /// Height in counts.
    pub amplitude: f64,
    /// Standard deviation of the white noise in counts, rounding to counts apart (its 1/12 is added).
    pub noise: f64,
    /// Electrons a count, where the spot has shot noise.
    pub electrons_per_count: Option<f64>,
}

impl Spot {
    /// The bound in pixels for a spot whose centre is `phase` pixels off a pixel's centre, from pixels as far as six
    /// sigma: the inverse of the Fisher information of four parameters.
    pub fn bound_at(&self, phase: f64) -> f64 {
        let reach = (6.0 * self.width + 3.0).ceil() as i32;
        let h = 1e-4 * self.width;
        let mut information = Matrix4::zeros();
        for i in -reach..=reach {
            let offset = f64::from(i) - phase;
            let light = gaussian(offset, self.width);
            let by_centre =
                (gaussian(offset - h, self.width) - gaussian(offset + h, self.width)) / (2.0 * h);
            let by_width =
                (gaussian(offset, self.width + h) - gaussian(offset, self.width - h)) / (2.0 * h);
            let gradient = Vector4::new(
                self.amplitude * by_centre,
                light,
                1.0,
                self.amplitude * by_width,
            );
            let shot = self
                .electrons_per_count
                .map_or(0.0, |electrons| self.amplitude * light / electrons);
            information +=
                gradient * gradient.transpose() / (self.noise * self.noise + 1.0 / 12.0 + shot);
        }
        // Columns differ by orders of magnitude: scaled to a unit diagonal before the inversion.
        let scale = information.diagonal().map(|value| 1.0 / value.sqrt());
        let scaled = Matrix4::from_diagonal(&scale) * information * Matrix4::from_diagonal(&scale);
        let inverse = scaled
            .try_inverse()
            .expect("four derivatives of a gaussian are independent");
        inverse[(0, 0)].sqrt() * scale[0]
    }

    /// The bound in pixels, root mean square over the phases.
    pub fn bound(&self) -> f64 {
        let phases = [-0.4, -0.2, 0.0, 0.2, 0.4];
        (phases
            .iter()
            .map(|&phase| self.bound_at(phase).powi(2))
            .sum::<f64>()
            / phases.len() as f64)
            .sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In white noise the bound is sqrt(2/sqrt(pi)) sqrt(sigma) noise/amplitude; in pure shot noise sigma/sqrt(electrons).
    #[test]
    fn closed_forms() {
        for width in [3.0, 10.5] {
            let white = Spot {
                width,
                amplitude: 1000.0,
                noise: 20.0,
                electrons_per_count: None,
            };
            let expected = (2.0 / std::f64::consts::PI.sqrt() * width).sqrt()
                * (400.0f64 + 1.0 / 12.0).sqrt()
                / 1000.0;
            println!(
                "white, sigma {width}: {} of the closed form",
                white.bound() / expected
            );
            assert!((white.bound() / expected - 1.0).abs() < 0.01);
            let shot = Spot {
                width,
                amplitude: 4000.0,
                noise: 0.0,
                electrons_per_count: Some(100.0),
            };
            let electrons = 4000.0 * 100.0 * width * std::f64::consts::TAU.sqrt();
            println!(
                "shot, sigma {width}: {} of the closed form",
                shot.bound() / (width / electrons.sqrt())
            );
            assert!((shot.bound() / (width / electrons.sqrt()) - 1.0).abs() < 0.02);
        }
    }
}
