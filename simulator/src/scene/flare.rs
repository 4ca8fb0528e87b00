//! Light that bounces between sensor and lens.

use serde::{Deserialize, Serialize};

use crate::scene::spot::Spot;

/// A ghost of the spot, which the sensor's surface and the lens reflect: it moves against the spot, mirrored
/// about the optical axis. And a veil over the whole row.
///
/// The ghost is gaussian, and round on a sensor of many rows. Where it passes under the spot, near the axis,
/// it pulls the centre to its side; further out it does not (paper, section 4: the variation near the middle
/// of fig. 10a). The veil is a level, which an estimator takes for the black level. W. J. Smith, Modern
/// Optical Engineering, "stray light and baffles".
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

impl Flare {
    /// The pixel in whose place the ghost of a spot at `centre` is, with the axis at pixel `axis`.
    pub fn centre(&self, centre: f64, axis: f64) -> f64 {
        axis - self.magnification * (centre - axis)
    }

    /// Adds ghost and veil to a row of light `rows_off` rows from the middle one, of a spot `amplitude`
    /// counts high at pixel `centre`.
    pub fn add(&self, light: &mut [f32], rows_off: f64, centre: f64, axis: f64, amplitude: f64) {
        let off = rows_off / self.width;
        let height = amplitude * self.strength * libm::exp(-0.5 * off * off);
        Spot::new(self.width, 0.0).add(light, self.centre(centre, axis), height);
        if self.veil > 0.0 {
            let veil = (amplitude * self.veil) as f32;
            light.iter_mut().for_each(|light| *light += veil);
        }
    }
}
