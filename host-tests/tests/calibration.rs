//! Tables of distances and of residuals in integers: against f64, and what holds for all of them.

use host_tests::optics::Optics;
use host_tests::paper::apparatus::{Aperture, TABLE, optics};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use slitrange::calibration::Calibration;
use slitrange::calibration::knots::{
    CLOSEST, Interpolation, Knot, Knots, KnotsError, MAX_CUBIC, MAX_LINEAR,
};
use slitrange::calibration::residuals::{Corrected, CorrectedError};
use slitrange::calibration::table::{Table, TableError};
use slitrange::reading::Fault;
use slitrange::triangulation::{Eq1, NOMINAL};
use slitrange::units::{Micrometres, Pixels};

/// A step of Q24.8, in micrometres.
const STEP: f64 = 1.0 / 256.0;

fn knot(centre: i32, value: i32) -> Knot {
    Knot {
        centre: Pixels::from_int(centre),
        value: Micrometres::from_int(value),
    }
}

/// Knots at even distances over a range of centres, with a value in micrometres.
fn even_knots(count: usize, range: (f64, f64), value: impl Fn(f64) -> f64) -> Vec<Knot> {
    (0..count)
        .map(|i| {
            let centre = range.0 + (range.1 - range.0) * i as f64 / (count - 1) as f64;
            let centre = Pixels::from_bits((centre * 65536.0).round() as i32);
            Knot {
                centre,
                value: Micrometres::from_bits((value(centre.to_f64()) * 256.0).round() as i32),
            }
        })
        .collect()
}

/// The paper's range as centres: the first is that of the longest distance.
fn paper_range(optics: &Optics) -> (f64, f64) {
    (optics.centre(TABLE.1), optics.centre(TABLE.0))
}

/// The largest difference in micrometres over a calibration's range, at 100,000 places.
fn worst(calibration: &Calibration, truth: impl Fn(f64) -> f64) -> f64 {
    let (first, last) = calibration.valid();
    let step = (last.to_bits() - first.to_bits()) as usize / 100_000;
    (first.to_bits()..=last.to_bits())
        .step_by(step)
        .map(|bits| {
            let centre = Pixels::from_bits(bits);
            let (distance, _) = calibration.distance_at(centre).expect("in range");
            (distance.to_f64() - truth(centre.to_f64())).abs()
        })
        .fold(0.0, f64::max)
}

#[test]
fn tables_of_the_papers_geometry_are_as_good_as_they_can_be() {
    let optics = optics(Aperture::Slit);
    let truth = |centre: f64| optics.distance(centre) * 1e6;
    let range = paper_range(&optics);
    println!("centres {range:.1?}");
    // In f64 the same tables are off by 2.0, 0.032, 93 and 1.5 um: those bounds leave room for no more than the integers' 0.02 um
    // and the last digit.
    for (interpolation, count, bound) in [
        (Interpolation::Cubic, 33, 2.1),
        (Interpolation::Cubic, 129, 0.05),
        (Interpolation::Linear, 33, 94.0),
        (Interpolation::Linear, 257, 1.6),
    ] {
        let knots = even_knots(count, range, truth);
        let table = Table::new(interpolation, &knots).expect("a table");
        let worst = worst(&Calibration::Table(table), truth);
        println!("{count} knots, {interpolation:?}: at most {worst:.4} um");
        assert!(worst <= bound, "{worst} um with {count} knots");
    }
}

#[test]
fn residuals_take_a_lens_out() {
    let optics = optics(Aperture::Slit);
    let range = paper_range(&optics);
    let middle = 0.5 * (range.0 + range.1);
    let half = 0.5 * (range.1 - range.0);
    // A third-order distortion of up to 300 um, less what eq. (1) takes of it: a cubic with turns at a half of the range.
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
    // A straight line over an interval of 2/32 of the half range: 300 * 24 z * (2/32)^2 / 8 = 3.5 um at z = 1; a PCHIP is at its
    // worst next to a turn, whose slope of zero it puts at a knot.
    for (interpolation, count, bound) in [
        (Interpolation::Cubic, 33, 1.0),
        (Interpolation::Linear, 33, 3.6),
        (Interpolation::Linear, 257, 0.08),
    ] {
        let knots = even_knots(count, range, residual);
        let corrected = Corrected::new(curve.clone(), interpolation, &knots).expect("usable");
        let worst = worst(&Calibration::Corrected(corrected), truth);
        println!("{count} knots, {interpolation:?}: at most {worst:.4} um");
        assert!(worst <= bound, "{worst} um with {count} knots");
    }
}

