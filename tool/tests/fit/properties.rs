//! Properties that hold for every file of points.

use calibration::fit::solve::{Form, solve};
use calibration::record::form::make;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use slitrange_device::record::decode;
use slitrange_tool::fit::report::Report;

use crate::command::*;

/// The same cases in every run.
fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(7),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// Whatever is accepted gives records that decode, and that give the fit's distances again.
fn accepted(text: &str, position: Option<f64>) -> Result<bool, TestCaseError> {
    let Ok(points) = Points::parse(text) else {
        return Ok(false);
    };
    let Ok(solved) = solve(&points.points, position) else {
        return Ok(false);
    };
    let directory = tempfile::tempdir().expect("a directory");
    let mut any = false;
    let forms = [Form::Eq1, Form::Corrected, Form::Table].map(Some);
    for form in [None].into_iter().chain(forms) {
        let Ok(made) = make(&solved, form) else {
            continue;
        };
        let record = Record {
            calibration: made.calibration.clone(),
            errors: CalibrationErrors::Unknown,
            ..Record::nominal().expect("a record")
        };
        let written = EncodedRecord::new(record.clone()).expect("a record");
        let read = decode(written.bytes()).expect("a record");
        prop_assert_eq!(&read, &record);
        for centre in made.curve.even_steps(100) {
            let at = Pixels::from_bits((centre * 65536.0).round() as i32);
            let Ok((distance, _)) = read.calibration.distance_at(at) else {
                // An end may be rounded outwards by a step.
                let (first, last) = made.curve.eq1.valid;
                prop_assert!((centre - first).abs() < 1e-4 || (centre - last).abs() < 1e-4);
                continue;
            };
            let off = (distance.to_f64() - 1e6 * made.curve.distance(at.to_f64())).abs();
            let stated = made.error_um;
            prop_assert!(off <= stated.max(0.02) * 1.5, "{off} um, {stated} stated");
            if made.form == Form::Eq1 {
                // Rounding of xp and of the centre: half a step of each.
                let rounding = 0.02 + 1e6 * made.curve.slope(centre).abs() / 65536.0;
                prop_assert!(off <= rounding, "{off} um at {centre}, {rounding} allowed");
            }
        }
        let report = Report::of("points".into(), &solved, &made, None);
        prop_assert!(!report.to_string().contains("NaN"), "{}", report);
        figures::fit::draw(&solved, made.form, None, &directory.path().join("a.svg"))
            .expect("a figure");
        any = true;
    }
    Ok(any)
}

proptest! {
    #![proptest_config(cases(2000))]

    #[test]
    fn any_text_is_fitted_or_refused_without_a_panic(
        text in concat!(
            "(x_px,d_mm(,sigma_px)?\n)?",
            "([-0-9.,e#\"NaN \n]|[0-9]{1,4},[0-9]{1,4}\n){0,80}",
        )
    ) {
        let _ = accepted(&text, None)?;
    }
}

proptest! {
    #![proptest_config(cases(200))]

    /// Takes points on any curve of the kind, with any noise; some lines and numbers are spoilt.
    #[test]
    fn accepted_points_give_a_curve_that_keeps_its_promises(
        count in 0..80usize,
        ends in (0.0..3600.0f64, 0.0..3600.0f64),
        pole in -5000.0..9000.0f64,
        scale in -3.0..7.0f64,
        d in -2000.0..2000.0f64,
        bend in prop_oneof![Just(0.0), -0.3..0.3f64],
        noise in prop_oneof![Just(0.0), 0.0..1.0f64],
        noises in prop::collection::vec(-1.0..1.0f64, 80),
        sigma in prop_oneof![Just(None), (1e-5..10.0f64).prop_map(Some)],
        position in prop_oneof![Just(None), (1e-9..1e-2f64).prop_map(Some)],
        spoilt in prop::collection::vec((0..80usize, -500.0..500.0f64, any::<bool>()), 0..4),
    ) {
        let k = 10f64.powf(scale);
        let mut text = String::from(if sigma.is_some() { "x_px,d_mm,sigma_px\n" } else { "x_px,d_mm\n" });
        for (i, by_noise) in noises.iter().enumerate().take(count) {
            let part = i as f64 / count.max(2) as f64;
            let x = ends.0 + (ends.1 - ends.0) * part;
            let mut distance = d + k / (x - pole) * (1.0 + bend * (3.0 * part).sin());
            let mut x = x + noise * by_noise;
            for &(_, by, of_distance) in spoilt.iter().filter(|spoilt| spoilt.0 == i) {
                if of_distance { distance += by } else { x += by }
            }
            text += &format!("{x:.5},{distance:.5}");
            if let Some(sigma) = sigma {
                text += &format!(",{sigma}");
            }
            text.push('\n');
        }
        let _ = accepted(&text, position)?;
    }
}

/// Checks that the test above has an effect: the tool accepts many such points.
#[test]
fn random_points_on_a_curve_are_accepted() {
    use super::truth::{Truth, seeded};
    for (seed, distortion) in (0..10).flat_map(|seed| [(seed, 0.0), (seed, 0.03)]) {
        let points = Truth::distorted(distortion).points(40, 0.01, &mut seeded(seed));
        let lines = points.iter();
        let lines = lines.map(|point| format!("{},{}\n", point.x_px, point.d_mm));
        let text = format!("x_px,d_mm\n{}", lines.collect::<String>());
        assert!(accepted(&text, None).expect("held"));
    }
}
