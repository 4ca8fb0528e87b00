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
//! third. [`Asymmetry::shape`] adds the components up with these factors, if they are more than noise.
//!
//! A component is written as the shift of the spot, in pixels, that has the same norm. So the noise of each
//! is that of a weighted fit's centre.

use crate::units::Pixels;

/// Number of components.
pub const COMPONENTS: usize = 5;

/// The components of a spot's antisymmetric light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Asymmetry {
    /// Along u e, u, u^3 e, u^5 e and u^7 e, as shifts.
    pub components: [Pixels; COMPONENTS],
    /// The standard deviation of each component by noise.
    pub noise: Pixels,
    /// How far the antisymmetric light that no component describes may have moved the centre: that of a few
    /// pixels.
    pub rest: Pixels,
}

/// The hidden shift over each component.
const HIDDEN: [f32; COMPONENTS] = [1.0, 0.5, 3.0, 2.0, 1.0];

/// The sum of the squares of the components, in variances, that noise exceeds in 1 % of the spots: chi square
/// of four degrees of freedom. The estimator takes the fifth.
const NOISE: f32 = 13.3;

impl Asymmetry {
    /// The standard uncertainty of the centre that comes from the spot's shape, in pixels. Zero if noise
    /// explains the components.
    pub fn shape(&self) -> Pixels {
        let components = self.components.map(Pixels::to_f32);
        Pixels::from_f32(shape(components, self.noise.to_f32(), self.rest.to_f32()))
    }
}

/// See [`Asymmetry::shape`]. No square exceeds 2^32.
pub(crate) fn shape(components: [f32; COMPONENTS], noise: f32, rest: f32) -> f32 {
    let squares: f32 = components.iter().map(|it| it * it).sum();
    let hidden: f32 = (components.iter().zip(HIDDEN))
        .map(|(it, factor)| it * it * factor * factor)
        .sum();
    let beyond = squares - NOISE * noise * noise;
    let hidden = if beyond > 0.0 {
        hidden * (beyond / squares)
    } else {
        0.0
    };
    libm::sqrtf(hidden + rest * rest)
}
