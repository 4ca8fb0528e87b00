//! The pattern of the slit or the lens, in place of a gaussian.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use crate::scene::pattern::Pattern;

/// By which theory the light of a point is spread along the row.
///
/// A scene without this effect has the gaussian of its [`crate::scene::Spot`]. All patterns are as high as
/// that gaussian: 1 at the geometric centre, in units of the spot's height. A lens in focus makes the same
/// pattern by both, which is Airy's (J. W. Goodman, Introduction to Fourier Optics, section 4.4); out of
/// focus Fresnel's counts ([`crate::scene::Defocus`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Diffraction {
    /// The far field: sinc^2 for a slit, eq. (6) of the paper, with its first zero at lambda z / a.
    Fraunhofer,
    /// Fresnel's integral over the aperture, exact at the distances of a slit and a sensor.
    Fresnel,
}

/// An aperture of one dimension, between a point of light and a sensor, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// a: its width.
    pub width: f64,
    /// R: from the light to it.
    pub to_light: f64,
    /// z: from it to the sensor.
    pub to_sensor: f64,
    /// The light's wavelength.
    pub wavelength: f64,
}

impl Gap {
    /// lambda z / a in metres: the first zero of sinc^2; no detail of any pattern is finer than a wave of
    /// this length.
    pub fn detail(&self) -> f64 {
        self.wavelength * self.to_sensor / self.width
    }

    /// The pattern up to `reach` metres from the geometric centre.
    pub fn pattern(&self, by: Diffraction, reach: f64) -> Pattern {
        // Of a wave this is 32 knots.
        let step = self.detail() / 32.0;
        match by {
            Diffraction::Fraunhofer => {
                Pattern::new(step, reach, |x| sinc(PI * (x / self.detail())).powi(2))
            }
            Diffraction::Fresnel => Pattern::symmetric(step, &self.fresnel(step, reach)),
        }
    }

    /// Fresnel's integral, squared: the light at 0, `step`, 2 `step` ... up to `reach`, over that at 0.
    ///
    /// The light is |int exp(i pi (u^2 (1/R + 1/z) - 2 u x/z) / lambda) du|^2, u from -a/2 to a/2. It is also
    /// the cosine transform of the autocorrelation of exp(i b u^2) over the slit, with
    /// b = pi (1/R + 1/z) / lambda. The autocorrelation has a closed form (the optical transfer function,
    /// Goodman, section 6.4):
    ///
    /// ```text
    /// I(x) = int cos(2 pi x s / (lambda z)) H(s) ds,  H(s) = sin(b s (a - |s|)) / (b s),  s from -a to a
    /// ```
    ///
    /// The trapezoidal rule with N intervals gives a pattern that repeats every N lambda z / a. Its only
    /// error is the tails of the repetitions.
    fn fresnel(&self, step: f64, reach: f64) -> Vec<f64> {
        let details = reach / self.detail();
        // The first repetition is seven times as far as the last knot; the tails fall with the square.
        let intervals = (8.0 * details).ceil().max(64.0) as usize;
        let bend = PI / self.wavelength * (1.0 / self.to_light + 1.0 / self.to_sensor);
        let at = |k| {
            let s = self.width * k as f64 / intervals as f64;
            match k {
                // Half of the middle one: both sides are summed as one.
                0 => 0.5 * self.width,
                _ => libm::sin(bend * s * (self.width - s)) / (bend * s),
            }
        };
        let transfer: Vec<f64> = (0..intervals).map(at).collect();
        let middle: f64 = transfer.iter().sum();
        let knots = (reach / step).ceil() as usize + 1;
        let light = |knot| {
            let turn = TAU * knot as f64 * step / (self.detail() * intervals as f64);
            let (sin, cos) = libm::sincos(turn);
            // exp(i k turn) for k = 0, 1, 2 ...
            let (mut re, mut im) = (1.0, 0.0);
            let mut sum = 0.0;
            for transfer in &transfer {
                sum += re * transfer;
                (re, im) = (re * cos - im * sin, re * sin + im * cos);
            }
            sum / middle
        };
        (0..knots).map(light).collect()
    }
}

/// sin(x) / x.
pub(crate) fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-8 {
        1.0
    } else {
        libm::sin(x) / x
    }
}
