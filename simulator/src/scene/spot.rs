//! The laser's spot as the slit lets it through.

use phase_tables::gaussian;
use serde::{Deserialize, Serialize};

/// A gaussian along the row (eq. (5) of the paper), where no effect gives it another shape.
///
/// On a sensor of many rows it is as tall as the slit's shadow, or round where a lens makes it. The height is
/// that of the whole spot, in focus, as the sensor sees it: neither [`crate::scene::Diffraction`] nor
/// [`crate::scene::LaserSpot`] changes it. What spreads light besides - defocus, coma, motion - conserves the
/// light and so lowers the spot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spot {
    /// Sigma in pixels.
    pub width: f64,
    /// Height in counts a second of exposure.
    pub counts_per_second: f64,
}

impl Spot {
    /// A spot of this width in pixels and height in counts a second.
    pub const fn new(width: f64, counts_per_second: f64) -> Self {
        Self {
            width,
            counts_per_second,
        }
    }

    /// Adds the gaussian to a row of light, `amplitude` counts high at pixel `centre`.
    pub fn add(&self, light: &mut [f32], centre: f64, amplitude: f64) {
        // Beyond seven sigma a full-scale gaussian is a millionth of a count.
        let reach = 7.0 * self.width;
        for (i, light) in between(light, centre - reach - 1.0, centre + reach + 2.0) {
            *light += (amplitude * gaussian(i as f64 - centre, self.width)) as f32;
        }
    }
}

/// The pixels from one place to another, with their numbers.
pub fn between(light: &mut [f32], from: f64, to: f64) -> impl Iterator<Item = (usize, &mut f32)> {
    let end = light.len() as f64;
    let from = from.floor().clamp(0.0, end) as usize;
    let to = to.ceil().clamp(0.0, end) as usize;
    light.iter_mut().enumerate().take(to).skip(from)
}