#[test]
fn what_is_no_table_is_refused_with_the_knot_that_is_wrong() {
    use Interpolation::{Cubic, Linear};
    let wrong = |interpolation, knots: &[Knot]| Table::new(interpolation, knots).err();
    let good = [knot(0, 900_000), knot(10, 890_000), knot(2000, 500_000)];
    for interpolation in [Linear, Cubic] {
        assert_eq!(wrong(interpolation, &good), None);
        for count in [0, 1] {
            assert_eq!(
                wrong(interpolation, &good[..count]),
                Some(TableError::Knots(KnotsError::TooFew { knots: count }))
            );
        }
        let unsorted = [good[1], good[0], good[2]];
        let order = |index, centre| Some(TableError::Knots(KnotsError::Order { index, centre }));
        assert_eq!(
            wrong(interpolation, &unsorted),
            order(1, Pixels::from_int(0))
        );
        let equal = [good[0], good[1], good[1]];
        assert_eq!(wrong(interpolation, &equal), order(2, Pixels::from_int(10)));
        let close = |bits| {
            let centre = Pixels::from_bits(CLOSEST.to_bits() + bits);
            let values = [knot(0, 900_000), Knot { centre, ..good[1] }];
            wrong(interpolation, &values)
        };
        assert_eq!(
            close(-1),
            order(1, Pixels::from_bits(CLOSEST.to_bits() - 1))
        );
        assert_eq!(close(0), None);

        let not_monotone = |index, distance| Some(TableError::NotMonotone { index, distance });
        let back = [good[0], good[1], knot(20, 890_100), good[2]];
        assert_eq!(
            wrong(interpolation, &back),
            not_monotone(2, Micrometres::from_int(890_100))
        );
        let level = [good[0], good[1], knot(20, 890_000), good[2]];
        assert_eq!(
            wrong(interpolation, &level),
            not_monotone(2, Micrometres::from_int(890_000))
        );
        let all_level = [knot(0, 5), knot(1, 5)];
        assert_eq!(
            wrong(interpolation, &all_level),
            not_monotone(1, Micrometres::from_int(5))
        );
        // A sixteenth of a micrometre a pixel is just enough.
        assert_eq!(wrong(interpolation, &[knot(0, 0), knot(160, 10)]), None);
        assert_eq!(wrong(interpolation, &[knot(0, 0), knot(160, -10)]), None);
        assert_eq!(
            wrong(interpolation, &[knot(0, 0), knot(161, 10)]),
            not_monotone(1, Micrometres::from_int(10))
        );

        let far = [knot(0, -5_000_000), knot(1, 5_000_000)];
        assert_eq!(
            wrong(interpolation, &far),
            Some(TableError::Knots(KnotsError::Step {
                index: 1,
                value: Micrometres::from_int(5_000_000)
            }))
        );
        let widest = [
            Knot {
                centre: Pixels::MIN,
                value: Micrometres::from_int(0),
            },
            Knot {
                centre: Pixels::MAX,
                value: Micrometres::MAX,
            },
        ];
        assert_eq!(wrong(interpolation, &widest), None);
    }
    for (interpolation, most) in [(Linear, MAX_LINEAR), (Cubic, MAX_CUBIC)] {
        let knots: Vec<Knot> = (0..=most as i32).map(|i| knot(i, -i)).collect();
        assert_eq!(wrong(interpolation, &knots[..most]), None);
        assert_eq!(
            wrong(interpolation, &knots),
            Some(TableError::Knots(KnotsError::TooMany {
                knots: most + 1,
                most
            }))
        );
    }
}

