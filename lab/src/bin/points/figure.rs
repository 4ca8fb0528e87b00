//! Error over the number of points.

use std::path::Path;

use anyhow::Result;
use plotters::prelude::*;

use crate::{COUNTS, Cell, MEANS};

const TEXT: i32 = 19;
const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);

/// Dark enough for text on white, one for each of [`MEANS`].
const COLOURS: [RGBColor; 4] = [
    RGBColor(0x15, 0x55, 0xd0),
    RGBColor(0x2a, 0x78, 0x2e),
    RGBColor(0x7a, 0x1b, 0xaa),
    RGBColor(0xb3, 0x59, 0x00),
];

/// A tick's text: there is no room for all of them.
fn label(count: f64) -> String {
    match count.round() as u32 {
        count @ (10 | 20 | 30 | 50 | 100 | 200) => count.to_string(),
        _ => String::new(),
    }
}

/// Draws it. Full lines are for sensors that follow eq. (1), broken ones for those that depart from it.
pub fn draw(cells: &[Vec<Vec<Cell>>], path: &Path) -> Result<()> {
    let root = SVGBackend::new(path, (1000, 620)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .margin_right(340)
        .x_label_area_size(2 * TEXT + 16)
        .y_label_area_size(4 * TEXT)
        .build_cartesian_2d((3.0..200.0_f64).log_scale(), (0.1..1000.0_f64).log_scale())?;
    let style = |colour: RGBColor| ("sans-serif", TEXT).into_font().color(&colour);
    chart
        .configure_mesh()
        .bold_line_style(GRID)
        .max_light_lines(0)
        .axis_style(BLACK)
        .label_style(style(BLACK))
        .x_desc("points")
        .y_desc("RMS error of the curve, µm")
        .x_label_formatter(&|count| label(*count))
        .y_label_formatter(&|error| format!("{error}"))
        .draw()?;
    for (departs, sensors) in cells.iter().enumerate() {
        for (column, colour) in sensors.iter().zip(COLOURS) {
            let points: Vec<(f64, f64)> = (COUNTS.iter().zip(column))
                .filter_map(|(&count, cell)| Some((count as f64, cell.error? * 1e6)))
                .collect();
            if departs == 0 {
                chart.draw_series(LineSeries::new(points.clone(), colour.stroke_width(2)))?;
                chart.draw_series(points.iter().map(|&at| Circle::new(at, 4, colour.filled())))?;
            } else {
                chart.draw_series(DashedLineSeries::new(
                    points.clone(),
                    8,
                    6,
                    colour.stroke_width(2),
                ))?;
                chart.draw_series(
                    points
                        .iter()
                        .map(|&at| Circle::new(at, 4, colour.stroke_width(2))),
                )?;
            }
        }
    }
    // Beside the last points of the full lines, where there is room for all.
    let (x, _) = chart.backend_coord(&(200.0, 1.0));
    for ((means, column), colour) in MEANS.iter().zip(&cells[0]).zip(COLOURS) {
        let Some(error) = column.last().and_then(|cell| cell.error) else {
            continue;
        };
        let (_, y) = chart.backend_coord(&(200.0, error * 1e6));
        root.draw(&Text::new(
            means.name,
            (x + 14, y - TEXT / 2),
            style(colour),
        ))?;
    }
    for (line, words) in [
        "full: sensors that follow eq. (1)",
        "broken: departing by up to 300 µm",
    ]
    .into_iter()
    .enumerate()
    {
        root.draw(&Text::new(
            words,
            (x + 14, 24 + 26 * line as i32),
            style(BLACK),
        ))?;
    }
    root.present()?;
    Ok(())
}
