//! A rough target lit by coherent light.

use serde::{Deserialize, Serialize};

/// Coherent light from a rough surface, summed as a field through the aperture ([`crate::field`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Speckle {
    /// 1 for a surface that keeps the laser's polarisation (metal, gloss), 2 for one that does not (paper, wood).
    pub polarisations: u8,
    /// Full width at half maximum of the laser's spectrum, in metres.
    #[serde(default)]
    pub linewidth: f64,
    /// Mean of the exponentially distributed extra path of light within the material, in metres.
    #[serde(default)]
    pub path_spread: f64,
}
