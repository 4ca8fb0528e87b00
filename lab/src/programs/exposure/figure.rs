//! Error and exposure over the target's reflectivity.

use figures::axes::{self, Area, Axis, Panel, TEXT, panel, text};
use figures::dark::{BLUE as AUTO, GREEN as BEST, GREY, ORANGE as LONGEST};
use judges::changing_light::range::{Frames, Target};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::prelude::*;
use crate::programs::exposure::NAMED;

/// Room for the lines' names beside the panels, in pixels.
const BESIDE: i32 = 230;

/// Pixels from one name to the next one.
const LINE: i32 = TEXT + 8;

type Points = Vec<(f64, f64)>;

pub fn draw(targets: &[Target], path: &Path) -> Result<()> {
    let root = axes::figure(path, 840)?;
    let (errors, exposures) = root.split_vertically(410);
    draw_errors(targets, &root, &errors)?;
    draw_exposures(targets, &root, &exposures)?;
    Ok(root.present()?)
}

fn reflectivities(name: &str) -> Axis<'_> {
    Axis::log((1e-4, 1.0), name, &[1e-4, 1e-3, 1e-2, 0.1, 1.0])
}

fn points(targets: &[Target], of: impl Fn(&Target) -> Option<f64>) -> Points {
    let point = |target: &Target| Some((target.reflectivity, of(target)?));
    targets.iter().filter_map(point).collect()
}

fn draw_errors(targets: &[Target], root: &Area<'_>, area: &Area<'_>) -> Result<()> {
    let ticks = [1.0, 2.0, 5.0, 10.0, 20.0];
    let y = Axis::log((0.8, 20.0), "RMS error at 0.8 m, um", &ticks);
    let mut chart = panel(area, "", BESIDE, &reflectivities(""), &y)?;
    mark_targets(&mut chart)?;
    name_targets(root, &chart, 20.0)?;
    let longest = points(targets, |it| Some(it.longest?.rms_um));
    chart.draw_series(LineSeries::new(longest, LONGEST.stroke_width(9)))?;
    let further = [
        ("wide: fixed 5600 us,", LONGEST),
        ("faults beyond its end", LONGEST),
    ];
    draw_lines(targets, root, &mut chart, |it| it.rms_um, &further)
}

fn draw_exposures(targets: &[Target], root: &Area<'_>, area: &Area<'_>) -> Result<()> {
    let ticks = [10.0, 100.0, 1000.0, 5600.0];
    let y = Axis::log((7.0, 12000.0), "exposure, us", &ticks);
    let x = reflectivities("reflectivity (bright metal = 1)");
    let mut chart = panel(area, "", BESIDE, &x, &y)?;
    mark_targets(&mut chart)?;
    draw_lines(targets, root, &mut chart, |it| it.exposure_us.into(), &[])
}

/// Draws what came of auto exposure, of a low spot and of the best fixed exposure, and names these lines and
/// further ones beside the panel.
fn draw_lines(
    targets: &[Target],
    root: &Area<'_>,
    chart: &mut Panel<'_, '_>,
    of: fn(&Frames) -> f64,
    further: &[(&'static str, RGBColor)],
) -> Result<()> {
    let low = points(targets, |it| Some(of(&it.auto_lowest)));
    let best = points(targets, |it| Some(of(&it.best)));
    let auto = points(targets, |it| Some(of(&it.auto)));
    chart.draw_series(DashedLineSeries::new(low, 6, 5, AUTO.stroke_width(2)))?;
    chart.draw_series(LineSeries::new(best, BEST.stroke_width(2)))?;
    chart.draw_series(LineSeries::new(auto.clone(), AUTO.stroke_width(2)))?;
    chart.draw_series(auto.into_iter().map(|at| Circle::new(at, 3, AUTO.filled())))?;
    let lines = [
        ("auto exposure", AUTO),
        ("broken: low spot", AUTO),
        ("best fixed exposure", BEST),
    ];
    let (x, y) = chart.plotting_area().get_pixel_range();
    for ((name, colour), number) in lines.iter().chain(further).zip(0..) {
        let at = (x.end + 14, y.start + LINE * number);
        root.draw(&Text::new(*name, at, text(TEXT, *colour)))?;
    }
    Ok(())
}

fn mark_targets(chart: &mut Panel<'_, '_>) -> Result<()> {
    for (_, reflectivity) in NAMED {
        let ends = [(reflectivity, 1e-9), (reflectivity, 1e9)];
        chart.draw_series(LineSeries::new(ends, GREY.stroke_width(1)))?;
    }
    Ok(())
}

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
