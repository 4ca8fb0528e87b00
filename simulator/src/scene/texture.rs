//! The target is not equally bright everywhere.

use rand_distr::{Distribution as _, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::scene::{Effect, random};

/// Grain, fibres, brush marks or rust: a reflectance that varies along the baseline, and weights one side of
/// the laser's spot more than the other.
///
/// The reflectance is log-normal with mean 1: exp(s n - s^2/2), s^2 = ln(1 + contrast^2), of a gaussian
/// random field n whose correlation over x is exp(-(x / length)^2). The field is white noise at points a
/// quarter of `length` apart, smoothed; it repeats after 1024 lengths. It belongs to the surface, and so to
/// the seed: the spot's centre is off by the same as long as the laser hits the same place
/// ([`crate::scene::LaserSpot::wander`]).
///
/// Where the grain is fine across the baseline too, a spot of standard deviation s averages it: `contrast` is
/// what is left, (1 + 4 s^2 / length^2)^(-1/4) of the surface's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Texture {
    /// Standard deviation of the reflectance over its mean.
    pub contrast: f64,
    /// Distance along the baseline over which the correlation falls to 1/e, in metres.
    pub length: f64,
}

/// Points of white noise on a correlation length.
const POINTS: f64 = 4.0;
/// Points after which the surface repeats: a power of two.
const PERIOD: usize = 4096;

/// A surface: its texture, and the white noise that it is made of.
#[derive(Clone, Debug)]
pub struct Surface {
    texture: Texture,
    noise: Vec<f64>,
}

impl Texture {
    /// The surface that a seed makes.
    pub fn surface(&self, seed: u64) -> Surface {
        let mut random = random::of_scene(seed, Effect::Texture);
        Surface {
            texture: *self,
            noise: Vec::from_iter((0..PERIOD).map(|_| StandardNormal.sample(&mut random))),
        }
    }
}

impl Surface {
    /// Reflectance over its mean at a place along the baseline, in metres.
    pub fn reflectance(&self, place: f64) -> f64 {
        let variance = libm::log1p(self.texture.contrast * self.texture.contrast);
        libm::exp(variance.sqrt() * self.field(place) - 0.5 * variance)
    }

    /// The gaussian field of variance 1: white noise smoothed with exp(-2 x^2 / length^2), which convolved
    /// with itself is the correlation.
    fn field(&self, place: f64) -> f64 {
        // Beyond two lengths the kernel is below 4e-4 of its peak, of which the square counts.
        const REACH: i64 = (2.0 * POINTS) as i64;
        let points = place / self.texture.length * POINTS;
        let middle = points.round();
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in -REACH..=REACH {
            let point = middle + i as f64;
            let off = (point - points) / POINTS;
            let weight = libm::exp(-2.0 * off * off);
            sum += weight * self.noise[(point as i64).rem_euclid(PERIOD as i64) as usize];
            squares += weight * weight;
        }
        sum / squares.sqrt()
    }
}
