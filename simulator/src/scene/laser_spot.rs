//! The laser's spot on the target is no point.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::optics::Optics;

/// A gaussian beam on the target: its light comes from an area, each point of which makes a pattern of its
/// own.
///
/// The sensor sees the spot at an angle, foreshortened, and z/R as large as it is, where z is from the slit
/// (or lens) to the sensor and R from there to the target. Without [`crate::scene::Speckle`] the points'
/// patterns add up as light, not as waves: a gaussian [`crate::scene::Spot`] stays one, and grows in
/// quadrature by the image of the beam's standard deviation, which is a quarter of its 1/e^2 diameter.
///
/// The spot's height is given as it is seen: it does not fall as the spot gets wider.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserSpot {
    /// 1/e^2 diameter of the beam at its waist, in metres.
    pub waist: f64,
    /// Distance of the waist from the laser, in metres.
    pub waist_distance: f64,
    /// Metres by which the surface slides along under the spot for each metre that the target moves away: the
    /// angle in radians by which beam and travel differ. It matters where places of the surface differ
    /// (texture, speckle). Speckle's surface repeats after 8 mm, or after 2.4 of the widest beam's diameters.
    #[serde(default)]
    pub wander: f64,
}

impl LaserSpot {
    /// The spot of a beam along which the target travels: it does not wander.
    pub const fn new(waist: f64, waist_distance: f64) -> Self {
        Self {
            waist,
            waist_distance,
            wander: 0.0,
        }
    }

    /// 1/e^2 diameter of the beam in metres, at a distance in metres from the laser: D0 sqrt(1 + (z/zR)^2),
    /// zR = pi D0^2 / (4 lambda), z from the waist (A. E. Siegman, Lasers, 1986, section 17.1).
    pub fn diameter(&self, distance: f64, wavelength: f64) -> f64 {
        let rayleigh = PI * self.waist * self.waist / (4.0 * wavelength);
        self.waist * libm::hypot(1.0, (distance - self.waist_distance) / rayleigh)
    }

    /// Standard deviation of the light over the target, in metres.
    pub fn deviation(&self, distance: f64, wavelength: f64) -> f64 {
        self.diameter(distance, wavelength) / 4.0
    }

    /// The place on the surface that the beam's middle hits, along the baseline, in metres.
    pub fn place(&self, distance: f64) -> f64 {
        self.wander * distance
    }
}

/// Metres on the sensor for a metre on the target along the baseline, towards the sensor: negative, as the
/// image is upside down.
pub fn image_scale(optics: &Optics, distance: f64) -> f64 {
    -image_scale_across(optics, distance) * libm::cos(optics.viewing_angle(distance))
}

/// The same across the baseline, without sign.
pub fn image_scale_across(optics: &Optics, distance: f64) -> f64 {
    optics.focal_length / optics.range(distance)
}
