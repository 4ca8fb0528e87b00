//! Properties of every table of distances.

use super::common::{STEP, holds_what_it_promises, largest_rise, monotone_knots, pchip, places};
use crate::records::cases;
use crate::support::*;

/// Takes every centre of some intervals, one by one. From one centre to the next, the distance never goes the
/// wrong way, and it changes by no more than the slope and a rounding.
#[test]
fn a_distance_never_turns_back_between_neighbouring_centres() {
    // Falling by about 200 um a pixel, as a sensor does: 0.8 steps from centre to centre; then by 1/16 um.
    let distances = [900_000, 899_300, 898_900, 898_888, 898_887];
    let knots = [0, 3, 5, 7, 8].into_iter().zip(distances);
    let knots: Vec<Knot> = knots.map(|(centre, um)| knot(centre, um)).collect();
    let table = Table::new(&knots).expect("a table");
    let distance = |bits| {
        let at = table.distance_at(Pixels::from_bits(bits));
        at.expect("in range").0.to_bits()
    };
    let mut before = distance(0);
    let mut largest = 0;
    for bits in 1..=8 << 16 {
        let now = distance(bits);
        assert!(now <= before, "at {bits}");
        largest = largest.max(before - now);
        before = now;
    }
    println!("at most {largest} steps from centre to centre");
    // 233 um a pixel, and half as much again where a cubic is steepest: 1.4 steps a centre; and three
    // roundings of a half at either.
    assert!((1..=4).contains(&largest), "{largest}");
}

proptest! {
    #![proptest_config(cases(4000))]

    /// Every table is monotone to the last bit, exact at its knots, agrees with f64, and gives its own slope.
    /// A centre has a distance if and only if it is in the range of the table.
    #[test]
    fn every_table_is_monotone_and_right(
        knots in monotone_knots(),
        at in prop::collection::vec(0.0..1.0f64, 1..30),
        anywhere in prop::collection::vec(any::<i32>(), 1..40),
    ) {
        let Ok(table) = Table::new(&knots) else { return Ok(()) };
        for knot in &knots {
            let (distance, _) = table.distance_at(knot.centre).expect("a knot");
            prop_assert_eq!(distance, knot.value);
        }
        let exact: Vec<(f64, f64)> =
            knots.iter().map(|k| (k.centre.to_f64(), k.value.to_f64())).collect();
        let error = 3.0 * STEP + largest_rise(table.knots()) / 2f64.powi(22);
        let reference = |x: f64| pchip(&exact, x, 0.5, 1.5);
        for centre in places(table.valid(), &at) {
            let (distance, slope) = table.distance_at(centre).expect("in range");
            let should = reference(centre.to_f64());
            let found = distance.to_f64();
            prop_assert!((found - should).abs() <= error, "{found} for {should} at {centre}");
            // The slope against a difference within the interval: both exact to the square of the step.
            let i = exact.partition_point(|k| k.0 <= centre.to_f64()).clamp(1, exact.len() - 1) - 1;
            let (h, rise) = (exact[i + 1].0 - exact[i].0, exact[i + 1].1 - exact[i].1);
            let small = 1e-4 * h;
            let x = centre.to_f64().clamp(exact[i].0 + small, exact[i + 1].0 - small);
            let should = (reference(x + small) - reference(x - small)) / (2.0 * small);
            // Of the tangent's ends each is rounded twice, and the control points once: three steps over a
            // third of the interval. A PCHIP's slope changes by at most 9 times the secant over its interval.
            let bound = 1e-3 * (rise / h).abs() * 9.0 + 9.0 * STEP / h;
            prop_assert!((f64::from(slope) - should).abs() <= bound, "{slope} for {should} at {centre}");
        }
        let (first, last) = table.valid();
        for centre in anywhere.into_iter().map(Pixels::from_bits) {
            let is_inside = first <= centre && centre <= last;
            prop_assert_eq!(table.distance_at(centre).is_ok(), is_inside);
        }
        holds_what_it_promises(&Calibration::Table(table), &at, 0.0)?;
    }
}
