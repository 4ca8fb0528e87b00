//! The shape of a spot, and how far a flaw that changed it may have moved the centre.
//!
//! A spot that is not its own mirror image has no single centre: two estimators find two. The check
//! ([`crate::check`]) writes the difference of a row and its mirror image as a sum of u e, u, u^3 e, u^5 e
//! and u^7 e, with u the distance from the centre in widths and e = exp(-u^2/2). Each function is made
//! orthogonal to those before it, with the weights of the pixels' noise.
//!
//! A flaw is hidden as far as it looks like a shift, u e: the estimator moves the centre until that part is
//! gone. The other parts stay. They tell how large the hidden part may be, because a flaw seldom looks like a
//! shift alone. [`SpotShape::uncertainty`] estimates it: each part times the factor that shadows, second
//! reflections, fringes and tails have. (host-tests/tests/shape.rs tests them on random flaws.)
//!
//! A wide and weak shadow hides nearly all of itself: it leaves a spot that is symmetric, but narrower. Only
//! a sensor that knows the width of its own spot ([`crate::check::own_spot`]) sees it.

use serde::{Deserialize, Serialize};

use crate::base::numeric::square;
use crate::base::{Pixels, numeric};

/// Number of the components of the antisymmetric light.
pub const COMPONENTS: usize = 5;

/// The shape of a spot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SpotShape {
    /// The antisymmetric light: its components along u e, u, u^3 e, u^5 e and u^7 e. Each is given as the
    /// shift of the spot, in pixels, that changes the row as much.
    pub components: [Pixels; COMPONENTS],
    /// The standard deviation of each component by noise: that of a weighted fit's centre.
    pub noise: Pixels,
    /// The width of the gaussian that fits the symmetric light best. Its noise is that of a component,
    /// nearly. The estimators' width is that at half of the height, and seldom measured again within a
    /// frame. Zero if the check had too few pairs to tell the shape.
    pub width: Pixels,
    /// How far the light of a few pixels, which no component describes, may have moved the centre.
    pub rest: Pixels,
}

/// The sensor's own spot at a centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnSpot {
    /// The width.
    pub width: Pixels,
    /// How far the widths of spots without a flaw differ from that, as a standard deviation.
    pub width_deviation: Pixels,
    /// The components.
    pub components: [Pixels; COMPONENTS],
    /// How far the components of spots without a flaw differ from those beyond noise, as a standard
    /// deviation.
    pub deviation: Pixels,
}

/// The uncertainty that the sets of [`adaptive`](crate::centre::Estimator::Adaptive) add, over how lopsided
/// the spot is. The centres by two sets may differ by more. But most readings take the set of their
/// calibration, so this is enough: at a skewness of 0.1, all of 1000 simulated readings of 16 rows are within
/// 2u (tool/tests/fit/own_spot.rs).
const BETWEEN_SETS: f32 = 0.1;
/// The hidden shift over each component. Of the flaws in host-tests/tests/shape.rs, 99 % are hidden by less
/// than five times what these factors give.
const HIDDEN: [f32; COMPONENTS] = [2.0, 1.0, 5.0, 3.0, 2.0];
/// The hidden shift over the change of the width. Wide shadows that leave a spot symmetric move it by 0.5 to
/// 7 times the change; half of them by less than 1.5 times.
const HIDDEN_BY_WIDTH: f32 = 2.0;
/// The largest sum of squares of the components, in variances, that counts as noise. Noise exceeds it in 1.5
/// % of the spots (chi square of four degrees of freedom: the estimator makes the shift zero), and then u
/// grows. On average over all spots it grows by 4 %.
const NOISE: f32 = 12.3;
/// As [`NOISE`] with the width, for a sensor that knows its own spot: 2 % (five degrees of freedom).
const NOISE_WITH_WIDTH: f32 = 13.4;

impl SpotShape {
    /// Whether the sum of squares of the components is more than so many variances.
    #[inline(always)]
    pub(super) fn exceeds(&self, variances: i64) -> bool {
        let squared = |it: Pixels| numeric::product(it.to_bits(), it.to_bits());
        let squares =
            (self.components.iter()).fold(0, |sum, &it| i64::saturating_add(sum, squared(it)));
        squares > squared(self.noise).saturating_mul(variances)
    }

    /// The standard uncertainty of the centre by the spot's shape. Zero, but for [`Self::rest`], if noise
    /// explains how the spot differs from the sensor's own one. `None`: any symmetric spot may be the
    /// sensor's own.
    ///
    /// Two lengths differ by at most 2^16 pixels, and a variance is at least 2^-32, so no sum exceeds 2^67.
    pub fn uncertainty(&self, own: Option<&OwnSpot>) -> Pixels {
        // At least a step, so that no division is by zero.
        let noise = square(self.noise.max(Pixels::from_bits(1)).to_f32());
        let mut components = self.components.map(Pixels::to_f32);
        let (mut chi_square, mut hidden, mut variance, mut limit) = (0.0, 0.0, noise, NOISE);
        // Where the check had too few pairs, nothing is known.
        if let Some(own) = own.filter(|_| self.width > Pixels::default()) {
            for (component, own) in components.iter_mut().zip(own.components) {
                *component -= own.to_f32();
            }
            variance = noise + square(own.deviation.to_f32());
            limit = NOISE_WITH_WIDTH;
            let wider = square(self.width.to_f32() - own.width.to_f32());
            chi_square = wider / (noise + square(own.width_deviation.to_f32()));
            hidden = wider * square(HIDDEN_BY_WIDTH);
        }
        for (component, factor) in components.iter().zip(HIDDEN) {
            chi_square += square(*component) / variance;
            hidden += square(component * factor);
        }
        let beyond_noise = if chi_square > limit {
            1.0 - limit / chi_square
        } else {
            0.0
        };
        let variance = hidden * beyond_noise + square(self.rest.to_f32());
        Pixels::from_f32(dual_mac::square_root(variance))
    }

