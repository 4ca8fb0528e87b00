//! What a lens does that a slit does not.

use serde::{Deserialize, Serialize};

/// The lens is focused on one distance, and the target is at another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Defocus {
    /// From the lens to the plane that is sharp, in metres.
    pub focus_distance: f64,
}

/// Third-order coma: points off the axis have a tail (W131 in Hopkins's notation).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coma {
    /// Wavefront error at the pupil's edge for a point at `field`, in waves.
    pub waves: f64,
    /// Distance from the axis on the sensor for which `waves` holds, in metres.
    pub field: f64,
}

/// Third-order distortion: a point at x is drawn at x (1 + share (x / field)^2).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Distortion {
    /// Displacement over distance from the axis, at `field`: 0.001 for 0.1 %.
    pub share: f64,
    /// Distance from the axis on the sensor for which `share` holds, in metres.
    pub field: f64,
}

impl Distortion {
    /// Where a point at `centre` is drawn, in pixels.
    pub fn displaced(&self, centre: f64, axis: f64, pitch: f64) -> f64 {
        let x = centre - axis;
        let relative = x * pitch / self.field;
        axis + x * (1.0 + self.share * relative * relative)
    }
}
