//! What a record says of its errors, compared with the truth.

use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use slitrange::uncertainty::{CalibrationErrors, FittedErrors, PLACES};
use slitrange::units::{Micrometres, Pixels};
use slitrange_tool::fit::solve::{Form, solve};
use slitrange_tool::fit::{calibration, errors};
use slitrange_tool::points::Point;

use crate::truth::{Truth, rms, seeded};

/// What a fit of points says.
fn fitted(points: &[Point], form: Form) -> (slitrange::Calibration, FittedErrors) {
    let solved = solve(points, None).expect("a fit");
    let made = calibration::make(&solved, Some(form)).expect("a calibration");
    match errors::of(&solved, &made) {
        CalibrationErrors::Fitted(errors) => (made.calibration, errors),
        other => panic!("{other:?}"),
    }
}

/// Errors of 300 sensors' curves over the uncertainty in their records, root mean square at each of the nine
/// places. A sensor has 40 points, whose centres have a noise in pixels.
fn errors_over_claims(truth: &Truth, form: Form, noise: f64) -> [f64; PLACES] {
    let mut over_claim: [Vec<f64>; PLACES] = Default::default();
    for seed in 0..300 {
        let points = truth.points(40, noise, &mut seeded(seed));
        let (calibration, errors) = fitted(&points, form);
        let (first, last) = calibration.valid();
        for (place, over_claim) in over_claim.iter_mut().enumerate() {
            let share = place as f64 / (PLACES - 1) as f64;
            let x = first.to_f64() + share * (last.to_f64() - first.to_f64());
            let at = Pixels::from_f32(x as f32).clamp(first, last);
            let (found, _) = calibration.distance_at(at).expect("in range");
            let error = found.to_f64() - 1e6 * truth.distance(x);
            over_claim.push(error / errors.curve[place].to_f64());
        }
    }
    over_claim.map(|values| rms(&values))
}

/// 300 values tell an RMS to 4 %. A claim of 37 freedoms is known to 12 %, of which the mean over the sensors
/// counts.
#[test]
fn curves_are_off_by_the_uncertainty_in_the_record() {
    // 0.2 px are 80 um.
    let eq1 = errors_over_claims(&Truth::nominal(), Form::Eq1, 0.2);
    println!("eq. (1): {eq1:.2?}");
    assert!(eq1.iter().all(|ratio| (0.85..1.15).contains(ratio)));
    // A departure from eq. (1) of up to 0.25 mm, and points that are known to 8 um.
    let corrected = errors_over_claims(&Truth::distorted(0.01), Form::Corrected, 0.02);
    println!("corrected: {corrected:.2?}");
    assert!(corrected.iter().all(|ratio| (0.8..1.25).contains(ratio)));
    // The same with points that are known to 80 um: the smooth curve leaves some of the departure, which its
    // covariance does not fully hold.
    let hidden = errors_over_claims(&Truth::distorted(0.01), Form::Corrected, 0.2);
    println!("corrected, departure hidden: {hidden:.2?}");
    assert!(hidden.iter().all(|ratio| (0.8..1.4).contains(ratio)));
}

/// Points on a rough surface: two speckle patterns give the light, and the displacement given the light is
/// normal. The deviation is `share` of the distance from D, and the usual height falls as its inverse square.
fn rough(truth: &Truth, count: usize, share: f64, random: &mut ChaCha8Rng) -> Vec<Point> {
    let d = truth.parameters()[0];
    let mut points = truth.points(count, 0.0, random);
    for point in &mut points {
        let from_pole = 1e-3 * point.d_mm - d;
        let usual = 1000.0 * (0.9 / from_pole).powi(2);
        let light: f64 = (0..2).map(|_| -0.5 * random.random::<f64>().ln()).sum();
        let normal: f64 = StandardNormal.sample(random);
        let off = share * from_pole * normal / light.sqrt();
        point.x_px = truth.centre(1e-3 * point.d_mm + off);
        point.sigma_px = Some(0.01);
        point.height_counts = Some((usual * light).clamp(1.0, 4095.0));
    }
    points
}

/// 200 calibrations of 60 points each. A deviation is known to 1 / sqrt(2 * 57) = 9 %, so the mean over the
/// calibrations to 0.7 %; Student's factor adds 2 %.
#[test]
fn the_surface_is_told_from_the_residuals_and_the_heights() {
    let truth = Truth::nominal();
    let d = truth.parameters()[0];
    let share = 4e-4;
    let (mut ratios, mut heights) = (vec![], vec![]);
    for seed in 0..200 {
        let points = rough(&truth, 60, share, &mut seeded(seed));
        let (calibration, errors) = fitted(&points, Form::Eq1);
        let surface = errors.surface.expect("a surface");
        let middle = PLACES / 2;
        let (first, last) = calibration.valid();
        let x = (first.to_f64() + last.to_f64()) / 2.0;
        let from_pole = truth.distance(x) - d;
        // Deviation and height go together: what counts is the deviation for a given height.
        let usual = 1000.0 * (0.9 / from_pole).powi(2);
        let of_usual = surface.height[middle].to_f64() / usual;
        ratios
            .push(surface.deviation[middle].to_f64() * of_usual.sqrt() / (1e6 * share * from_pole));
        heights.push(of_usual);
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let scatter = rms(&ratios
        .iter()
        .map(|ratio| ratio - mean(&ratios))
        .collect::<Vec<f64>>());
    println!(
        "{:.3} +- {scatter:.3} of the truth, height {:.3}",
        mean(&ratios),
        mean(&heights)
    );
    assert!((0.97..1.07).contains(&mean(&ratios)));
    assert!(scatter < 0.14);
    assert!((0.93..1.07).contains(&mean(&heights)));
}

/// Without speckle the points scatter by their noise, and the surface's part is small beside it. Without
/// heights, or with few points, a record says nothing of the surface.
#[test]
fn a_smooth_target_has_no_surface_part() {
    let truth = Truth::nominal();
    let smooth = |seed: u64| -> Vec<Point> {
        let points = truth.points(60, 0.02, &mut seeded(seed));
        let known = |point| Point {
            sigma_px: Some(0.02),
            height_counts: Some(1000.0),
            ..point
        };
        points.into_iter().map(known).collect()
    };
    let deviations: Vec<f64> = (0..50)
        .map(|seed| {
            let surface = fitted(&smooth(seed), Form::Eq1)
                .1
                .surface
                .expect("a surface");
            surface.deviation[PLACES / 2].to_f64()
        })
        .collect();
    println!("{:.2} um", rms(&deviations));
    // 0.02 px are 8 um in the middle; their square is known to 19 %, so what is left is 0.4 of them.
    assert!(rms(&deviations) < 0.5 * 8.0);
    let without_heights = truth.points(60, 0.02, &mut seeded(1));
    assert_eq!(fitted(&without_heights, Form::Eq1).1.surface, None);
    assert_eq!(fitted(&smooth(1)[..12], Form::Eq1).1.surface, None);
    let least = |errors: &FittedErrors| errors.curve.iter().min().copied();
    assert!(least(&fitted(&smooth(1), Form::Eq1).1) > Some(Micrometres::default()));
}
