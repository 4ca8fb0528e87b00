//! The sensor's own spot: what its optics do to every spot, as a calibration learned it.
//!
//! A laser's skewed beam or a scratch in the slit makes every spot lopsided in the same way. That is no error
//! once the sensor is calibrated: the curve holds it. So the check compares a row's antisymmetric light with
//! that of the sensor's own spot, and only the rest counts as a flaw.
//!
//! The width tells of flaws too. A wide shadow moves a spot, and leaves it symmetric but narrower.

use serde::{Deserialize, Serialize};

use crate::shape::COMPONENTS;
use crate::uncertainty::{PLACES, between};
use crate::units::Pixels;

/// The sensor's own spot at [`PLACES`] centres, evenly from the first to the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Profile {
    /// The first centre.
    pub first: Pixels,
    /// The last centre.
    pub last: Pixels,
    /// The spot's width.
    pub width: [Pixels; PLACES],
    /// How far the widths of spots without a flaw differ from that, as a standard deviation.
    pub width_deviation: Pixels,
    /// The components of the antisymmetric light, each at all places: see
    /// [`SpotShape::components`](crate::shape::SpotShape::components).
    pub components: [[Pixels; PLACES]; COMPONENTS],
    /// How far the components of spots without a flaw differ from that beyond noise, as a standard deviation.
    pub deviation: Pixels,
}

/// The sensor's own spot at a centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnSpot {
    /// The width in pixels.
    pub width: f32,
    /// See [`Profile::width_deviation`].
    pub width_deviation: f32,
    /// The components in pixels.
    pub components: [f32; COMPONENTS],
    /// See [`Profile::deviation`].
    pub deviation: f32,
}

impl Profile {
    /// Interpolates linearly. Beyond the range the spot is that of its end.
    pub fn at(&self, centre: Pixels) -> OwnSpot {
        let first = self.first.to_f32();
        // Not a number if the range is empty, which counts as its start.
        let along = (centre.to_f32() - first) / (self.last.to_f32() - first);
        OwnSpot {
            width: between(&self.width.map(Pixels::to_f32), along),
            width_deviation: self.width_deviation.to_f32(),
            components: (self.components).map(|values| between(&values.map(Pixels::to_f32), along)),
            deviation: self.deviation.to_f32(),
        }
    }

    /// Whether the widths are above zero, and no deviation is below.
    pub fn is_sensible(&self) -> bool {
        self.width.iter().all(|width| width.to_bits() > 0)
            && self.width_deviation.to_bits() >= 0
            && self.deviation.to_bits() >= 0
    }
}
