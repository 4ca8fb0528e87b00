//! Eq. (1) of the paper as it stands there, with its trigonometry, in metres: the simulation's truth.
//! Functions are libm's, which are the same on any machine.

use serde::{Deserialize, Serialize};

use crate::sensor::Sensor;

/// What the light passes on its way to the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aperture {
    /// A slit, across the row.
    Slit {
        /// Along the row, in metres.
        width: f64,
        /// Across the row, in metres.
        height: f64,
    },
    /// A lens, which images the target on the sensor.
    Lens {
        /// Diameter of its pupil, in metres.
        diameter: f64,
    },
}

impl Aperture {
    /// The paper's slit (section 3): 200 um x 3 mm.
    pub const PAPER_SLIT: Self = Self::Slit {
        width: 200e-6,
        height: 3e-3,
    };
    /// The paper's lens (section 3): 50 mm at f/12.
    pub const PAPER_LENS: Self = Self::Lens {
        diameter: 50e-3 / 12.0,
    };
}

/// A slit or a lens in front of a line sensor, and the laser beside it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Optics {
    /// d0: from the laser's origin to the casing's front, in metres.
    pub offset: f64,
    /// b: from the laser to the slit, in metres.
    pub baseline: f64,
    /// f: from the slit to the sensor, in metres.
    pub focal_length: f64,
    /// u: the angle of the optical axis to the casing, in radians.
    pub angle: f64,
    /// The pixels' pitch in metres.
    pub pitch: f64,
    /// The pixel on the optical axis.
    pub axis: f64,
    /// The light's wavelength in metres.
    pub wavelength: f64,
    /// Slit or lens. Where the scene has a [`crate::scene::Comb`], its slits take the place of this one.
    pub aperture: Aperture,
}

impl Optics {
    /// The geometry for which the firmware carries its nominal calibration: 300 mm, 50 mm, tan u = 2.6, 8 um
    /// pixels.
    pub fn nominal() -> Self {
        Self::nominal_on(Sensor::Tcd1304dg)
    }

    /// The same in front of a sensor, whose middle is on the axis.
    pub fn nominal_on(sensor: Sensor) -> Self {
        Self {
            offset: 0.0,
            baseline: 0.3,
            focal_length: 0.05,
            angle: libm::atan(2.6),
            pitch: sensor.pitch(),
            axis: (sensor.geometry().light.len() as f64 - 1.0) / 2.0,
            wavelength: 650e-9,
            aperture: Aperture::PAPER_SLIT,
        }
    }

    /// The optics of a slit that is not on the axis, but `place` metres from the axis along the row, in the
    /// direction in which pixels count: eq. (1) holds with another d0, b and axis. All else is equal.
    ///
    /// Take x away from the laser along the casing, and z along the beam. The axis runs from the slit at (b,
    /// d0) towards the beam along (-cos u, sin u), and light at an angle a to the axis, which falls at f
    /// tan(a), comes along (cos(u - a), -sin(u - a)) = cos(a) (cos u, -sin u) + sin(a) (sin u, cos u). So
    /// (sin u, cos u) is the row's direction. A slit s along the row is at (b + s sin u, d0 + s cos u), and
    /// the foot of its own axis on the sensor is s further along the row.
    #[must_use]
    pub fn behind(&self, place: f64) -> Self {
        let (sin, cos) = libm::sincos(self.angle);
        Self {
            offset: self.offset + place * cos,
            baseline: self.baseline + place * sin,
            axis: self.axis + place / self.pitch,
            ..*self
        }
    }

    /// Distance in metres for a centre in pixels: d0 + b tan(u - atan(x / f)).
    pub fn distance(&self, centre: f64) -> f64 {
        let x = (centre - self.axis) * self.pitch;
        self.offset + self.baseline * libm::tan(self.angle - libm::atan(x / self.focal_length))
    }

    /// The centre in pixels of a target at a distance in metres.
    pub fn centre(&self, distance: f64) -> f64 {
        let alpha = self.angle - libm::atan((distance - self.offset) / self.baseline);
        self.axis + self.focal_length * libm::tan(alpha) / self.pitch
    }

    /// The angle between the laser's beam and the light that reaches the sensor, in radians, for a target at
    /// a distance in metres.
    pub fn viewing_angle(&self, distance: f64) -> f64 {
        libm::atan(self.baseline / (distance - self.offset))
    }

    /// From the target at a distance to the slit, in metres.
    pub fn range(&self, distance: f64) -> f64 {
        libm::hypot(self.baseline, distance - self.offset)
    }

    /// Metres a pixel at a centre, without sign.
    pub fn metres_per_pixel(&self, centre: f64) -> f64 {
        (self.distance(centre + 0.5) - self.distance(centre - 0.5)).abs()
    }
}
