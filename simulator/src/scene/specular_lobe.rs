//! The target shines towards its mirror direction.

use serde::{Deserialize, Serialize};

/// A glossy surface scatters a share of the light into a lobe about the mirror direction, which is back into
/// the laser for one that is square to it: its brightness changes with the angle under which the sensor sees
/// it, and so with the distance.
///
/// The lobe is gaussian in the angle to the mirror direction, on the even light of a rough surface (S. K.
/// Nayar, K. Ikeuchi, T. Kanade, IEEE Trans. Pattern Anal. Mach. Intell. 13, 611 (1991): diffuse and specular
/// lobe). It does not move the centre, as an aperture of a few milliradians sees one angle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpecularLobe {
    /// Brightness of the lobe's middle over that of the surface without it.
    pub strength: f64,
    /// Sigma of the lobe, in radians.
    pub width: f64,
    /// Tilt of the surface towards the sensor, in radians.
    #[serde(default)]
    pub tilt: f64,
}

impl SpecularLobe {
    /// Brightness over that of the surface without a lobe, seen at an angle from the laser in radians.
    pub fn factor(&self, angle: f64) -> f64 {
        let off = (angle - 2.0 * self.tilt) / self.width;
        1.0 + self.strength * libm::exp(-0.5 * off * off)
    }
}
