//! The whole sensor: where more time for a reading buys nothing.

use std::path::Path;

use plotters::prelude::*;
use slitrange_tool::axes::{Axis, Scale};

use super::curves::{Curve, Kind, draw_curves};
use crate::reading_time::{Light, Point, ROWS, ROWS_PER_SECOND};

/// Draws the figure.
pub fn draw(points: &[Point], path: &Path) -> anyhow::Result<()> {
    let root = SVGBackend::new(path, (1000, 720)).into_drawing_area();
    root.fill(&WHITE)?;
    let milliseconds = ROWS.map(|rows| rows as f64 / ROWS_PER_SECOND * 1e3);
    let tick = |time: f64| {
        let rows = (time * ROWS_PER_SECOND / 1e3).round();
        let digits = usize::from(time < 10.0);
        format!("{time:.digits$} ({rows})")
    };
    let x = Axis::new(
        Scale::Log,
        (milliseconds[0] * 0.9, milliseconds[6] * 1.12),
        "time for a reading, ms (rows in it)",
        &milliseconds,
        tick,
    );
    let y = Axis::new(
        Scale::Log,
        (0.5, 2000.0),
        "RMS error of the distance, µm",
        &[
            0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0,
        ],
        |value| value.to_string(),
    );
    let of = |light| points.iter().filter(move |point| point.light == light);
    let curve = |name: &str, light, colour, kind| Curve {
        name: name.into(),
        colour,
        kind,
        points: of(light)
            .map(|point| (point.milliseconds, point.micrometres))
            .collect(),
    };
    let bound = Curve::bound(
        "bound",
        of(Light::NoiseAlone)
            .map(|point| (point.milliseconds, point.bound_micrometres))
            .collect(),
    );
    draw_curves(
        &root,
        "White paper at 0.8 m: rows help against noise, and against speckle as far as it changes",
        &x,
        &y,
        &[
            bound,
            curve("noise alone", Light::NoiseAlone, BLACK, Kind::Default),
            curve(
                "speckle, at rest",
                Light::SpeckleAtRest,
                RGBColor(0x15, 0x55, 0xd0),
                Kind::Measured,
            ),
            curve(
                "speckle, receding",
                Light::SpeckleReceding,
                RGBColor(0xc6, 0x20, 0x20),
                Kind::Measured,
            ),
            curve(
                "speckle, sliding",
                Light::SpeckleSliding,
                RGBColor(0x1a, 0x80, 0x3a),
                Kind::Measured,
            ),
        ],
    )?;
    root.present()?;
    Ok(())
}
