//! Light that bounces between sensor and lens.

use serde::{Deserialize, Serialize};

/// A ghost of the spot, which the sensor's surface and the lens reflect: it moves against the spot, mirrored about the optical axis. And a veil over the
/// whole row.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Flare {
    /// The ghost's distance from the axis over the spot's, on the other side.
    pub magnification: f64,
    /// Sigma of the ghost in pixels: it is out of focus.
    pub width: f64,
    /// Height of the ghost over the spot's.
    pub strength: f64,
    /// Level of the veil over the spot's height.
    #[serde(default)]
    pub veil: f64,
}
