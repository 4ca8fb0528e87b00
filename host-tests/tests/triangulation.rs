//! Eq. (1) in integers against eq. (1) with its trigonometry in f64.

use host_tests::optics::Optics;
use proptest::prelude::*;
use slitrange::reading::Fault;
use slitrange::triangulation::{Eq1, Eq1Error, NOMINAL};
use slitrange::units::{Micrometres, Pixels};

#[test]
fn the_nominal_calibration_is_that_of_the_nominal_optics() {
    let nominal = NOMINAL.expect("a curve");
    let optics = Optics::nominal();
    let (mut worst, mut worst_slope) = (0.0f64, 0.0f64);
    for bits in (nominal.valid().0.to_bits()..=nominal.valid().1.to_bits()).step_by(9973) {
        let centre = Pixels::from_bits(bits);
        let (distance, slope) = nominal.distance_at(centre).expect("in range");
        worst = worst.max((distance.to_f64() - optics.distance(centre.to_f64()) * 1e6).abs());
        let per_pixel = optics.metres_per_pixel(centre.to_f64()) * 1e6;
        worst_slope = worst_slope.max((f64::from(slope) + per_pixel).abs() / per_pixel);
    }
    println!("largest difference {worst:.4} um, of the slope {worst_slope:.1e}");
    // Half a step of Q24.8 is 0.002 um, and so is half a step of xp (7.6e-6 px) times 570 um a pixel.
    assert!(worst <= 0.01, "{worst}");
    // The reference's slope is a difference over a pixel: off by (1 px / (x - xp))^2 / 4 = 1e-7; f32 has 6e-8.
    assert!(worst_slope <= 1e-6, "{worst_slope}");
    let (from, to) = nominal.valid();
    for outside in [from.to_bits() - 1, to.to_bits() + 1, i32::MIN, i32::MAX] {
        let centre = Pixels::from_bits(outside);
        assert_eq!(
            nominal.distance_at(centre),
            Err(Fault::OutOfRange { centre })
        );
    }
}

#[test]
fn what_is_no_curve_is_refused() {
    let new = |d, k, pole, from, to| {
        Eq1::new(
            Micrometres::from_int(d),
            k,
            Pixels::from_int(pole),
            Pixels::from_int(from)..=Pixels::from_int(to),
        )
        .err()
    };
    let k = 1 << 47;
    assert_eq!(
        new(0, k, -100, 0, 3000),
        Some(Eq1Error::Distance),
        "21 m at pixel 0"
    );
    assert_eq!(new(0, k, -1000, 0, 3000), None);
    assert_eq!(new(0, 0, -1000, 0, 3000), Some(Eq1Error::K));
    assert_eq!(new(0, 1 << 55, -1000, 0, 3000), Some(Eq1Error::K));
    assert_eq!(new(0, k, -1000, 3000, 2999), Some(Eq1Error::Empty));
    for pole in [0, 1500, 3000] {
        assert_eq!(
            new(0, 1 << 20, pole, 0, 3000),
            Some(Eq1Error::Pole),
            "{pole}"
        );
    }
    assert_eq!(new(0, 1 << 20, -1, 0, 3000), None, "a pixel from the pole");
}

proptest! {
    /// Whatever curve is accepted, every centre of its range has the distance that f64 gives, and a monotone one.
    #[test]
    fn every_accepted_curve_is_right_and_monotone(
        d in any::<i32>(),
        k in (any::<i64>(), 14..50u32).prop_map(|(k, shift)| k >> shift),
        pole in any::<i32>(),
        ends in any::<(i32, i32)>(),
        places in prop::collection::vec(0.0..=1.0f64, 2..20),
    ) {
        let (from, to) = (ends.0.min(ends.1), ends.0.max(ends.1));
        let range = Pixels::from_bits(from)..=Pixels::from_bits(to);
        if let Ok(curve) = Eq1::new(Micrometres::from_bits(d), k, Pixels::from_bits(pole), range) {
            let mut places = places;
            places.sort_by(f64::total_cmp);
            let mut last = None;
            for place in places {
                let bits = from as f64 + place * (to as f64 - from as f64);
                let centre = Pixels::from_bits(bits as i32);
                let (distance, slope) = curve.distance_at(centre).expect("in range");
                let exact = f64::from(d) / 256.0
                    + k as f64 / (f64::from(centre.to_bits()) - f64::from(pole));
                prop_assert!((distance.to_f64() - exact).abs() <= 0.0021, "{} for {exact}", distance.to_f64());
                prop_assert!(slope.is_finite());
                if let Some(last) = last {
                    // The distance falls as the centre grows where K is positive.
                    let monotone = if k > 0 { distance <= last } else { distance >= last };
                    prop_assert!(monotone, "from {last} to {distance} with K = {k}");
                }
                last = Some(distance);
            }
        }
    }
}
