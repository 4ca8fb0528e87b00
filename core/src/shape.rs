//! How much the antisymmetric light of a spot may have moved its centre.
//!
//! A spot that is not its own mirror image has no single centre: two estimators find two. The check
//! ([`crate::check`]) takes the row less its mirror image about the centre apart into orthonormal functions
//! of u, the distance from the centre in widths: u e, u, u^3 e, u^5 e and u^7 e, with e = exp(-u^2/2), each
//! less its parts along those before. The first is what a shift of the spot looks like, so an estimator hides
//! that part of any flaw: its centre moves until the part is gone. The others stay, and tell how large the
//! hidden part may be.
//!
//! Shadows of dust, second reflections, fringes and tails have been taken apart in the same way. The hidden
//! part of the narrow ones is as large as the higher components, and of the wide ones several times the
//! third. [`SpotShape::shape`] adds the components up with these factors, if they are more than noise.
//!
//! A component is written as the shift of the spot, in pixels, that has the same norm. So the noise of each
//! is that of a weighted fit's centre.

use crate::profile::OwnSpot;
use crate::units::Pixels;

/// Number of components.
pub const COMPONENTS: usize = 5;

/// The components of a spot's antisymmetric light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpotShape {
    /// Along u e, u, u^3 e, u^5 e and u^7 e, as shifts.
    pub components: [Pixels; COMPONENTS],
    /// The width of the gaussian that fits the symmetric light best. The estimators' width is that at half
    /// of the height, and seldom measured again within a frame.
    pub width: Pixels,
    /// The standard deviation of each component, and nearly that of the width, by noise.
    pub noise: Pixels,
    /// How far the antisymmetric light that no component describes may have moved the centre: that of a few
    /// pixels.
    pub rest: Pixels,
}

/// The hidden shift over each component.
const HIDDEN: [f32; COMPONENTS] = [2.0, 1.0, 5.0, 3.0, 2.0];

/// The sum of the squares of the components, in variances, that noise exceeds in 1.5 % of the spots: chi
/// square of four degrees of freedom. The estimator takes the fifth.
const NOISE: f32 = 12.3;

/// The hidden shift over a change of the width. Of the shadows that leave a spot symmetric, half move it by
/// less than 1.5 times the change.
const HIDDEN_A_WIDTH: f32 = 2.0;

/// The width of a spot without a flaw is within so many standard deviations of the sensor's own.
const NOISE_WITH_WIDTH: f32 = 13.4;

impl SpotShape {
    /// The standard uncertainty of the centre that comes from the spot's shape, in pixels. Zero if noise
    /// explains how the spot differs from the sensor's own. Without one (`None`) the spot of the sensor is
    /// symmetric, and has any width.
    pub fn uncertainty(&self, own: Option<&OwnSpot>) -> Pixels {
        let (beyond, deviation) = match own {
            Some(own) => (self.beyond(own), own.deviation),
            None => (self.components.map(Pixels::to_f32), 0.0),
        };
        let noise = self.noise.to_f32();
        // No square of a number of pixels exceeds 2^32.
        let variance = noise * noise + deviation * deviation;
        let (wider, width_variance) = own.map_or((0.0, variance), |own| {
            let deviation = own.width_deviation;
            (
                self.width.to_f32() - own.width,
                noise * noise + deviation * deviation,
            )
        });
        let squares: f32 = beyond.iter().map(|it| it * it).sum();
        let hidden: f32 = (beyond.iter().zip(HIDDEN))
            .map(|(it, factor)| it * it * factor * factor)
            .sum();
        let chi_square = squares / variance + wider * wider / width_variance;
        let limit = if own.is_some() {
            NOISE_WITH_WIDTH
        } else {
            NOISE
        };
        let hidden = hidden + wider * wider * HIDDEN_A_WIDTH * HIDDEN_A_WIDTH;
        let hidden = if chi_square > limit {
            hidden * (1.0 - limit / chi_square)
        } else {
            0.0
        };
        let rest = self.rest.to_f32();
        Pixels::from_f32(libm::sqrtf(hidden + rest * rest))
    }

    /// The components beyond those of the sensor's own spot, in pixels.
    pub(crate) fn beyond(&self, own: &OwnSpot) -> [f32; COMPONENTS] {
        let mut beyond = self.components.map(Pixels::to_f32);
        for (component, own) in beyond.iter_mut().zip(own.components) {
            *component -= own;
        }
        beyond
    }
}
