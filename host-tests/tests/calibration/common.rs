//! Knots of every kind, what every calibration promises, and interpolation in f64.

use crate::records::chain;
use crate::support::*;
use std::collections::BTreeSet;

/// A step of Q24.8, in micrometres.
pub const STEP: f64 = 1.0 / 256.0;

/// Spacing in steps of Q16.16 and rise in steps of Q24.8 from knot to knot: of every size.
pub fn steps() -> impl Strategy<Value = Vec<(u32, i64)>> {
    let size =
        |bits: std::ops::Range<u32>| (bits, any::<u32>()).prop_map(|(bits, x)| x >> (32 - bits));
    let any_size = prop::collection::vec((size(1..32), size(1..30).prop_map(i64::from)), 1..40);
    let like_a_sensor = prop::collection::vec((1u32 << 16..1 << 22, 1i64 << 14..1 << 20), 1..140);
    prop_oneof![any_size, like_a_sensor]
}

/// Knots that are a table, most of them.
pub fn monotone_knots() -> impl Strategy<Value = Vec<Knot>> {
    (any::<(i32, i32)>(), any::<bool>(), any::<bool>(), steps()).prop_map(
        |((x, y), falls, low, steps)| {
            // From the lower end of the range, so that there is room for many knots, or from anywhere.
            let x = if low { i32::MIN + (x & 0xffff) } else { x };
            chain((x, y), &steps, |length, step| {
                let step = step.max(i64::from(length.div_ceil(1 << 12)));
                if falls { -step } else { step }
            })
        },
    )
}

/// Places over a range: both ends, anywhere, and neighbours of each.
pub fn places(range: (Pixels, Pixels), at: &[f64]) -> Vec<Pixels> {
    let (from, to) = (i64::from(range.0.to_bits()), i64::from(range.1.to_bits()));
    let places: BTreeSet<i64> = at
        .iter()
        .map(|part| from + (part * (to - from) as f64) as i64)
        .chain([from, to])
        .flat_map(|bits| bits - 2..=bits + 2)
        .filter(|bits| (from..=to).contains(bits))
        .collect();
    let places = places.into_iter();
    places.map(|bits| Pixels::from_bits(bits as i32)).collect()
}

/// The largest rise from knot to knot, in micrometres.
pub fn largest_rise(knots: &Knots) -> f64 {
    let values: Vec<f64> = knots.iter().map(|knot| knot.value.to_f64()).collect();
    let rises = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    rises.fold(0.0, f64::max)
}

/// What holds for every calibration: distances of its range in order but for `slack` micrometres, slopes that
/// go their way, and no distance outside.
pub fn holds_what_it_promises(
    calibration: &Calibration,
    at: &[f64],
    slack: f64,
) -> Result<(), TestCaseError> {
    let valid = calibration.valid();
    let distances = calibration.distances().expect("its own range");
    let (first, _) = calibration.distance_at(valid.0).expect("in range");
    let (last, _) = calibration.distance_at(valid.1).expect("in range");
    prop_assert_eq!(first.min(last), *distances.start());
    prop_assert_eq!(first.max(last), *distances.end());
    let sign = if last < first { -1.0 } else { 1.0 };
    let mut before = first;
    for centre in places(valid, at) {
        let (distance, slope) = calibration.distance_at(centre).expect("in range");
        let onward = sign * (distance.to_f64() - before.to_f64());
        prop_assert!(onward >= -slack, "back by {} um at {centre}", -onward);
        let outside = (distances.start().to_f64() - distance.to_f64())
            .max(distance.to_f64() - distances.end().to_f64());
        prop_assert!(outside <= slack, "{distance} at {centre}");
        let slope = sign * f64::from(slope);
        prop_assert!(slope.is_finite() && slope >= 0.0, "{slope} at {centre}");
        before = distance;
    }
    let (first, last) = (valid.0.to_bits(), valid.1.to_bits());
    for bits in [
        first.saturating_sub(1),
        last.saturating_add(1),
        i32::MIN,
        i32::MAX,
    ] {
        if bits < first || bits > last {
            let centre = Pixels::from_bits(bits);
            let fault = Fault::OutOfRange { centre };
            prop_assert_eq!(calibration.distance_at(centre), Err(fault));
        }
    }
    Ok(())
}

/// The cubic's value in f64: PCHIP after F. Fritsch and J. Butland with scipy's ends, but a slope is at most
/// 1.5 times the lesser secant (`most`) and at an end at least half (`least`).
pub fn pchip(knots: &[(f64, f64)], x: f64, least: f64, most: f64) -> f64 {
    let lengths: Vec<f64> = knots.windows(2).map(|k| k[1].0 - k[0].0).collect();
    let secant = |k: &[(f64, f64)]| (k[1].1 - k[0].1) / (k[1].0 - k[0].0);
    let secants: Vec<f64> = knots.windows(2).map(secant).collect();
    let end = |i: usize, next: Option<usize>| {
        let Some(next) = next else { return secants[i] };
        let (h, g) = (lengths[i], lengths[next]);
        let slope = ((2.0 * h + g) * secants[i] - h * secants[next]) / (h + g);
        (slope / secants[i]).clamp(least, most) * secants[i]
    };
    let slope = |i: usize| {
        if i == 0 {
            return end(0, (secants.len() > 1).then_some(1));
        }
        if i == secants.len() {
            return end(i - 1, i.checked_sub(2));
        }
        let (h, g) = (lengths[i - 1], lengths[i]);
        let (s, t) = (secants[i - 1], secants[i]);
        if s * t <= 0.0 {
            return 0.0;
        }
        let mean = 3.0 * (h + g) / ((2.0 * g + h) / s + (g + 2.0 * h) / t);
        let lesser = if s.abs() < t.abs() { s } else { t };
        (mean / lesser).min(most) * lesser
    };
    let after = knots.partition_point(|k| k.0 <= x);
    let i = after.clamp(1, knots.len() - 1) - 1;
    let (h, t) = (lengths[i], (x - knots[i].0) / lengths[i]);
    let rise = knots[i + 1].1 - knots[i].1;
    let (m, n) = (slope(i) * h, slope(i + 1) * h);
    knots[i].1 + t * (m + t * (3.0 * rise - 2.0 * m - n + t * (m + n - 2.0 * rise)))
}
