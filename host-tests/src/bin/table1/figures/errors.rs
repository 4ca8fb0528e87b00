//! The paper's fig. 10: errors along the table through the lens and through the slit, of brushed metal.

use std::path::Path;

use anyhow::Context as _;
use host_tests::paper::apparatus::{Aperture, TABLE};
use host_tests::paper::materials::MATERIALS;
use host_tests::paper::methods::Method;
use plotters::prelude::*;

use super::panel::{Axis, GRID, colour, panel};
use crate::report::{Report, find};

/// Index of brushed metal in the table of materials.
const BRUSHED_METAL: usize = 0;

/// Points of a curve: more cannot be told apart.
const POINTS: usize = 850;

/// Draws the figure.
pub fn draw(report: &Report, path: &Path) -> anyhow::Result<()> {
    let root = SVGBackend::new(path, (1000, 860)).into_drawing_area();
    root.fill(&WHITE)?;
    let areas = root.split_evenly((2, 1));
    let curves = [
        (
            Aperture::Lens,
            Method::PAPERS_LENS,
            "lens, gaussian in the plane",
        ),
        (
            Aperture::Slit,
            Method::PAPERS_GAUSSIAN,
            "slit, gaussian on each row",
        ),
    ];
    for (area, (aperture, method, name)) in areas.iter().zip(curves) {
        let outcome = report
            .outcome(BRUSHED_METAL, aperture)
            .context("brushed metal was not run")?;
        let judged = find(&outcome.judged, &method).context("a method was not run")?;
        let title = format!(
            "{}, {name}: MAE {:.0} µm, MAX {:.0} µm",
            MATERIALS[BRUSHED_METAL].name,
            judged.mae * 1e6,
            judged.max * 1e6
        );
        let x = Axis {
            range: TABLE.0..TABLE.1,
            name: "distance, m",
            ticks: 9,
            digits: 2,
        };
        let y = Axis {
            range: -900.0..900.0,
            name: "error, µm",
            ticks: 8,
            digits: 0,
        };
        let mut panel = panel(area, &title, &x, &y)?;
        panel.draw_series([PathElement::new(
            vec![(TABLE.0, 0.0), (TABLE.1, 0.0)],
            GRID.stroke_width(2),
        )])?;
        let points = outcome.distances.iter().zip(&judged.errors);
        let line: Vec<(f64, f64)> = points
            .step_by((outcome.distances.len() / POINTS).max(1))
            .filter(|(_, error)| error.is_finite())
            .map(|(&distance, &error)| (distance, f64::from(error) * 1e6))
            .collect();
        panel.draw_series([PathElement::new(
            line,
            colour(aperture, &method).stroke_width(2),
        )])?;
    }
    root.present()?;
    Ok(())
}