#[test]
fn residuals_that_do_not_go_with_the_curve_are_refused() {
    let nominal = NOMINAL.expect("a curve");
    let wrong =
        |knots: &[Knot]| Corrected::new(nominal.clone(), Interpolation::Linear, knots).err();
    assert_eq!(wrong(&[knot(1191, 50), knot(2654, -50)]), None);
    assert_eq!(
        wrong(&[knot(1191, 50)]),
        Some(CorrectedError::Knots(KnotsError::TooFew { knots: 1 }))
    );
    assert_eq!(
        wrong(&[knot(1190, 50), knot(2654, -50)]),
        Some(CorrectedError::Beyond {
            index: 0,
            centre: Pixels::from_int(1190)
        })
    );
    assert_eq!(
        wrong(&[knot(1191, 50), knot(2654, -50), knot(2655, 0)]),
        Some(CorrectedError::Beyond {
            index: 2,
            centre: Pixels::from_int(2655)
        })
    );
    // At pixel 2600 the curve falls by about 245 um a pixel.
    let (_, slope) = nominal
        .distance_at(Pixels::from_int(2601))
        .expect("in range");
    let half = (-0.5 * slope) as i32;
    println!("slope {slope} um a pixel");
    for sign in [1, -1] {
        let knots = |rise: i32| [knot(1300, 0), knot(2600, 0), knot(2601, sign * rise)];
        assert_eq!(wrong(&knots(half)), None);
        assert_eq!(
            wrong(&knots(half + 1)),
            Some(CorrectedError::Steep {
                index: 2,
                centre: Pixels::from_int(2601)
            })
        );
    }
    assert_eq!(
        wrong(&[knot(1191, 8_000_000), knot(2654, 8_000_000)]),
        Some(CorrectedError::Distance {
            centre: Pixels::from_int(1191)
        })
    );
}

#[test]
fn errors_say_what_is_wrong_and_what_to_do() {
    let mut text = String::new();
    for error in [
        TableError::Knots(KnotsError::TooFew { knots: 1 }),
        TableError::Knots(KnotsError::TooMany {
            knots: 300,
            most: 257,
        }),
        TableError::Knots(KnotsError::Order {
            index: 7,
            centre: Pixels::from_f32(12.5),
        }),
        TableError::Knots(KnotsError::Step {
            index: 7,
            value: Micrometres::MIN,
        }),
        TableError::NotMonotone {
            index: 7,
            distance: Micrometres::from_int(900_000),
        },
    ] {
        text += &format!("{error}\n");
    }
    for error in [
        CorrectedError::Beyond {
            index: 7,
            centre: Pixels::from_f32(12.5),
        },
        CorrectedError::Steep {
            index: 7,
            centre: Pixels::from_f32(12.5),
        },
        CorrectedError::Distance {
            centre: Pixels::from_f32(12.5),
        },
    ] {
        text += &format!("{error}\n");
    }
    insta::assert_snapshot!(text);
}

/// The cubic's value in f64: PCHIP after F. Fritsch and J. Butland with scipy's ends, but a slope is at most 1.5 times the lesser
/// secant (`most`) and at an end at least half (`least`).
fn pchip(knots: &[(f64, f64)], x: f64, least: f64, most: f64) -> f64 {
    let lengths: Vec<f64> = knots.windows(2).map(|k| k[1].0 - k[0].0).collect();
    let secants: Vec<f64> = knots
        .windows(2)
        .map(|k| (k[1].1 - k[0].1) / (k[1].0 - k[0].0))
        .collect();
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
    let i = knots
        .partition_point(|k| k.0 <= x)
        .clamp(1, knots.len() - 1)
        - 1;
    let (h, t) = (lengths[i], (x - knots[i].0) / lengths[i]);
    let rise = knots[i + 1].1 - knots[i].1;
    let (m, n) = (slope(i) * h, slope(i + 1) * h);
    knots[i].1 + t * (m + t * (3.0 * rise - 2.0 * m - n + t * (m + n - 2.0 * rise)))
}

fn straight(knots: &[(f64, f64)], x: f64) -> f64 {
    let i = knots
        .partition_point(|k| k.0 <= x)
        .clamp(1, knots.len() - 1)
        - 1;
    let (from, to) = (knots[i], knots[i + 1]);
    from.1 + (to.1 - from.1) * (x - from.0) / (to.0 - from.0)
}

