//! What the instructions of a whole row buy, by each method: one panel a situation.

use std::path::Path;

use figures::axes::{self, Area, Axis, Scale, TEXT, TITLE, panel, text};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::curves::axis_of_ratios;
use super::labels::{self, Box, Line, Point};
use super::style::{BAND, BOUND, bold, colour, is_default};
use crate::programs::cost::accuracy::{InSituation, MOST_FAULTS, SITUATIONS};
use crate::programs::cost::pareto;
use crate::programs::cost::report::Measured;

/// Ratios above are drawn at the top, with their number.
const WORST: f64 = 60.0;

/// A difference of ratios that chance explains: 20,000 rows give each to 0.5 %, and two on the same rows to
/// less.
const CHANCE: f64 = 0.005;

const INSTRUCTIONS: [f64; 14] = [
    10e3, 12e3, 15e3, 20e3, 25e3, 30e3, 40e3, 50e3, 60e3, 70e3, 80e3, 100e3, 120e3, 150e3,
];

/// Draws the figure.
pub fn draw(measured: &Measured, path: &Path) -> anyhow::Result<()> {
    let root = axes::figure(path, 1500)?;
    let root = root.titled(
        "What the instructions of a whole row buy (filled points: no faster method is as accurate)",
        bold(TITLE, BLACK),
    )?;
    let times = |of: &&InSituation| {
        let width = SITUATIONS[of.situation].chip_width;
        (measured.row_instructions(of.method, width)).map(|count| count as f64)
    };
    let all = || {
        measured
            .accuracy
            .situations
            .iter()
            .filter_map(|of| times(&of))
    };
    let range = (
        all().fold(f64::INFINITY, f64::min) * 0.85,
        all().fold(0.0, f64::max) * 1.25,
    );
    for (i, area) in root.split_evenly((SITUATIONS.len(), 1)).iter().enumerate() {
        let mut points: Vec<(&InSituation, f64)> = measured
            .accuracy
            .situations
            .iter()
            .filter(|of| of.situation == i)
            .filter(|of| measured.accuracy.faults(&of.outcome) <= MOST_FAULTS)
            .filter_map(|of| Some((of, times(&of)?)))
            .collect();
        // Drawn last, the default lies on top.
        points.sort_by_key(|(of, _)| is_default(of.method));
        draw_situation(area, SITUATIONS[i].name, range, &points)?;
    }
    root.present()?;
    Ok(())
}

fn draw_situation(
    area: &Area<'_>,
    title: &str,
    times: (f64, f64),
    points: &[(&InSituation, f64)],
) -> anyhow::Result<()> {
    let x = Axis::new(
        Scale::Log,
        times,
        "instructions from a row's words to its checked centre on the chip",
        &INSTRUCTIONS,
        |value| value.to_string(),
    );
    let y = axis_of_ratios(WORST);
    let mut panel = panel(area, title, 20, &x, &y)?;
    let bound = [(times.0, 1.0), (times.1, 1.0)];
    axes::draw_line(&mut panel, bound, BAND.stroke_width(9))?;

    let worth: Vec<(f64, f64)> = points
        .iter()
        .map(|(of, time)| (*time, of.outcome.ratio()))
        .collect();
    let front = pareto::front(&worth, CHANCE);
    let line: Vec<(f64, f64)> = front.iter().map(|&i| worth[i]).collect();
    axes::draw_line(&mut panel, line.clone(), BOUND.stroke_width(2))?;
    for (i, (of, time)) in points.iter().enumerate() {
        let at = (*time, of.outcome.ratio());
        let colour = colour(of.method);
        // On the front: filled.
        panel.draw_series([Circle::new(at, 7, WHITE.filled())])?;
        panel.draw_series([match front.contains(&i) {
            true => Circle::new(at, 7, colour.filled()),
            false => Circle::new(at, 6, colour.stroke_width(2)),
        }])?;
    }

    // The labels, in pixels.
    let pixel = |at: &(f64, f64)| -> Point {
        let (x, y) = panel.backend_coord(at);
        (f64::from(x), f64::from(y))
    };
    let labelled: Vec<(Point, String)> = points
        .iter()
        .map(|(of, time)| {
            let ratio = of.outcome.ratio();
            let name = of.method.name();
            let text = match ratio > WORST {
                true => format!("{name} {ratio:.0}×"),
                false => name.to_owned(),
            };
            (pixel(&(*time, ratio)), text)
        })
        .collect();
    let lines: Vec<Line> = line
        .windows(2)
        .map(|ends| (pixel(&ends[0]), pixel(&ends[1])))
        .collect();
    let (columns, rows) = panel.plotting_area().get_pixel_range();
    let inside = Box {
        left: f64::from(columns.start) + 4.0,
        top: f64::from(rows.start) + 4.0,
        right: f64::from(columns.end) - 4.0,
        // Below the bound is its name.
        bottom: pixel(&bound[0]).1 - 5.0,
    };
    let (left, top) = area.get_base_pixel();
    let local = |(x, y): Point| (x as i32 - left, y as i32 - top);
    for (((of, _), (_, label)), placed) in points
        .iter()
        .zip(&labelled)
        .zip(labels::place(&labelled, &lines, inside))
    {
        let colour = colour(of.method);
        if let Some((from, to)) = placed.leader {
            area.draw(&PathElement::new(
                [local(from), local(to)],
                colour.stroke_width(1),
            ))?;
        }
        let style = match is_default(of.method) {
            true => bold(TEXT, colour),
            false => text(TEXT, colour),
        };
        let middle = (
            (placed.text.left + placed.text.right) / 2.0,
            (placed.text.top + placed.text.bottom) / 2.0,
        );
        area.draw(&Text::new(
            label.clone(),
            local(middle),
            style.pos(Pos::new(HPos::Center, VPos::Center)),
        ))?;
    }
    // Of the bound, at its left end, under it.
    let (x, y) = local(pixel(&bound[0]));
    area.draw(&Text::new(
        "Cramér-Rao bound",
        (x + 8, y + 4),
        text(TEXT, BOUND).pos(Pos::new(HPos::Left, VPos::Top)),
    ))?;
    Ok(())
}
