//! Error and exposure over the target's reflectivity.

use std::path::Path;

use anyhow::Result;
use figures::axes::{self, Area, Axis, Panel, Scale, TEXT, panel, text};
use figures::dark::{BLUE as AUTO, GREEN as BEST, GREY, ORANGE as LONGEST};
use judges::changing_light::range::Target;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::programs::exposure::NAMED;

/// Room for the lines' names beside the panels, in pixels.
const BESIDE: i32 = 230;

/// Pixels from one name to the next one.
const LINE: i32 = TEXT + 8;

type Points = Vec<(f64, f64)>;

/// Draws both panels.
pub fn draw(targets: &[Target], path: &Path) -> Result<()> {
    let root = axes::figure(path, 840)?;
    let (errors, exposures) = root.split_vertically(410);
    draw_errors(targets, &root, &errors)?;
    draw_exposures(targets, &root, &exposures)?;
    root.present()?;
    Ok(())
}

fn reflectivities(name: &str) -> Axis<'_> {
    let powers = [1e-4, 1e-3, 1e-2, 0.1, 1.0];
    Axis::new(Scale::Log, (1e-4, 1.0), name, &powers, |power| {
        power.to_string()
    })
}

fn points(targets: &[Target], of: impl Fn(&Target) -> Option<f64>) -> Points {
    let point = |target: &Target| Some((target.reflectivity, of(target)?));
    targets.iter().filter_map(point).collect()
}

fn draw_errors(targets: &[Target], root: &Area<'_>, area: &Area<'_>) -> Result<()> {
    let ticks = [1.0, 2.0, 5.0, 10.0, 20.0];
    let name = "RMS error at 0.8 m, um";
    let y = Axis::new(Scale::Log, (0.8, 20.0), name, &ticks, |um| um.to_string());
    let x = reflectivities("");
    let mut chart = panel(area, "", BESIDE, &x, &y)?;
    mark_targets(&mut chart)?;
    name_targets(root, &chart, 20.0)?;
    let longest = points(targets, |it| Some(it.longest?.rms_um));
    let low = points(targets, |it| Some(it.auto_lowest.rms_um));
    let best = points(targets, |it| Some(it.best.rms_um));
    let auto = points(targets, |it| Some(it.auto.rms_um));
    chart.draw_series(LineSeries::new(longest.clone(), LONGEST.stroke_width(9)))?;
    let broken = DashedLineSeries::new(low, 6, 5, AUTO.stroke_width(2));
    chart.draw_series(broken)?;
    chart.draw_series(LineSeries::new(best, BEST.stroke_width(2)))?;
    draw_with_dots(&mut chart, &auto)?;
    let lines = [
        ("auto exposure", AUTO),
        ("broken: low spot", AUTO),
        ("best fixed exposure", BEST),
        ("wide: fixed 5600 us,", LONGEST),
        ("faults beyond its end", LONGEST),
    ];
    name_lines(root, &chart, &lines)
}

fn draw_exposures(targets: &[Target], root: &Area<'_>, area: &Area<'_>) -> Result<()> {
    let ticks = [10.0, 100.0, 1000.0, 5600.0];
    let y = Axis::new(Scale::Log, (7.0, 12000.0), "exposure, us", &ticks, |us| {
        us.to_string()
    });
    let x = reflectivities("reflectivity (bright metal = 1)");
    let mut chart = panel(area, "", BESIDE, &x, &y)?;
    mark_targets(&mut chart)?;
    let best = points(targets, |it| Some(it.best.exposure_us.into()));
    let auto = points(targets, |it| Some(it.auto.exposure_us.into()));
    let low = points(targets, |it| Some(it.auto_lowest.exposure_us.into()));
    let broken = DashedLineSeries::new(low, 6, 5, AUTO.stroke_width(2));
    chart.draw_series(broken)?;
    chart.draw_series(LineSeries::new(best, BEST.stroke_width(2)))?;
    draw_with_dots(&mut chart, &auto)?;
    let lines = [
        ("auto exposure", AUTO),
        ("broken: low spot", AUTO),
        ("best fixed exposure", BEST),
    ];
    name_lines(root, &chart, &lines)
}

fn draw_with_dots(chart: &mut Panel<'_, '_>, points: &Points) -> Result<()> {
    chart.draw_series(LineSeries::new(points.clone(), AUTO.stroke_width(2)))?;
    let dots = points.iter().map(|&at| Circle::new(at, 3, AUTO.filled()));
    chart.draw_series(dots)?;
    Ok(())
}

/// Draws a line at each target that has a name.
fn mark_targets(chart: &mut Panel<'_, '_>) -> Result<()> {
    for (_, reflectivity) in NAMED {
        let ends = [(reflectivity, 1e-9), (reflectivity, 1e9)];
        chart.draw_series(LineSeries::new(ends, GREY.stroke_width(1)))?;
    }
    Ok(())
}

/// Writes the names of targets below the panel's `top`.
fn name_targets(root: &Area<'_>, chart: &Panel<'_, '_>, top: f64) -> Result<()> {
    for (name, reflectivity) in NAMED {
        let (x, y) = chart.backend_coord(&(reflectivity, top));
        // The name of the last target is to the left of its line, so that it stays in the panel.
        let (x, side) = match reflectivity {
            1.0 => (x - 6, HPos::Right),
            _ => (x + 6, HPos::Left),
        };
        let style = text(TEXT, BLACK).pos(Pos::new(side, VPos::Top));
        root.draw(&Text::new(name, (x, y + 6), style))?;
    }
    Ok(())
}

/// Writes the lines' names beside the panel.
fn name_lines(
    root: &Area<'_>,
    chart: &Panel<'_, '_>,
    lines: &[(&'static str, RGBColor)],
) -> Result<()> {
    let (x, y) = chart.plotting_area().get_pixel_range();
    for ((name, colour), number) in lines.iter().zip(0..) {
        let at = (x.end + 14, y.start + LINE * number);
        root.draw(&Text::new(*name, at, text(TEXT, *colour)))?;
    }
    Ok(())
}
