//! The target is not equally bright everywhere.

use serde::{Deserialize, Serialize};

/// Grain, fibres, brush marks or rust: a reflectance that varies over the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Texture {
    /// Standard deviation of the reflectance over its mean.
    pub contrast: f64,
    /// Correlation length along the baseline, in metres.
    pub length: f64,
}
