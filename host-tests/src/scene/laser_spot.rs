//! The laser's spot on the target is no point.

use serde::{Deserialize, Serialize};

/// A gaussian beam on the target: its light comes from an area, each point of which makes a pattern of its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserSpot {
    /// 1/e^2 diameter of the beam at its waist, in metres.
    pub waist: f64,
    /// Distance of the waist from the laser, in metres.
    pub waist_distance: f64,
}