    /// As [`Self::uncertainty`], for an estimator with several sets of tables. If the sensor's own spot is
    /// lopsided, each set has another centre of it. The calibration's curve holds the centres by the sets
    /// that the heights of the spot chose then. The height of the spot in a reading may choose another set.
    ///
    /// Each of five components is at most 2^15 pixels, so no sum exceeds 2^33.
    pub fn uncertainty_by_sets(&self, own: Option<&OwnSpot>) -> Pixels {
        let by_flaws = self.uncertainty(own);
        let Some(own) = own else { return by_flaws };
        let lopsided: f32 = own.components.iter().map(|it| square(it.to_f32())).sum();
        let variance = square(by_flaws.to_f32()) + square(BETWEEN_SETS) * lopsided;
        Pixels::from_f32(dual_mac::square_root(variance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spot(components: [f32; COMPONENTS]) -> SpotShape {
        SpotShape {
            components: components.map(Pixels::from_f32),
            noise: Pixels::from_f32(0.01),
            width: Pixels::from_int(8),
            rest: Pixels::default(),
        }
    }

    const fn own(components: [Pixels; COMPONENTS]) -> OwnSpot {
        OwnSpot {
            width: Pixels::from_int(8),
            width_deviation: Pixels::from_positive_f32(0.02),
            components,
            deviation: Pixels::from_int(0),
        }
    }

    const NONE: Pixels = Pixels::from_int(0);
    const OWN: OwnSpot = own([NONE, NONE, Pixels::from_positive_f32(0.5), NONE, NONE]);

    #[test]
    fn noise_adds_nothing_and_a_flaw_adds_what_it_may_hide() {
        // 12.25 variances.
        let noise = spot([0.0, 0.0, 0.035, 0.0, 0.0]);
        assert_eq!(noise.uncertainty(None), Pixels::default());
        // 3600 variances, of which noise explains 12.3.
        let flaw = spot([0.0, 0.0, 0.6, 0.0, 0.0]);
        let expected = 5.0 * 0.6 * libm::sqrtf(1.0 - 12.3 / 3600.0);
        assert!((flaw.uncertainty(None).to_f32() - expected).abs() < 1e-3);
        // Bad pixels count for themselves.
        let rest = Pixels::from_f32(0.125);
        let bad_pixels = SpotShape { rest, ..noise };
        assert_eq!(bad_pixels.uncertainty(None), rest);
    }

    #[test]
    fn the_sensors_own_spot_has_no_flaw() {
        let own = SpotShape {
            components: OWN.components,
            ..spot([0.0; 5])
        };
        assert!(own.uncertainty(None) > Pixels::from_int(2));
        assert_eq!(own.uncertainty(Some(&OWN)), Pixels::default());
        // A symmetric spot is a flaw then.
        assert!(spot([0.0; 5]).uncertainty(Some(&OWN)) > Pixels::from_int(2));
        // So is another width: 0.3 pixels, 180 variances.
        let width = Pixels::from_f32(7.7);
        let narrower = SpotShape { width, ..own };
        let expected = 2.0 * 0.3 * libm::sqrtf(1.0 - 13.4 * 5e-4 / 0.09);
        assert!((narrower.uncertainty(Some(&OWN)).to_f32() - expected).abs() < 1e-3);
        assert_eq!(narrower.uncertainty(None), own.uncertainty(None));
    }

    #[test]
    fn the_sets_of_adaptive_have_other_centres_of_a_lopsided_spot() {
        let same = spot([0.0, 0.0, 3.0, -4.0, 0.0]);
        let own = own(same.components);
        let by_sets = |own| same.uncertainty_by_sets(own).to_f32();
        assert!((by_sets(Some(&own)) - 0.1 * 5.0).abs() < 1e-4);
        assert_eq!(same.uncertainty(Some(&own)).to_f32(), 0.0);
        let symmetric = super::tests::own([NONE; COMPONENTS]);
        for own in [None, Some(&symmetric)] {
            assert_eq!(by_sets(own), same.uncertainty(own).to_f32());
        }
        // 1.2 pixels of a flaw and 0.5 make 1.3.
        let rest = Pixels::from_f32(1.2);
        let bad_pixels = SpotShape { rest, ..same };
        assert!((bad_pixels.uncertainty_by_sets(Some(&own)).to_f32() - 1.3).abs() < 1e-4);
    }

    #[test]
    fn without_noise_any_component_is_a_flaw() {
        let certain = SpotShape {
            noise: Pixels::default(),
            ..spot([0.0, 0.0, 0.0, 0.0, 0.001])
        };
        assert!((certain.uncertainty(None).to_f32() - 0.002).abs() < 1e-4);
        for own in [None, Some(&OWN)] {
            assert_eq!(SpotShape::default().uncertainty(own), Pixels::default());
        }
    }
}
