//! What the report and the figure of a fit show of a comb of slits.

use calibration::fit::comb;
use calibration::fit::solve::solve;
use calibration::points::SlitImage;
use calibration::record::form;
use rand_distr::{Distribution as _, StandardNormal};
use simulator::optics::Optics;
use slitrange::frame::comb::NOMINAL_PLACES_UM;
use slitrange_tool::fit::report::Report;

use crate::command::says;

use super::truth::{Truth, seeded};

/// The mask's places are off by 5 um, and centres have a noise of 0.001 px.
#[test]
fn report_and_figure_name_the_slits() {
    let mut random = seeded(5);
    let mut points = Truth::nominal().points(60, 0.0, &mut random);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let slits = NOMINAL_PLACES_UM
        .map(|um| Optics::nominal().behind(1e-6 * (f64::from(um) + 5.0 * normal())));
    for point in &mut points {
        point.slits = Some(slits.map(|slit| {
            let x_px = slit.centre(1e-3 * point.d_mm) + 0.001 * normal();
            Some(SlitImage::new(x_px, 800.0))
        }));
    }
    let comb = comb::fit(&points).expect("a fit").expect("a comb");
    let solved = solve(&comb.points, None).expect("a fit");
    let made = form::make(&solved, None).expect("a calibration");
    let report = Report::of("points.csv".into(), &solved, &made, Some(&comb));
    let text = report.to_string();
    println!("{text}");
    let last = "\n    16      6800      60       3  ";
    says(&text, ["\nThe comb: 16 slits, 960 images\n", last]);
    assert!(text.lines().all(|line| line.len() <= 150));
    let json = serde_json::to_string(&report).expect("JSON");
    assert!(json.contains("\"residual_px\""), "{json}");
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("a.svg");
    figures::fit::draw(&solved, made.form, Some(&comb), &path).expect("a figure");
    let svg = std::fs::read_to_string(&path).expect("text");
    assert!(svg.contains("corrections of 16 slits in the middle"));
}
