//! What the instructions of a whole row buy, by each method: one panel a situation.

use std::path::Path;

use figures::axes::{self, Area, Axis, TEXT, TITLE, panel, text};
use plotters::prelude::*;

use super::curves::{Curve, axis_of_ratios, write_names};
use super::style::{BAND, BOUND, bold, is_default};
use crate::programs::cost::accuracy::{InSituation, MOST_FAULTS, SITUATIONS};
use crate::programs::cost::report::Measured;

/// Ratios above are drawn at the top, with their number.
const WORST: f64 = 60.0;

/// A difference of ratios that chance explains: 20,000 rows give each to 0.5 %, and two on the same rows to
/// less.
const CHANCE: f64 = 0.005;

const INSTRUCTIONS: [f64; 13] = [
    10e3, 12e3, 15e3, 20e3, 25e3, 30e3, 40e3, 50e3, 60e3, 80e3, 100e3, 120e3, 150e3,
];

pub fn draw(measured: &Measured, path: &Path) -> anyhow::Result<()> {
    let root = axes::figure(path, 1500)?;
    let root = root.titled(
        "What the instructions of a whole row buy (filled points: no faster method is as accurate)",
        bold(TITLE, BLACK),
    )?;
    let points = (measured.accuracy.situations.iter()).filter_map(|of| {
        let width = SITUATIONS[of.situation].chip_width;
        Some((of, measured.row_instructions(of.method, width)? as f64))
    });
    let mut points: Vec<(&InSituation, f64)> = points.collect();
    let times = || points.iter().map(|(_, time)| *time);
    let range = (
        times().fold(f64::INFINITY, f64::min) * 0.85,
        times().fold(0.0, f64::max) * 1.6,
    );
    points.retain(|(of, _)| measured.accuracy.faults(&of.outcome) <= MOST_FAULTS);
    // Drawn last, the default lies on top.
    points.sort_by_key(|(of, _)| is_default(of.method));
    for (i, area) in root.split_evenly((SITUATIONS.len(), 1)).iter().enumerate() {
        let here = points.iter().filter(|(of, _)| of.situation == i);
        let here: Vec<_> = here.copied().collect();
        draw_situation(area, SITUATIONS[i].name, range, &here)?;
    }
    Ok(root.present()?)
}

fn draw_situation(
    area: &Area<'_>,
    title: &str,
    times: (f64, f64),
    points: &[(&InSituation, f64)],
) -> anyhow::Result<()> {
    let name = "instructions from a row's words to its checked centre on the chip";
    let x = Axis::log(times, name, &INSTRUCTIONS);
    let y = axis_of_ratios(WORST);
    let mut panel = panel(area, title, 20, &x, &y)?;
    let bound = [(times.0, 1.0), (times.1, 1.0)];
    axes::draw_line(&mut panel, bound, BAND.stroke_width(9))?;
    let worth = points.iter().map(|(of, time)| (*time, of.outcome.ratio()));
    let worth: Vec<(f64, f64)> = worth.collect();
    let best = front(&worth, CHANCE);
    let line = best.iter().map(|&i| worth[i]);
    axes::draw_line(&mut panel, line, BOUND.stroke_width(2))?;
    let names = points.iter().zip(&worth).map(|((of, _), &at)| {
        let mut name = Curve::of(of.method, [at].into_iter());
        if at.1 > WORST {
            name.name = format!("{} {:.0}×", name.name, at.1);
        }
        name
    });
    let names: Vec<Curve> = names.collect();
    // The names stand beside the points and above the bound, and the bound's name below it.
    let last = worth.iter().map(|at| panel.backend_coord(at).0).max();
    let (x, y) = panel.backend_coord(&bound[0]);
    write_names(area, &panel, &names, last.unwrap_or(x) + 40, y - 8)?;
    let (left, top) = area.get_base_pixel();
    let (place, style) = ((x - left + 8, y - top + 4), text(TEXT, BOUND));
    area.draw(&Text::new("Cramér-Rao bound", place, style))?;
    for (i, (&at, name)) in worth.iter().zip(&names).enumerate() {
        // On the front: filled.
        axes::draw_dots(&mut panel, [at], 7, WHITE.filled())?;
        match best.contains(&i) {
            true => axes::draw_dots(&mut panel, [at], 7, name.colour.filled())?,
            false => axes::draw_dots(&mut panel, [at], 6, name.colour.stroke_width(2))?,
        }
    }
    Ok(())
}

/// The Pareto front: the places of those points (time, error), in order of time, that no other point of at
/// most the same time beats or equals in error. An error that is smaller by less than the relative `chance`
/// is taken for equal. Points that are not numbers are left out.
fn front(points: &[(f64, f64)], chance: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|&i| points[i].0.is_finite() && points[i].1.is_finite())
        .collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (points[a], points[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < best * (1.0 - chance);
        if better {
            best = points[i].1;
        }
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_faster_beats() {
        let points = [(3.0, 1.1), (1.0, 5.0), (2.0, 5.5), (4.0, 1.0), (5.0, 1.05)];
        assert_eq!(front(&points, 0.0), [1, 0, 3]);
        // A tenth better is chance here: only the first of two remains.
        assert_eq!(front(&points, 0.15), [1, 0]);
    }

    #[test]
    fn the_first_of_a_tie_is_kept_and_nan_is_left_out() {
        let points = [
            (1.0, 2.0),
            (1.0, 1.5),
            (1.0, 1.5),
            (0.5, f64::NAN),
            (2.0, 1.5),
        ];
        assert_eq!(front(&points, 0.0), [1]);
        assert!(front(&[], 0.0).is_empty());
    }
}
