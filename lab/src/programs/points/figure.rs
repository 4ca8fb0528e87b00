//! Error over the number of points.

use figures::axes::{self, Axis, TEXT, panel, text};
use figures::dark::{BLUE, GREEN, ORANGE, PURPLE};
use plotters::prelude::*;

use crate::prelude::*;
use crate::programs::points::{COUNTS, Cell, MEANS};

/// One for each of [`MEANS`].
const COLOURS: [RGBColor; 4] = [BLUE, GREEN, PURPLE, ORANGE];

/// Draws it. Full lines are for sensors that follow eq. (1), broken ones for those that depart from it.
pub fn draw(cells: &[Vec<Vec<Cell>>], path: &Path) -> Result<()> {
    let root = axes::figure(path, 620)?;
    let ticks = [3.0, 5.0, 10.0, 20.0, 30.0, 50.0, 100.0, 200.0];
    let x = Axis::log((3.0, 200.0), "points", &ticks);
    let ticks = [0.1, 1.0, 10.0, 100.0, 1000.0];
    let name = "RMS error of the curve, um";
    let y = Axis::log((0.1, 1000.0), name, &ticks);
    let mut chart = panel(&root, "", 340, &x, &y)?;
    for (departs, sensors) in cells.iter().enumerate() {
        for (column, colour) in sensors.iter().zip(COLOURS) {
            let points: Vec<(f64, f64)> = (COUNTS.iter().zip(column))
                .filter_map(|(&count, cell)| Some((count as f64, cell.error? * 1e6)))
                .collect();
            if departs == 0 {
                axes::draw_line(&mut chart, points.clone(), colour.stroke_width(2))?;
                axes::draw_dots(&mut chart, points, 4, colour.filled())?;
            } else {
                axes::draw_broken_line(&mut chart, points.clone(), (8, 6), colour.stroke_width(2))?;
                axes::draw_dots(&mut chart, points, 4, colour.stroke_width(2))?;
            }
        }
    }
    // Beside the last points of the full lines, where there is room for all.
    let (x, _) = chart.backend_coord(&(200.0, 1.0));
    for (((name, _), column), colour) in MEANS.into_iter().zip(&cells[0]).zip(COLOURS) {
        let Some(error) = column.last().and_then(|cell| cell.error) else {
            continue;
        };
        let (_, y) = chart.backend_coord(&(200.0, error * 1e6));
        root.draw(&Text::new(name, (x + 14, y - TEXT / 2), text(TEXT, colour)))?;
    }
    let lines = [
        "full: sensors that follow eq. (1)",
        "broken: departing by up to 300 um",
    ];
    axes::write_lines(&root, (x + 14, 24), &lines)?;
    Ok(root.present()?)
}
