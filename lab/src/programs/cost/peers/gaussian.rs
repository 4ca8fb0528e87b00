//! The curve that everyone fits: eq. (5) on a level, A exp(-(s (x - x0))^2) + b.

use nalgebra::{RealField, Vector4, convert};

/// Pixels in the window that is fitted, the paper's.
pub const WINDOW: usize = 128;

/// The four parameters of eq. (5), pixel 0 being the window's first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// A, in counts.
    pub amplitude: f64,
    /// x0, in pixels.
    pub centre: f64,
    /// s, in 1/pixel: 1/(sigma sqrt 2).
    pub scale: f64,
    /// b, in counts.
    pub level: f64,
}

impl Parameters {
    pub fn to_array(self) -> [f64; 4] {
        [self.amplitude, self.centre, self.scale, self.level]
    }

    pub fn from_array([amplitude, centre, scale, level]: [f64; 4]) -> Self {
        Self {
            amplitude,
            centre,
            scale,
            level,
        }
    }
}

/// exp(-(s (x - x0))^2) for the window's pixels.
///
/// The part of eq. (5) that costs time; residuals and derivatives share it.
pub fn light<T: RealField + Copy>(centre: T, scale: T) -> [T; WINDOW] {
    std::array::from_fn(|pixel| {
        let u = scale * (convert::<f64, T>(pixel as f64) - centre);
        (-u * u).exp()
    })
}

/// The derivatives of eq. (5) by A, x0, s and b at a pixel whose [`light`] is given.
pub fn derivatives<T: RealField + Copy>(pixel: usize, light: T, parameters: &Vector4<T>) -> [T; 4] {
    let [amplitude, centre, scale, _] = parameters.data.0[0];
    let distance = convert::<f64, T>(pixel as f64) - centre;
    let common = convert::<f64, T>(2.0) * amplitude * light * scale * distance;
    [light, common * scale, -common * distance, T::one()]
}

#[cfg(test)]
pub mod examples {
    use super::*;
    use crate::programs::cost::peers::rows::{self, Window};

    /// Where a fit starts: off by half a pixel, 5 % in width, 10 % in height and 3 counts in level.
    pub fn start() -> Parameters {
        Parameters {
            amplitude: 2200.0,
            centre: 63.8,
            scale: 0.0707,
            level: 103.0,
        }
    }

    pub fn noiseless() -> (Parameters, [f64; WINDOW]) {
        let truth = Parameters {
            amplitude: 2000.0,
            centre: 64.3,
            scale: 1.0 / (10.5 * std::f64::consts::SQRT_2),
            level: 100.0,
        };
        let light = light(truth.centre, truth.scale);
        let pixels = light.map(|light: f64| truth.amplitude * light + truth.level);
        (truth, pixels)
    }

    /// Windows of the reference scene.
    pub fn noisy(rows: usize) -> Vec<Window> {
        rows::windows(rows).expect("a spot in each row")
    }
}
