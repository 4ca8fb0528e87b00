//! The paper's fig. 12: eq. (1) fitted to the centres of white printer paper through the slit, and what it
//! leaves.

use std::path::Path;

use figures::axes::{self, Axis, panel};
use plotters::prelude::*;

use super::style::{RIGHT, colour, draw_zero};
use crate::paper::apparatus::{Aperture, TABLE};
use crate::paper::materials::MATERIALS;
use crate::paper::methods::Method;
use crate::programs::table1::report::Report;

/// Index of printer paper in the table of materials.
const PRINTER_PAPER: usize = 3;

/// Centres that are drawn on the curve.
const DOTS: usize = 30;

const RESIDUALS: usize = 700;

pub fn draw(report: &Report, path: &Path) -> anyhow::Result<()> {
    let root = axes::figure(path, 860)?;
    let (above, below) = root.split_vertically(520);
    let outcome = report.outcome(PRINTER_PAPER, Aperture::Slit);
    let judged = outcome.of(Method::Gaussian);
    let colour = colour(Method::Gaussian);
    let curve = judged.fit.curve;
    let (first, last) = judged.fit.valid;
    let room = 0.04 * (last - first);
    let range = (first - room, last + room);

    let x = Axis::linear(range, "", 10, 0);
    let y = Axis::linear((TABLE.0 - 0.03, TABLE.1 + 0.03), "distance, m", 8, 2);
    let title = format!(
        "{}, slit: eq. (1) through all centres",
        MATERIALS[PRINTER_PAPER].name
    );
    let mut upper = panel(&above, &title, RIGHT, &x, &y)?;
    let line = (0..=40).map(|i| first + (last - first) * f64::from(i) / 40.0);
    upper.draw_series([PathElement::new(
        line.map(|x| (x, curve.distance(x))).collect::<Vec<_>>(),
        BLACK.stroke_width(2),
    )])?;
    let all = outcome.centres.iter().zip(&outcome.distances);
    let dots = all.step_by((outcome.centres.len() / DOTS).max(1));
    upper.draw_series(dots.map(|(&x, &d)| Circle::new((x, d), 5, colour.filled())))?;
    // Without uncertainties: those of the fit are for errors that are independent, and neighbours share their
    // speckle.
    let lines = [
        "d = D + K/(x − xp)",
        &format!("D = {:.1} mm", curve.d * 1e3),
        &format!("K = {:.0} m px", curve.k),
        &format!("xp = {:.0} px", curve.pole),
    ];
    axes::write_lines(&above, (640, 70), &lines)?;

    let x = Axis::linear(range, "centre, px", 10, 0);
    let y = Axis::linear((-450.0, 450.0), "residual, um", 5, 0);
    let mut lower = panel(&below, "", RIGHT, &x, &y)?;
    draw_zero(&mut lower, range)?;
    let all = outcome.centres.iter().zip(&judged.errors);
    let points: Vec<(f64, f64)> = all
        .step_by((outcome.centres.len() / RESIDUALS).max(1))
        .filter(|(centre, _)| centre.is_finite())
        .map(|(&centre, &error)| (centre, f64::from(error) * 1e6))
        .collect();
    lower.draw_series(
        points
            .into_iter()
            .map(|at| Circle::new(at, 2, colour.filled())),
    )?;
    root.present()?;
    Ok(())
}