#[test]
fn over_the_papers_geometry_a_cubic_is_the_usual_pchip() {
    let optics = optics(Aperture::Slit);
    let truth = |centre: f64| optics.distance(centre) * 1e6;
    for count in [3, 5, 9, 33, 129] {
        let knots = even_knots(count, paper_range(&optics), truth);
        let table = Table::new(Interpolation::Cubic, &knots).expect("a table");
        let exact: Vec<(f64, f64)> = knots
            .iter()
            .map(|k| (k.centre.to_f64(), k.value.to_f64()))
            .collect();
        let difference = worst(&Calibration::Table(table), |centre| {
            pchip(&exact, centre, 0.0, 3.0)
        });
        println!("{count} knots: at most {difference:.4} um from PCHIP in f64");
        let rise = (TABLE.1 - TABLE.0) * 1e6 / (count - 1) as f64 * 2.0;
        assert!(
            difference <= 3.0 * STEP + rise / 2f64.powi(22),
            "{difference}"
        );
    }
}

/// Spacing in steps of Q16.16 and rise in steps of Q24.8 from knot to knot: of every size.
fn steps() -> impl Strategy<Value = Vec<(u32, i64)>> {
    let size =
        |bits: std::ops::Range<u32>| (bits, any::<u32>()).prop_map(|(bits, x)| x >> (32 - bits));
    let any_size = prop::collection::vec((size(1..32), size(1..31).prop_map(i64::from)), 1..40);
    let like_a_sensor = prop::collection::vec((1u32 << 16..1 << 22, 1i64 << 14..1 << 20), 1..140);
    prop_oneof![any_size, like_a_sensor]
}

/// Knots that begin anywhere, with `rise` made of a step's length and rise; they end where a number does.
fn chain(start: (i32, i32), steps: &[(u32, i64)], rise: impl Fn(u32, i64) -> i64) -> Vec<Knot> {
    let (mut centre, mut value) = (i64::from(start.0), i64::from(start.1));
    let mut knots = Vec::new();
    let mut steps = steps.iter();
    while let (Ok(x), Ok(y)) = (i32::try_from(centre), i32::try_from(value)) {
        knots.push(Knot {
            centre: Pixels::from_bits(x),
            value: Micrometres::from_bits(y),
        });
        let Some(&(length, step)) = steps.next() else {
            break;
        };
        let length = length.saturating_add(CLOSEST.to_bits() as u32);
        centre += i64::from(length);
        value += rise(length, step);
    }
    knots
}

fn interpolations() -> impl Strategy<Value = Interpolation> {
    prop_oneof![Just(Interpolation::Linear), Just(Interpolation::Cubic)]
}

