//! Properties of every eq. (1) with residuals.

use super::common::{STEP, holds_what_it_promises, largest_rise, places};
use crate::records::{cases, chain};
use crate::support::*;

/// Takes every centre of some intervals, one by one: two roundings can move the distance the wrong way.
#[test]
fn a_corrected_distance_turns_back_by_the_stated_steps_at_most() {
    let curve = NOMINAL.expect("a curve");
    let (first, last) = (2600, 2620);
    // As steep against the curve as may be, and level. A cubic is half as steep again as its secants.
    let rises = [0, 50, 50, 0, -50, -50];
    let mut value = 0;
    let knots = (first..=last).map(|centre| {
        value += rises[(centre - first) as usize % rises.len()];
        knot(centre, value)
    });
    let knots: Vec<Knot> = knots.collect();
    let corrected = Corrected::new(curve, &knots).expect("usable");
    let distance = |bits| {
        let at = corrected.distance_at(Pixels::from_bits(bits));
        at.expect("in range").0.to_bits()
    };
    let (mut most, mut least) = (0, distance(first << 16));
    for bits in first << 16..=last << 16 {
        let now = distance(bits);
        most = most.max(now - least);
        least = least.min(now);
    }
    println!("at most {most} steps back");
    assert!((1..=4).contains(&most), "{most}");
}

proptest! {
    #![proptest_config(cases(4000))]

    /// Every accepted eq. (1) with residuals is monotone, except for the stated rounding.
    #[test]
    fn every_corrected_curve_is_monotone(
        ends in (1191..1900i32, 1901..=2654i32),
        share in prop::collection::vec(-1.0..1.0f64, 1..60),
        steepness in prop_oneof![0.0..0.5f64, Just(0.499)],
        at in prop::collection::vec(0.0..1.0f64, 1..30),
    ) {
        let curve = NOMINAL.expect("a curve");
        // Each residual departs from the one before by a share of the curve's least slope over the interval.
        let length = ((ends.1 - ends.0) << 16) / share.len() as i32;
        let mut value = 0.0;
        let mut knots = vec![knot(ends.0, 0)];
        for (i, share) in (1..).zip(&share) {
            let centre = Pixels::from_bits((ends.0 << 16) + i * length);
            let (_, slope) = curve.distance_at(centre).expect("in range");
            value += share * steepness * f64::from(slope) * f64::from(length) / 65536.0;
            knots.push(Knot { centre, value: Micrometres::from_bits((value * 256.0) as i32) });
        }
        match Corrected::new(curve.clone(), &knots) {
            Ok(corrected) => {
                let slack = 4.0 * STEP + largest_rise(corrected.residuals()) / 2f64.powi(22);
                holds_what_it_promises(&Calibration::Corrected(corrected.clone()), &at, slack)?;
                for centre in places(corrected.valid(), &at) {
                    let (distance, slope) = corrected.distance_at(centre).expect("in range");
                    let (plain, of_curve) = curve.distance_at(centre).expect("in range");
                    let (residual, change) = corrected.residuals().at(centre).expect("in range");
                    prop_assert_eq!(distance.to_bits(), plain.to_bits() + residual.to_bits());
                    let most = 0.5 * of_curve.abs();
                    prop_assert_eq!(slope, of_curve + change.clamp(-most, most));
                    // Where that held anything back it was the tangent's rounding: three steps over a third
                    // of the interval.
                    let rounding = 9.0 * STEP as f32 / (length as f32 / 65536.0);
                    prop_assert!(change.abs() <= most * 1.0001 + rounding, "{change} of {of_curve}");
                }
            }
            // A cubic may be half as steep again as its secants.
            Err(CorrectedError::Steep { .. }) => {
                prop_assert!(steepness > 0.16, "{steepness}");
            }
            Err(error) => prop_assert!(false, "{error}"),
        }
    }

    #[test]
    fn any_residuals_are_usable_or_refused(
        d in any::<i32>(),
        k in (any::<i64>(), 8..40u32).prop_map(|(k, shift)| k >> shift),
        pole in any::<i32>(),
        start in any::<i32>(),
        steps in prop::collection::vec((0..1u32 << 26, -(1i64 << 24)..1 << 24), 1..8),
        shift in 0..24u32,
        at in prop::collection::vec(0.0..1.0f64, 1..20),
    ) {
        let knots = chain((start, 0), &steps, |_, rise| rise >> shift);
        let valid = knots[0].centre..=knots[knots.len() - 1].centre;
        let Ok(curve) = Eq1::new(Micrometres::from_bits(d), k, Pixels::from_bits(pole), valid) else {
            return Ok(());
        };
        if let Ok(corrected) = Corrected::new(curve, &knots) {
            let slack = 4.0 * STEP + largest_rise(corrected.residuals()) / 2f64.powi(22);
            holds_what_it_promises(&Calibration::Corrected(corrected), &at, slack)?;
        }
    }
}
