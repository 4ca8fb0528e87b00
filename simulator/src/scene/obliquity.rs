//! Light that comes in at an angle makes an asymmetric pattern.

use serde::{Deserialize, Serialize};

/// Diffraction is symmetric in the sine of the angle, and the sensor is flat: off the axis the pattern is
/// wider on its outer side, and dimmer.
///
/// Light at an angle a to the axis falls at x = f tan(a), where f is from the slit to the sensor. The pattern
/// is a function of q = f (sin(a) - sin(a0)), a0 being the angle of the geometric centre, instead of x - x0;
/// and the irradiance falls with cos^4(a): the sensor's and the slit's slant, and the distance squared (W. J.
/// Smith, Modern Optical Engineering, "cosine fourth"). For a gaussian of sigma s on the axis the centre of
/// mass moves outwards by
///
/// ```text
/// s^2 sin(a0) / (2 f cos^5(a0))
/// ```
///
/// as dx = dq / cos^3(a) and d^2x/dq^2 = 3 sin(a) / (f cos^5(a)).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obliquity {}

/// A pattern about a geometric centre, on a sensor that is flat.
#[derive(Clone, Copy, Debug)]
pub struct Oblique {
    to_sensor: f64,
    sin_centre: f64,
}

impl Oblique {
    /// For a centre `centre` metres from the axis, on a sensor `to_sensor` metres behind the slit.
    pub fn new(centre: f64, to_sensor: f64) -> Self {
        Self {
            to_sensor,
            sin_centre: centre / libm::hypot(centre, to_sensor),
        }
    }

    /// Cosine of the centre's angle to the axis, by which a small angle in the plane of the row changes the
    /// sine.
    pub fn cosine(&self) -> f64 {
        (1.0 - self.sin_centre * self.sin_centre).sqrt()
    }

    /// q at a place in metres from the axis, and the factor of the light there.
    pub fn seen(&self, place: f64) -> (f64, f64) {
        let hypotenuse = libm::hypot(place, self.to_sensor);
        let cosine = self.to_sensor / hypotenuse;
        (
            self.to_sensor * (place / hypotenuse - self.sin_centre),
            (cosine * cosine) * (cosine * cosine),
        )
    }

    /// The place in metres from the axis for a q.
    pub fn place(&self, q: f64) -> f64 {
        // Not beyond 84 degrees.
        let sine = (self.sin_centre + q / self.to_sensor).clamp(-0.995, 0.995);
        self.to_sensor * sine / (1.0 - sine * sine).sqrt()
    }
}
