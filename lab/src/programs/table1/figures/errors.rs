//! The paper's fig. 10: errors along the table through the lens and through the slit, of brushed metal. And
//! the lens's with neither speckle nor noise: what its aberrations and its flare are to blame for.

use calibration::fit::eq1;
use figures::axes::{self, Area, Axis, Panel, panel};
use plotters::prelude::*;

use super::style::{RIGHT, colour, draw_zero};
use crate::paper::apparatus::TABLE;
use crate::paper::lens_effects::Flare;
use crate::paper::lens_path::{centre_without_speckle, centroid_without_speckle};
use crate::paper::materials::MATERIALS;
use crate::paper::methods::Method;
use crate::prelude::*;
use crate::programs::table1::report::Report;

/// Index of brushed metal in the table of materials.
const BRUSHED_METAL: usize = 0;

/// Points of a curve: more cannot be told apart.
const POINTS: usize = 1500;

pub fn draw(report: &Report, path: &Path) -> anyhow::Result<()> {
    let root = axes::figure(path, 1290)?;
    let areas = root.split_evenly((3, 1));
    let curves = [
        (Method::PlaneGaussian, "lens, gaussian in the plane"),
        (Method::Gaussian, "slit, gaussian on each row"),
    ];
    for (area, (method, name)) in areas.iter().zip(curves) {
        let outcome = report.outcome(BRUSHED_METAL, method.aperture());
        let judged = outcome.of(method);
        let title = format!(
            "{}, {name}: MAE {:.0} um, MAX {:.0} um",
            MATERIALS[BRUSHED_METAL].name,
            judged.mae * 1e6,
            judged.max * 1e6
        );
        let mut panel = panel_of_errors(area, &title)?;
        let points = outcome.distances.iter().zip(&judged.errors);
        let line: Vec<(f64, f64)> = points
            .step_by((outcome.distances.len() / POINTS).max(1))
            .filter(|(_, error)| error.is_finite())
            .map(|(&distance, &error)| (distance, f64::from(error) * 1e6))
            .collect();
        axes::draw_line(&mut panel, line, colour(method).stroke_width(2))?;
    }
    let mut panel = panel_of_errors(
        &areas[2],
        "lens, no speckle: gaussian in the plane (dark), centroid of the paper's region (light)",
    )?;
    let centroid = |distance| Some(centroid_without_speckle(distance, &Flare::CHOSEN));
    let gaussian = |distance| centre_without_speckle(distance, Some(&Flare::CHOSEN));
    let lens = colour(Method::PlaneGaussian);
    for (curve, colour) in [
        (errors(&centroid, 841)?, lens.mix(0.45)),
        (errors(&gaussian, 43)?, lens.mix(1.0)),
    ] {
        axes::draw_line(&mut panel, curve, colour.stroke_width(2))?;
    }
    root.present()?;
    Ok(())
}

fn panel_of_errors<'a, 'b>(area: &'b Area<'a>, title: &str) -> anyhow::Result<Panel<'a, 'b>> {
    let x = Axis::linear(TABLE, "distance, m", 9, 2);
    let y = Axis::linear((-900.0, 900.0), "error, um", 8, 0);
    let mut panel = panel(area, title, RIGHT, &x, &y)?;
    draw_zero(&mut panel, TABLE)?;
    Ok(panel)
}

/// Distances, and what eq. (1), fitted to the centres at that many of them, is off by in micrometres.
fn errors(
    centre: &(dyn Fn(f64) -> Option<f64> + Sync),
    distances: usize,
) -> anyhow::Result<Vec<(f64, f64)>> {
    let points: Vec<(f64, f64)> = (0..distances)
        .into_par_iter()
        .filter_map(|i| {
            let distance = TABLE.0 + (TABLE.1 - TABLE.0) * i as f64 / (distances - 1) as f64;
            Some((centre(distance)?, distance))
        })
        .collect();
    let curve = eq1::fit(&points)?.curve;
    let error = |&(centre, distance): &(f64, f64)| (curve.distance(centre) - distance) * 1e6;
    Ok(points.iter().map(|point| (point.1, error(point))).collect())
}
