//! Which points are refused, with which words, and which points are accepted.

use calibration::fit::solve::solve;
use calibration::points::Point;

use super::truth::{Truth, seeded};

/// `count` points at even distances on the nominal curve, without noise.
fn exact(count: usize) -> Vec<Point> {
    let mut points = Truth::nominal().points(count, 0.0, &mut seeded(0));
    for point in &mut points {
        point.x_px = (point.x_px * 1e3).round() / 1e3;
        point.d_mm = (point.d_mm * 1e3).round() / 1e3;
    }
    points
}

fn refusal(points: &[Point]) -> String {
    match solve(points, None) {
        Ok(_) => "accepted".into(),
        Err(error) => format!("{error:#}"),
    }
}

/// The points in another order, with the lines that they then have.
fn renumbered(mut points: Vec<Point>) -> Vec<Point> {
    for (line, point) in (2..).zip(&mut points) {
        point.line = line;
    }
    points
}

#[test]
fn unusable_points_are_refused_with_a_reason() {
    let mut said = Vec::new();
    let mut say = |name: &str, points: Vec<Point>| {
        said.push(format!("{name}: {}", refusal(&points)));
    };
    say("no points", vec![]);
    say("one point", exact(5)[..1].to_vec());
    say("two points", exact(5)[..2].to_vec());
    let straight = (0..5).map(|i| Point {
        line: i + 2,
        x_px: 1000.0 + 100.0 * i as f64,
        d_mm: 600.0 + 50.0 * i as f64,
        ..Point::default()
    });
    say("collinear", straight.clone().collect());
    say("three collinear", straight.take(3).collect());
    let mut noisy = Truth::nominal().points(12, 3.0, &mut seeded(5));
    for point in &mut noisy {
        point.d_mm = 600.0 + 0.02 * (point.d_mm - 600.0);
        point.x_px = 2000.0 - 2.0 * (point.d_mm - 600.0) + 0.01 * (point.x_px % 7.0);
    }
    say("straight within its scatter", noisy);
    let twice = [&exact(5)[..2], &exact(5)[..2]].concat();
    say("two distances twice", renumbered(twice));
    let mut same = exact(12);
    same[6].x_px = same[3].x_px;
    say("a centre twice", same);
    let mut same = exact(6);
    same[2].d_mm = same[1].d_mm;
    say("two of 6 distances the same by a slip", same);
    let mut swapped = exact(6);
    (swapped[2].d_mm, swapped[3].d_mm) = (swapped[3].d_mm, swapped[2].d_mm);
    say("two of 6 distances swapped", swapped);
    let mut back = exact(6);
    back[3].x_px = back[1].x_px + 10.0;
    say("one of 6 centres goes back", back);
    for (share, name) in [(2, "half"), (5, "a fifth"), (10, "a tenth")] {
        let mut folded = exact(60);
        let turn = 60 - 60 / share;
        for i in turn..60 {
            folded[i].x_px = folded[turn - 1].x_px + 4.0 * (i - turn + 1) as f64;
        }
        say(&format!("{name} of 60 points folded back"), folded);
    }
    let mut wild = exact(40);
    for i in (0..40).step_by(4) {
        wild[i].x_px += 20.0;
    }
    say("a quarter of 40 points off", wild);
    insta::assert_snapshot!(said.join("\n"));
}

/// A change that would make few points unusable is an outlier among many points.
#[test]
fn one_wrong_point_among_many_is_an_outlier() {
    for change in [
        |points: &mut [Point]| points[20].x_px += 200.0,
        |points: &mut [Point]| points[20].d_mm += 500.0,
        |points: &mut [Point]| points[0].d_mm += 500.0,
        |points: &mut [Point]| points[39].x_px -= 100.0,
    ] {
        let mut points = Truth::nominal().points(40, 0.01, &mut seeded(1));
        change(&mut points);
        let solved = solve(&points, None).expect("a fit");
        let rejected = solved.verdicts.iter().filter(|verdict| !verdict.kept);
        assert_eq!(rejected.count(), 1);
    }
    // Rising or falling, either way.
    let mut points = Truth::nominal().points(40, 0.01, &mut seeded(1));
    points.reverse();
    solve(&renumbered(points.clone()), None).expect("a fit");
    points.iter_mut().for_each(|it| it.x_px = 3647.0 - it.x_px);
    solve(&renumbered(points), None).expect("a fit");
    // Noise that is larger than the steps.
    solve(&Truth::nominal().points(1200, 3.0, &mut seeded(2)), None).expect("a fit");
}

/// Points again and again, up and down, and in any order: those of a distance count as one.
#[test]
fn repeated_points_tell_noise_and_backlash() {
    let once = |seed| Truth::nominal().points(12, 0.02, &mut seeded(seed));
    let again: Vec<Point> = (0..12)
        .flat_map(|i| (0..5).map(move |seed| once(seed)[i]))
        .collect();
    // On the way down, the target stands 0.1 mm farther than the point says.
    let mut down = Truth::nominal().points(12, 0.0, &mut seeded(0));
    for point in &mut down {
        point.x_px = Truth::nominal().centre(1e-3 * (point.d_mm + 0.1));
    }
    down.reverse();
    let mut shuffled = again.clone();
    (0..60).for_each(|i| shuffled.swap(i, (i * 17 + 5) % 60));
    for (name, points, repeats, scatter, backlash) in [
        ("again", again.clone(), 48, Some(0.02), None),
        (
            "up and down",
            [once(0), down.clone()].concat(),
            12,
            None,
            Some(-0.1),
        ),
        (
            "twice up and down",
            [once(0), down.clone(), once(1), down].concat(),
            36,
            Some(0.014),
            Some(-0.1),
        ),
        (
            "again, whole pixels",
            again
                .iter()
                .map(|it| Point {
                    x_px: it.x_px.round(),
                    ..*it
                })
                .collect(),
            48,
            Some(0.0),
            None,
        ),
        ("in any order", shuffled, 48, Some(0.02), Some(0.0)),
    ] {
        let solved = solve(&renumbered(points), None).expect(name);
        let error = Truth::nominal().error(|x| solved.plain.distance(x)).1;
        let found = solved.repeats.expect("repeats");
        println!("{name}: {error:.1} um, {found:?}");
        assert_eq!(
            (solved.points.len(), found.repeats),
            (12, repeats),
            "{name}"
        );
        assert_eq!(found.scatter_px.is_some(), scatter.is_some(), "{name}");
        let off = found.scatter_px.unwrap_or(0.0) - scatter.unwrap_or(0.0);
        assert!(off.abs() < 0.005, "{name}");
        if let Some(due) = backlash {
            let (mm, u) = found.backlash_mm.expect("backlash");
            assert!((mm - due).abs() < 4.0 * u && u < 0.01, "{name}");
        }
    }
}

#[test]
fn three_points_give_a_calibration() {
    let points = Truth::nominal().points(3, 0.0, &mut seeded(0));
    let solved = solve(&points, None).expect("a fit");
    assert!(Truth::nominal().error(|x| solved.plain.distance(x)).1 < 1e-3);
    assert_eq!(solved.plain_quality.uncertainty, None);
    assert_eq!(solved.plain_quality.cross_validated, None);
    let mut points = points;
    points.iter_mut().for_each(|it| it.sigma_px = Some(0.02));
    let solved = solve(&points, None).expect("a fit");
    let uncertainty = 1e6 * solved.plain_quality.uncertainty.expect("by sigma_px");
    println!("three points of 0.02 px: {uncertainty:.2} um");
    assert!((5.0..20.0).contains(&uncertainty));
}
