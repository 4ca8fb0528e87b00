//! The picture of a front end: how the noise grows with the light, and the light with the exposure.

use std::path::Path;

use anyhow::{Context as _, Result};
use figures::axes::{self, Area, Axis, Scale, TEXT, text};
use figures::dark::{BLUE as MEASURED, GREY as LEVEL, RED as FIT};
use plotters::prelude::*;
use slitrange::row::front_end::FrontEnd;

use super::bench::Taken;
use crate::photon_transfer::{Point, Transfer};
use crate::record_file::ShownFrontEnd;

const HEIGHTS: [u32; 2] = [460, 380];
/// Points of neighbouring signals are drawn as one: so many to a factor of ten.
const A_DECADE: f64 = 12.0;
/// The least signal that is drawn, in counts.
const LEAST: f64 = 10.0;

/// Draws both panels.
pub fn draw(taken: &Taken, front_end: &FrontEnd, path: &Path) -> Result<()> {
    let root = axes::figure(path, HEIGHTS[0] + HEIGHTS[1])?;
    let (above, below) = root.split_vertically(HEIGHTS[0]);
    draw_noise(&above, &taken.photons, front_end)?;
    draw_light(&below, taken)?;
    root.present()
        .with_context(|| format!("{} cannot be written", path.display()))
}

/// The variance over the signal, both by their logarithm.
fn draw_noise(area: &Area<'_>, transfer: &Transfer, front_end: &FrontEnd) -> Result<()> {
    let points = together(&transfer.points);
    let line = &transfer.line;
    let signals = points.iter().map(|it| it.signal);
    let highest = 1.2 * signals.fold(2.0 * LEAST, f64::max);
    let lowest = 0.7 * line.at(LEAST).min(line.dark);
    let variances = points.iter().map(|it| it.variance);
    let top = 1.4 * variances.fold(line.at(highest), f64::max);
    let decade = |power| [1.0, 2.0, 5.0].map(|digit| digit * 10f64.powi(power));
    let ticks: Vec<f64> = (-1..5).flat_map(decade).collect();
    let tick = |value: f64| format!("{value}");
    let [gain, u] = ShownFrontEnd::of(front_end).gain_electrons;
    let title = format!("noise over light: {gain:.2} electrons a count, u {u:.2}");
    let name = "light above the dark, counts";
    let x = Axis::new(Scale::Log, (LEAST, highest), name, &ticks, tick);
    let y = Axis::new(Scale::Log, (lowest, top), "variance, counts²", &ticks, tick);
    let mut panel = axes::panel(area, &title, 30, &x, &y)?;
    let dark = vec![(LEAST, line.dark), (highest, line.dark)];
    axes::draw_line(&mut panel, dark, LEVEL.stroke_width(1))?;
    let signal = |part| LEAST * (highest / LEAST).powf(f64::from(part) / 100.0);
    let curve = (0..=100).map(signal).map(|it| (it, line.at(it)));
    axes::draw_line(&mut panel, curve, FIT.stroke_width(2))?;
    panel.draw_series(points.iter().map(|point| {
        // Two standard deviations to both sides.
        let part = 2.0 * (2.0 / point.freedom).sqrt();
        let ends = [1.0 - part.min(0.9), 1.0 + part].map(|it| (point.signal, it * point.variance));
        PathElement::new(ends.to_vec(), MEASURED.stroke_width(1))
    }))?;
    let places = points.iter().map(|point| (point.signal, point.variance));
    axes::draw_dots(&mut panel, places, 3, MEASURED.filled())?;
    let (x, y) = panel.backend_coord(&(highest, line.dark));
    let words = "noise with the laser off";
    area.draw(&Text::new(words, (x - 190, y + 4), text(TEXT - 3, LEVEL)))?;
    Ok(())
}

fn draw_light(area: &Area<'_>, taken: &Taken) -> Result<()> {
    let mut heights: Vec<(f64, f64)> = (taken.heights.iter())
        .map(|&(us, height)| (f64::from(us), height))
        .collect();
    heights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let longest = heights.last().map_or(1.0, |it| it.0) * 1.05;
    let saturated = taken.saturation.map(|[level, _]| level - taken.dark_level);
    let highest = heights.iter().map(|it| it.1);
    let top = 1.12 * highest.fold(saturated.unwrap_or(0.0), f64::max);
    let x = Axis::linear((0.0, longest), "exposure, us", 8, 0);
    let y = Axis::linear((0.0, top), "counts above the dark", 6, 0);
    let mut panel = axes::panel(area, "top of the spot", 30, &x, &y)?;
    if let Some(level) = saturated {
        let line = vec![(0.0, level), (longest, level)];
        axes::draw_line(&mut panel, line, LEVEL.stroke_width(1))?;
        let (x, y) = panel.backend_coord(&(0.0, level));
        // The panel's coordinates are those of the whole figure, and the text's are those of the area.
        let y = y - area.get_pixel_range().1.start;
        let style = text(TEXT - 3, LEVEL);
        area.draw(&Text::new("saturated", (x + 8, y - 22), style))?;
    }
    axes::draw_line(&mut panel, heights.clone(), MEASURED.stroke_width(1))?;
    axes::draw_dots(&mut panel, heights, 3, MEASURED.filled())
}

/// The means of points whose signals are alike, weighed by their degrees of freedom.
fn together(points: &[Point]) -> Vec<Point> {
    let mut bins: Vec<Point> = vec![];
    for point in points.iter().filter(|point| point.signal >= LEAST) {
        let bin = ((point.signal / LEAST).log10() * A_DECADE) as usize;
        if bins.len() <= bin {
            bins.resize(bin + 1, Point::default());
        }
        let all = &mut bins[bin];
        all.signal += point.freedom * point.signal;
        all.variance += point.freedom * point.variance;
        all.freedom += point.freedom;
    }
    let mean = |bin: Point| Point {
        signal: bin.signal / bin.freedom,
        variance: bin.variance / bin.freedom,
        ..bin
    };
    bins.retain(|bin| bin.freedom > 0.0);
    bins.into_iter().map(mean).collect()
}
