//! The sensor's own spot, as a fit learns it from the shapes of the points.

use calibration::fit::solve::solve;
use calibration::points::{KnownShape, Point, Shape};
use calibration::record::{form, profile};
use rand_distr::{Distribution as _, StandardNormal};
use slitrange::base::places::PLACES;
use slitrange::check::own_spot::Profile;

use super::truth::{Truth, seeded};

/// Points whose spot has a known shape, with a noise of each component and a further scatter.
fn with_shapes(count: usize, noise: f64, scatter: f64, seed: u64) -> Vec<Point> {
    let mut random = seeded(seed);
    let mut points = Truth::nominal().points(count, 0.0, &mut random);
    for point in &mut points {
        point.sigma_px = Some(0.001);
        let mut off = || -> f64 {
            let normal: f64 = StandardNormal.sample(&mut random);
            noise.hypot(scatter) * normal
        };
        let mut shape = shape_at(point.x_px);
        shape.width_px += off();
        // The estimator makes the first one zero.
        for component in &mut shape.components_px[1..] {
            *component += off();
        }
        let noise_px = noise;
        point.shape = Some(KnownShape { shape, noise_px });
    }
    points
}

/// The shape at a centre: cubics.
fn shape_at(x: f64) -> Shape {
    let along = (x - 1900.0) / 600.0;
    Shape {
        width_px: 7.7 - 0.4 * along + 0.1 * along * along,
        components_px: [
            0.0,
            0.05,
            0.19 + 0.01 * along,
            0.02 * along.powi(3),
            -0.01 * along * along,
        ],
    }
}

fn profile_of(points: &[Point]) -> Option<Profile> {
    let solved = solve(points, None).expect("a fit");
    let made = form::make(&solved, None).expect("a calibration");
    profile::of(&solved, &made.calibration)
}

#[test]
fn the_profile_is_that_of_the_points() {
    let profile = profile_of(&with_shapes(30, 0.0, 0.0, 1)).expect("a profile");
    let (first, last) = (profile.first.to_f64(), profile.last.to_f64());
    for place in 0..PLACES {
        let expected = shape_at(first + (last - first) * place as f64 / (PLACES - 1) as f64);
        assert!((profile.width[place].to_f64() - expected.width_px).abs() < 1e-4);
        for (values, expected) in profile.components.iter().zip(expected.components_px) {
            assert!((values[place].to_f64() - expected).abs() < 1e-4);
        }
    }
    assert!(profile.deviation.to_f64() < 1e-4);
    // 0.2 % of the width.
    assert!((profile.width_deviation.to_f64() - 0.002 * 7.73).abs() < 2e-4);
}

/// The scatter of the shapes beyond their noise, and what the curves may be off: four parameters and 30
/// points leave sqrt(4 / 30) of both. Of 200 calibrations with 26 degrees of freedom, or four times as many
/// for the components, the mean is known to 1 %.
#[test]
fn deviations_are_the_scatter_beyond_the_noise() {
    let mean = |noise: f64, scatter: f64, of: &dyn Fn(&Profile) -> f64| {
        let found = (0..200).map(|seed| {
            of(&profile_of(&with_shapes(30, noise, scatter, seed)).expect("a profile")).powi(2)
        });
        (found.sum::<f64>() / 200.0).sqrt()
    };
    let width = |profile: &Profile| profile.width_deviation.to_f64();
    let components = |profile: &Profile| profile.deviation.to_f64();
    let expected = (0.04f64.powi(2) + 0.05f64.powi(2) * 4.0 / 30.0).sqrt();
    for (what, found) in [
        ("width", mean(0.03, 0.04, &width)),
        ("components", mean(0.03, 0.04, &components)),
    ] {
        println!("{what}: {found:.4} of {expected:.4} px");
        assert!((found / expected - 1.0).abs() < 0.05);
    }
    // Noise alone: the curves' own error, and what chance leaves above the noise.
    let noise = mean(0.03, 0.0, &components);
    println!("noise alone: {noise:.4} px");
    assert!((0.03 * (4.0f64 / 30.0).sqrt()..0.02).contains(&noise));
}

#[test]
fn points_without_shapes_or_too_few_have_no_profile() {
    let points = with_shapes(30, 0.001, 0.0, 1);
    let without = |left: usize| -> Vec<Point> {
        let shape = |(index, point): (usize, &Point)| Point {
            shape: point.shape.filter(|_| index < left),
            ..*point
        };
        points.iter().enumerate().map(shape).collect()
    };
    for (left, is_there) in [(0, false), (3, false), (4, true), (30, true)] {
        assert_eq!(profile_of(&without(left)).is_some(), is_there, "{left}");
    }
    // A straight line through four points.
    let profile = profile_of(&with_shapes(4, 0.0, 0.0, 1)).expect("a profile");
    assert!((profile.components[1][4].to_f64() - 0.05).abs() < 1e-4);
}
