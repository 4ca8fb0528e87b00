//! The pattern of the slit or the lens, in place of a gaussian.

use serde::{Deserialize, Serialize};

/// By which theory the light of a point is spread along the row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Diffraction {
    /// The far field of the aperture: sinc^2 for a slit, eq. (6) of the paper.
    Fraunhofer,
    /// Fresnel's integral over the aperture, exact at the distances of a slit and a sensor.
    Fresnel,
}
