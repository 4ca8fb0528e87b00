//! Eq. (1) of the paper as it stands there, with its trigonometry, in metres: the simulation's truth.

/// A slit in front of a line sensor, and the laser beside it.
#[derive(Clone, Copy, Debug, PartialEq)]
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
}

impl Optics {
    /// The geometry for which the firmware carries its nominal calibration: 300 mm, 50 mm, tan u = 2.6, 8 um pixels.
    pub fn nominal() -> Self {
        Self {
            offset: 0.0,
            baseline: 0.3,
            focal_length: 0.05,
            angle: 2.6f64.atan(),
            pitch: 8e-6,
            axis: 1823.5,
        }
    }

    /// Distance in metres for a centre in pixels: d0 + b tan(u - atan(x / f)).
    pub fn distance(&self, centre: f64) -> f64 {
        let x = (centre - self.axis) * self.pitch;
        self.offset + self.baseline * (self.angle - (x / self.focal_length).atan()).tan()
    }

    /// The centre in pixels of a target at a distance in metres.
    pub fn centre(&self, distance: f64) -> f64 {
        let alpha = self.angle - ((distance - self.offset) / self.baseline).atan();
        self.axis + self.focal_length * alpha.tan() / self.pitch
    }

    /// Metres a pixel at a centre, without sign.
    pub fn metres_per_pixel(&self, centre: f64) -> f64 {
        let step = 0.5;
        ((self.distance(centre + step) - self.distance(centre - step)) / (2.0 * step)).abs()
    }
}
