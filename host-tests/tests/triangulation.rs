//! Eq. (1) in integers against eq. (1) with its trigonometry in f64.

use crate::records::cases;
use crate::support::*;
use slitrange::distance::eq1::Eq1Error;

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
    // The reference's slope is a difference over a pixel: off by (1 px / (x - xp))^2 / 4 = 1e-7; ours by
    // eight roundings of 6e-8.
    assert!(worst_slope <= 6e-7, "{worst_slope}");
    let (from, to) = nominal.valid();
    for outside in [from.to_bits() - 1, to.to_bits() + 1, i32::MIN, i32::MAX] {
        let centre = Pixels::from_bits(outside);
        let fault = Fault::OutOfRange { centre };
        assert_eq!(nominal.distance_at(centre), Err(fault));
    }
}

#[test]
fn the_nominal_constants_are_rounded_to_the_nearest() {
    let nominal = NOMINAL.expect("a curve");
    let (b, f, t) = (300_000.0, 50_000.0 / 8.0, 2.6);
    let k: f64 = b * f * (1.0 + t * t) / (t * t);
    assert_eq!(nominal.d().to_bits(), (-b / t * 256.0f64).round() as i32);
    assert_eq!(nominal.k(), (k * 65536.0).round() as i64);
    let pole: f64 = 1823.5 - f / t;
    assert_eq!(nominal.pole().to_bits(), (pole * 65536.0).round() as i32);
}

/// A curve of D in micrometres, K in steps, and the pole and the ends of the range in pixels.
fn curve(d: i32, k: i64, pole: i32, from: i32, to: i32) -> Result<Eq1, Eq1Error> {
    let [pole, from, to] = [pole, from, to].map(Pixels::from_int);
    Eq1::new(Micrometres::from_int(d), k, pole, from..=to)
}

/// At p = 512 px from the pole, K = p (2^31 - 1/2) steps of 2^-8 um rounds to 2^31 steps, one more than fits.
#[test]
fn a_curve_is_refused_from_the_first_distance_on_that_does_not_fit() {
    let k = 512 * ((1 << 39) - (1 << 7));
    let new = |k| curve(0, k, 0, 512, 513);
    assert_eq!(new(k).err(), Some(Eq1Error::Distance));
    let curve = new(k - 1).expect("a curve");
    let (distance, _) = curve.distance_at(Pixels::from_int(512)).expect("in range");
    assert_eq!(distance, Micrometres::MAX);
}

#[test]
fn invalid_curves_are_refused() {
    use Eq1Error::{Distance, Empty, Flat, K, Pole};
    let (k, metre) = (1 << 47, 1 << 36);
    for (k, pole, from, to, expected) in [
        // 21 m at pixel 0.
        (k, -100, 0, 3000, Some(Distance)),
        (k, -1000, 0, 3000, None),
        (0, -1000, 0, 3000, Some(K)),
        (1 << 55, -1000, 0, 3000, Some(K)),
        (i64::MIN, -1000, 0, 3000, Some(K)),
        (k, -1000, 3000, 2999, Some(Empty)),
        (k, -1000, 3000, 3000, Some(Empty)),
        (metre, 0, 0, 3000, Some(Pole)),
        (metre, 1500, 0, 3000, Some(Pole)),
        (metre, 3000, 0, 3000, Some(Pole)),
        // 2^20 um px: 1 m at a pixel from the pole, and 2^20/4000^2 = 0.066 um a pixel at the far end.
        (metre, -1, 0, 3999, None),
        (metre, 4000, 0, 3999, None),
        // A sixteenth of a micrometre a pixel is reached 4096 pixels from the pole.
        (metre, -1, 0, 4095, None),
        (metre, -1, 0, 4096, Some(Flat)),
        (-metre, -1, 0, 4095, None),
        // K of a step.
        (1, -1, 0, 3000, Some(Flat)),
    ] {
        let found = curve(0, k, pole, from, to).err();
        assert_eq!(found, expected, "K {k}, pole {pole}, {from} to {to}");
    }
}

