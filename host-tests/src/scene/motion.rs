//! The target moves.

use serde::{Deserialize, Serialize};

/// A target that moves along the laser at a steady speed: its distance changes from row to row, and during an exposure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Metres a second, away from the sensor.
    pub speed: f64,
}
