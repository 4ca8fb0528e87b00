//! How exact calibrations are over the paper's geometry.

use super::common::{STEP, pchip};
use crate::support::*;

/// The paper's shortest and longest distance in metres.
const RANGE: (f64, f64) = (0.60, 1.02);

/// The paper's geometry with its slit.
fn optics() -> Optics {
    Optics::nominal_on(Sensor::Camera)
}

/// Knots at even distances over a range of centres, with a value in micrometres.
fn even_knots(count: usize, range: (f64, f64), value: impl Fn(f64) -> f64) -> Vec<Knot> {
    let at = |i| {
        let centre = range.0 + (range.1 - range.0) * i as f64 / (count - 1) as f64;
        let centre = Pixels::from_bits((centre * 65536.0).round() as i32);
        let value = Micrometres::from_bits((value(centre.to_f64()) * 256.0).round() as i32);
        Knot { centre, value }
    };
    (0..count).map(at).collect()
}

/// The paper's range as centres: the first is that of the longest distance.
fn paper_range(optics: &Optics) -> (f64, f64) {
    (optics.centre(RANGE.1), optics.centre(RANGE.0))
}

/// The largest difference in micrometres over a calibration's range, at 100,000 places.
fn worst(calibration: &Calibration, truth: impl Fn(f64) -> f64) -> f64 {
    let (first, last) = calibration.valid();
    let step = (last.to_bits() - first.to_bits()) as usize / 100_000;
    let bits = (first.to_bits()..=last.to_bits()).step_by(step);
    let off = bits.map(|bits| {
        let centre = Pixels::from_bits(bits);
        let (distance, _) = calibration.distance_at(centre).expect("in range");
        (distance.to_f64() - truth(centre.to_f64())).abs()
    });
    off.fold(0.0, f64::max)
}

/// A table's arithmetic adds three steps of Q24.8 and 2^-22 of the difference of two knots
/// ([`slitrange::distance::knots::Knots`]) to PCHIP in f64. From the truth, PCHIP itself is off by a few
/// micrometres with 33 knots: a hundredth of a pixel is 1.7 to 4.4 um.
#[test]
fn tables_add_only_rounding_to_the_error_of_pchip() {
    let optics = optics();
    let truth = |centre: f64| optics.distance(centre) * 1e6;
    let range = paper_range(&optics);
    println!("centres {range:.1?}");
    let any = f64::INFINITY;
    // The largest errors in micrometres that were seen, rounded up.
    for (count, most) in [(3, any), (5, any), (9, any), (33, 2.0), (129, 0.04)] {
        let knots = even_knots(count, range, truth);
        let exact = knots.iter().map(|k| (k.centre.to_f64(), k.value.to_f64()));
        let exact: Vec<(f64, f64)> = exact.collect();
        let in_f64 = |centre: f64| pchip(&exact, centre, 0.0, 3.0);
        let rises = exact.windows(2).map(|pair| (pair[1].1 - pair[0].1).abs());
        let rise = rises.fold(0.0, f64::max);
        let table = Calibration::Table(Table::new(&knots).expect("a table"));
        let (from_truth, from_f64) = (worst(&table, truth), worst(&table, in_f64));
        println!("{count} knots: at most {from_truth:.4} um, the arithmetic {from_f64:.4}");
        assert!(from_truth <= most, "{from_truth} um with {count} knots");
        let arithmetic = 3.0 * STEP + rise / 2f64.powi(22);
        assert!(from_f64 <= arithmetic, "{from_f64} um of arithmetic");
    }
}

#[test]
fn residuals_correct_a_lens_distortion() {
    let optics = optics();
    let range = paper_range(&optics);
    let middle = 0.5 * (range.0 + range.1);
    let half = 0.5 * (range.1 - range.0);
    // A third-order distortion of up to 300 um, less what eq. (1) takes of it: a cubic with turns at a half
    // of the range.
    let residual = |centre: f64| {
        let z = (centre - middle) / half;
        300.0 * (4.0 * z * z * z - 3.0 * z)
    };
    let d = -optics.baseline / optics.angle.tan() * 1e6;
    let pole = optics.axis - optics.focal_length / optics.angle.tan() / optics.pitch;
    let k = (optics.distance(middle) * 1e6 - d) * (middle - pole);
    let curve = Eq1::new(
        Micrometres::from_bits((d * 256.0).round() as i32),
        (k * 65536.0).round() as i64,
        Pixels::from_bits((pole * 65536.0).round() as i32),
        Pixels::from_int(range.0 as i32)..=Pixels::from_int(range.1 as i32 + 1),
    )
    .expect("a curve");
    let truth = |centre: f64| optics.distance(centre) * 1e6 + residual(centre);
    println!("without them off by 300 um");
    // A PCHIP is at its worst next to a turn, whose slope of zero it puts at a knot.
    let knots = even_knots(33, range, residual);
    let corrected = Corrected::new(curve, &knots).expect("usable");
    let worst = worst(&Calibration::Corrected(corrected), truth);
    println!("33 knots: at most {worst:.4} um");
    assert!(worst <= 1.0, "{worst} um");
}