/// The limit is exact to the last bit. At one pixel from the pole, the curve agrees with f64 up to the
/// largest distance of the number format.
#[test]
fn curves_are_refused_less_than_a_pixel_from_the_pole() {
    let pixel = 1 << Pixels::FRACTION;
    // 8.388 m and half a step more, a pixel from the pole: the last K whose distance there can be held.
    let most = (i64::from(i32::MAX) << 8) + (1 << 7) - 1;
    let new = |k, pole, first, last| {
        let [pole, first, last] = [pole, first, last].map(Pixels::from_bits);
        Eq1::new(Micrometres::from_int(0), k, pole, first..=last)
    };
    for sign in [1, -1] {
        let of = |near: i32, far: i32| if sign > 0 { (near, far) } else { (-far, -near) };
        let (from, to) = of(pixel, 3000 * pixel);
        let curve = new(most, 0, from, to).expect("a pixel from the pole");
        let end = curve.distance_at(Pixels::from_int(sign));
        let (distance, slope) = end.expect("the end of its range");
        assert_eq!(distance.to_bits(), sign * i32::MAX);
        assert!((f64::from(slope) + 2f64.powi(23)).abs() <= 1.0, "{slope}");
        let (first, last) = of(pixel - 1, 3000 * pixel);
        assert_eq!(new(most, 0, first, last), Err(Eq1Error::Pole));
        assert_eq!(new(most + 2, 0, from, to).is_err(), sign > 0);
        assert_eq!(new(1 << 54, 0, from, to), Err(Eq1Error::Distance));
    }
    // At the ends of what a centre can be.
    let curve = new(1 << 54, i32::MIN, i32::MAX - 1, i32::MAX).expect("2^16 pixels from the pole");
    let (distance, _) = curve.distance_at(Pixels::MAX).expect("in range");
    assert!((distance.to_f64() - 2f64.powi(38 - 16)).abs() <= 0.5 / 256.0 + 1e-4);
}

/// D alone may have any value; the sum must be in range.
#[test]
fn extreme_parameters_give_distances_in_range_or_are_refused() {
    let (first, last) = (Pixels::from_int(1000), Pixels::from_int(2000));
    let curve = |d, k| Eq1::new(d, k, Pixels::from_int(0), first..=last);
    let metre = |k: i64| (k * 1_000_000 * 1000) << 16;
    // From 1 m to 0.5 m above or below D.
    assert_eq!(curve(Micrometres::MAX, metre(1)), Err(Eq1Error::Distance));
    assert_eq!(curve(Micrometres::MIN, metre(-1)), Err(Eq1Error::Distance));
    let near_far_end = curve(Micrometres::MAX, metre(-1)).expect("below D");
    let (distance, _) = near_far_end.distance_at(first).expect("in range");
    let metre_bits = Micrometres::from_int(1_000_000).to_bits();
    assert_eq!(distance.to_bits(), i32::MAX - metre_bits);
    // Distances below zero are what a sensor may define them to be.
    let below = curve(Micrometres::MIN, metre(1)).expect("above D");
    let (distance, slope) = below.distance_at(last).expect("in range");
    assert_eq!(distance.to_bits(), i32::MIN + metre_bits / 2);
    assert!((slope + 250.0).abs() < 1e-3, "{slope}");
}

#[test]
fn errors_say_what_is_wrong_and_what_to_do() {
    use Eq1Error::{Distance, Empty, Flat, K, Pole};
    let text = [K, Empty, Pole, Distance, Flat].map(|error| error.to_string());
    insta::assert_snapshot!(text.join("\n"));
}

/// D + K/(x - xp) in steps of Q24.8, to the nearest, half-way away from D; `from_pole` is x - xp in Q16.16.
fn exact(d: i32, k: i64, from_pole: i64) -> i128 {
    let (k, from_pole) = (i128::from(k) * 256, i128::from(from_pole));
    let size = (2 * k.abs() + from_pole.abs()) / (2 * from_pole.abs());
    i128::from(d) + k.signum() * from_pole.signum() * size
}

proptest! {
    #![proptest_config(cases(4000))]

    /// For every accepted curve, the distance of every centre in its range is that of an exact division of
    /// integers, and the distances are monotone.
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
                let exact = exact(d, k, i64::from(centre.to_bits()) - i64::from(pole));
                prop_assert_eq!(i128::from(distance.to_bits()), exact);
                let per_pixel = -(k as f64) * 65536.0
                    / (f64::from(centre.to_bits()) - f64::from(pole)).powi(2);
                prop_assert!((f64::from(slope) / per_pixel - 1.0).abs() <= 5e-7, "{slope} for {per_pixel}");
                prop_assert!(per_pixel.abs() >= 1.0 / 16.0 - 1e-9);
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