/// Knots that are a table, most of them.
fn monotone_knots() -> impl Strategy<Value = Vec<Knot>> {
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
fn places(range: (Pixels, Pixels), at: &[f64]) -> Vec<Pixels> {
    let (from, to) = (i64::from(range.0.to_bits()), i64::from(range.1.to_bits()));
    let mut places: Vec<i64> = at
        .iter()
        .map(|part| from + (part * (to - from) as f64) as i64)
        .chain([from, to])
        .flat_map(|bits| bits - 2..=bits + 2)
        .filter(|bits| (from..=to).contains(bits))
        .collect();
    places.sort_unstable();
    places.dedup();
    places
        .into_iter()
        .map(|bits| Pixels::from_bits(bits as i32))
        .collect()
}

/// The largest rise from knot to knot, in micrometres.
fn largest_rise(knots: &Knots) -> f64 {
    let values: Vec<f64> = knots.iter().map(|knot| knot.value.to_f64()).collect();
    values
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .fold(0.0, f64::max)
}

/// What holds for every calibration: distances of its range in order but for `slack` micrometres, slopes that go their way, and
/// no distance outside.
fn holds_what_it_promises(
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
        prop_assert!(
            slope.is_finite() && sign * f64::from(slope) >= 0.0,
            "{slope} at {centre}"
        );
        before = distance;
    }
    for outside in [
        valid.0.to_bits().checked_sub(1),
        valid.1.to_bits().checked_add(1),
        Some(i32::MIN),
        Some(i32::MAX),
    ] {
        let Some(centre) = outside.map(Pixels::from_bits) else {
            continue;
        };
        if centre < valid.0 || centre > valid.1 {
            prop_assert_eq!(
                calibration.distance_at(centre),
                Err(Fault::OutOfRange { centre })
            );
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, rng_seed: RngSeed::Fixed(6), ..ProptestConfig::default() })]

    /// Every table rises or falls to the last bit, is exact at its knots, has a slope that is its own, and is what f64 says.
    #[test]
    fn every_table_is_monotone_and_right(
        knots in monotone_knots(),
        interpolation in interpolations(),
        at in prop::collection::vec(0.0..1.0f64, 1..30),
    ) {
        let Ok(table) = Table::new(interpolation, &knots) else { return Ok(()) };
        for knot in &knots {
            let (distance, _) = table.distance_at(knot.centre).expect("a knot");
            prop_assert_eq!(distance, knot.value);
        }
        let exact: Vec<(f64, f64)> =
            knots.iter().map(|k| (k.centre.to_f64(), k.value.to_f64())).collect();
        let error = 3.0 * STEP + largest_rise(table.knots()) / 2f64.powi(22);
        let reference = |x: f64| match interpolation {
            Interpolation::Linear => straight(&exact, x),
            Interpolation::Cubic => pchip(&exact, x, 0.5, 1.5),
        };
        for centre in places(table.valid(), &at) {
            let (distance, slope) = table.distance_at(centre).expect("in range");
            let should = reference(centre.to_f64());
            prop_assert!((distance.to_f64() - should).abs() <= error, "{} for {should} at {centre}", distance.to_f64());
            // The slope against a difference within the interval: both exact to the square of the step.
            let i = exact.partition_point(|k| k.0 <= centre.to_f64()).clamp(1, exact.len() - 1) - 1;
            let (h, rise) = (exact[i + 1].0 - exact[i].0, exact[i + 1].1 - exact[i].1);
            let small = 1e-4 * h;
            let x = centre.to_f64().clamp(exact[i].0 + small, exact[i + 1].0 - small);
            let should = (reference(x + small) - reference(x - small)) / (2.0 * small);
            // Control points are rounded to steps; a PCHIP's slope changes by at most 9 times the secant over its interval.
            let bound = 1e-3 * (rise / h).abs() * 9.0 + 6.0 * STEP / h;
            prop_assert!((f64::from(slope) - should).abs() <= bound, "{slope} for {should} at {centre}");
        }
        holds_what_it_promises(&Calibration::Table(table), &at, 0.0)?;
    }

    /// What is refused was refused for the reason that it gives; nothing stops the constructor.
    #[test]
    fn any_knots_are_a_table_or_an_error(
        knots in prop::collection::vec(any::<(i32, i32)>(), 0..6),
        interpolation in interpolations(),
    ) {
        let knots: Vec<Knot> = knots
            .iter()
            .map(|&(x, y)| Knot { centre: Pixels::from_bits(x), value: Micrometres::from_bits(y) })
            .collect();
        let sorted = knots.windows(2).all(|k| k[0].centre < k[1].centre);
        let rises = knots.windows(2).all(|k| k[0].value < k[1].value);
        let falls = knots.windows(2).all(|k| k[0].value > k[1].value);
        match Table::new(interpolation, &knots) {
            Ok(_) => prop_assert!(knots.len() >= 2 && sorted && (rises || falls)),
            Err(TableError::Knots(KnotsError::TooFew { .. })) => prop_assert!(knots.len() < 2),
            Err(TableError::Knots(KnotsError::TooMany { .. })) => prop_assert!(false),
            Err(TableError::Knots(KnotsError::Order { index, centre })) => {
                prop_assert_eq!(knots[index].centre, centre);
                prop_assert!(centre.to_f64() < knots[index - 1].centre.to_f64() + CLOSEST.to_f64());
            }
            Err(TableError::Knots(KnotsError::Step { index, value })) => {
                prop_assert_eq!(knots[index].value, value);
                let step = value.to_f64() - knots[index - 1].value.to_f64();
                prop_assert!(step.abs() >= 2f64.powi(23));
            }
            Err(TableError::NotMonotone { index, distance }) => {
                prop_assert_eq!(knots[index].value, distance);
                let before = knots[index - 1];
                let rise = distance.to_f64() - before.value.to_f64();
                let length = knots[index].centre.to_f64() - before.centre.to_f64();
                let flat = rise.abs() < length / 16.0;
                let falls = knots[knots.len() - 1].value < knots[0].value;
                prop_assert!(flat || (rise < 0.0) != falls);
            }
        }
    }

    /// Eq. (1) with residuals that it takes is monotone but for what its rounding is stated to be.
    #[test]
    fn every_corrected_curve_is_monotone(
        ends in (1191..1900i32, 1901..=2654i32),
        share in prop::collection::vec(-1.0..1.0f64, 1..60),
        steepness in prop_oneof![0.0..0.5f64, Just(0.499)],
        interpolation in interpolations(),
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
        match Corrected::new(curve.clone(), interpolation, &knots) {
            Ok(corrected) => {
                let slack = 4.0 * STEP + largest_rise(corrected.residuals()) / 2f64.powi(22);
                holds_what_it_promises(&Calibration::Corrected(corrected.clone()), &at, slack)?;
                for centre in places(corrected.valid(), &at) {
                    let (distance, slope) = corrected.distance_at(centre).expect("in range");
                    let (plain, of_curve) = curve.distance_at(centre).expect("in range");
                    let (residual, change) = corrected.residuals().at(centre).expect("in range");
                    prop_assert_eq!(distance.to_bits(), plain.to_bits() + residual.to_bits());
                    prop_assert_eq!(slope, of_curve + change);
                    prop_assert!(change.abs() <= 0.5001 * of_curve.abs(), "{change} of {of_curve}");
                }
            }
            // A cubic may be half as steep again as its secants.
            Err(CorrectedError::Steep { .. }) => {
                prop_assert!(interpolation == Interpolation::Cubic && steepness > 0.16, "{steepness}");
            }
            Err(error) => prop_assert!(false, "{error}"),
        }
    }

    /// Any eq. (1) with any residuals: usable or refused.
    #[test]
    fn any_residuals_are_usable_or_refused(
        d in any::<i32>(),
        k in (any::<i64>(), 8..40u32).prop_map(|(k, shift)| k >> shift),
        pole in any::<i32>(),
        start in any::<i32>(),
        steps in prop::collection::vec((0..1u32 << 26, -(1i64 << 24)..1 << 24), 1..8),
        shift in 0..24u32,
        interpolation in interpolations(),
        at in prop::collection::vec(0.0..1.0f64, 1..20),
    ) {
        let knots = chain((start, 0), &steps, |_, rise| rise >> shift);
        let valid = knots[0].centre..=knots[knots.len() - 1].centre;
        let Ok(curve) = Eq1::new(Micrometres::from_bits(d), k, Pixels::from_bits(pole), valid) else {
            return Ok(());
        };
        if let Ok(corrected) = Corrected::new(curve, interpolation, &knots) {
            let slack = 4.0 * STEP + largest_rise(corrected.residuals()) / 2f64.powi(22);
            holds_what_it_promises(&Calibration::Corrected(corrected), &at, slack)?;
        }
    }

    /// Every centre that there is has a distance or is out of range, and which of them is a matter of the range alone.
    #[test]
    fn any_centre_is_borne(
        knots in monotone_knots(),
        interpolation in interpolations(),
        centres in prop::collection::vec(any::<i32>(), 1..40),
    ) {
        let Ok(table) = Table::new(interpolation, &knots) else { return Ok(()) };
        let (first, last) = table.valid();
        for centre in centres.into_iter().map(Pixels::from_bits) {
            let inside = first <= centre && centre <= last;
            prop_assert_eq!(table.distance_at(centre).is_ok(), inside);
        }
    }
}
