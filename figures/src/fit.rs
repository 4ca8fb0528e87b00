//! The fit and its residuals, as in the paper's figs. 12a and 12b.

use std::ops::Range;
use std::path::Path;

use calibration::fit::comb::{FittedComb, FittedSlit};
use calibration::fit::curve::Curve;
use calibration::fit::solve::{Form, Solved};
use calibration::points::Point;
use plotters::prelude::*;

use crate::axes::{self, Area, Axis, Panel};
use crate::dark::{BLUE as USED, RED as REJECTED};

/// Height of the panel with the curve, and of each with residuals.
const UPPER: u32 = 520;
const LOWER: u32 = 330;

/// Draws the points and the curve above, what eq. (1) leaves below, and where it is corrected what that
/// leaves, too. Below that, the corrections of a comb's slits.
pub fn draw(
    solved: &Solved,
    form: Form,
    comb: Option<&FittedComb>,
    path: &Path,
) -> anyhow::Result<()> {
    let corrected = solved.corrected.as_ref().map(|(curve, _)| curve);
    let corrected = corrected.filter(|_| form != Form::Eq1);
    let of_curve = UPPER + LOWER * if corrected.is_some() { 2 } else { 1 };
    let height = of_curve + LOWER * if comb.is_some() { 1 } else { 0 };
    let root = axes::figure(path, height)?;
    let (upper, of_comb) = root.split_vertically(of_curve);
    if let Some(comb) = comb {
        draw_comb(&of_comb, comb)?;
    }
    let (above, below) = upper.split_vertically(UPPER);
    let plain = &solved.plain;
    let (first, last) = plain.eq1.valid;
    let all = solved.points.iter().map(|point| point.x_px);
    let (least, most) = least_and_most(all.chain([first, last]));
    let room = 0.04 * (most - least);
    let centres = least - room..most + room;
    draw_curve(&above, solved, corrected.unwrap_or(plain), centres.clone())?;
    match corrected {
        None => draw_residuals(&below, solved, plain, None, "residuals of eq. (1)", centres)?,
        Some(curve) => {
            let (middle, lowest) = below.split_vertically(LOWER);
            let line = Some(curve);
            let title = "residuals of eq. (1) alone, and the curve that is added to it";
            draw_residuals(&middle, solved, plain, line, title, centres.clone())?;
            draw_residuals(&lowest, solved, curve, None, "what is left", centres)?;
        }
    }
    Ok(root.present()?)
}

fn draw_curve(
    area: &Area<'_>,
    solved: &Solved,
    curve: &Curve,
    centres: Range<f64>,
) -> anyhow::Result<()> {
    let mm = |centre| 1e3 * curve.distance(centre);
    let (near, far) = around(curve.even_steps(1).map(mm), 0.06);
    let rejected = solved.verdicts.iter().filter(|verdict| !verdict.kept);
    let title = format!("{} points and their fit", solved.points.len());
    let title = match rejected.count() {
        0 => title,
        rejected => format!("{title} ({rejected} rejected, red)"),
    };
    let mut panel = panel(area, &title, centres, near..far, "distance, mm")?;
    let line = curve.even_steps(200).map(|centre| (centre, mm(centre)));
    axes::draw_line(&mut panel, line, BLACK.stroke_width(2))?;
    draw_points(&mut panel, solved, near..far, |point| point.d_mm)?;

    // The words stand where a falling or a rising curve leaves room.
    let eq1 = curve.eq1.curve;
    let left = if eq1.k > 0.0 { 640 } else { 130 };
    let lines = [
        "d = D + K/(x − xp)",
        &format!("D = {:.3} mm", eq1.d * 1e3),
        &format!("K = {:.0} mm px", eq1.k * 1e3),
        &format!("xp = {:.2} px", eq1.pole),
    ];
    axes::write_lines(area, (left, 60), &lines)
}

/// What a curve leaves of the points, and another curve less the first.
fn draw_residuals(
    area: &Area<'_>,
    solved: &Solved,
    curve: &Curve,
    line: Option<&Curve>,
    title: &str,
    centres: Range<f64>,
) -> anyhow::Result<()> {
    let residual = |point: &Point| 1e3 * point.d_mm - 1e6 * curve.distance(point.x_px);
    let all = solved.points.iter().zip(&solved.verdicts);
    let kept = all.filter(|(_, verdict)| verdict.kept);
    let (low, high) = around(kept.map(|(point, _)| residual(point)).chain([0.0]), 0.15);
    let mut panel = panel(area, title, centres.clone(), low..high, "residual, um")?;
    let zero = [(centres.start, 0.0), (centres.end, 0.0)];
    axes::draw_line(&mut panel, zero, BLACK.stroke_width(1))?;
    if let Some(other) = line {
        let um = |centre| 1e6 * (other.distance(centre) - curve.distance(centre));
        let line = other.even_steps(400).map(|centre| (centre, um(centre)));
        axes::draw_line(&mut panel, line, BLACK.stroke_width(2))?;
    }
    draw_points(&mut panel, solved, low..high, residual)
}

/// Each slit's correction in the middle of the points, with its residual to both sides.
fn draw_comb(area: &Area<'_>, comb: &FittedComb) -> anyhow::Result<()> {
    let slits = || comb.slits.iter().filter(|slit| slit.points > 0);
    let ends = |it: &FittedSlit| [-1.0, 1.0].map(|sign| it.correction_px + sign * it.residual_px);
    let (low, high) = around(slits().flat_map(ends).chain([0.0]), 0.15);
    let (left, right) = around(slits().map(|slit| 1e-3 * slit.place_um), 0.04);
    let digits = (2.0 - (high - low).log10()).clamp(0.0, 4.0) as usize;
    let title = format!(
        "corrections of {} slits in the middle, and the residuals of each",
        comb.slits.len()
    );
    let x = Axis::linear((left, right), "place on the mask, mm", 10, 0);
    let y = Axis::linear((low, high), "correction, px", 6, digits);
    let mut panel = axes::panel(area, &title, 30, &x, &y)?;
    let zero = [(left, 0.0), (right, 0.0)];
    axes::draw_line(&mut panel, zero, BLACK.stroke_width(1))?;
    panel.draw_series(slits().map(|slit| {
        let line = ends(slit).map(|y| (1e-3 * slit.place_um, y)).to_vec();
        PathElement::new(line, USED.stroke_width(2))
    }))?;
    let places = slits().map(|slit| (1e-3 * slit.place_um, slit.correction_px));
    axes::draw_dots(&mut panel, places, 4, USED.filled())
}

/// Points that count as dots, rejected ones as crosses; those beyond the axis lie near its end.
fn draw_points(
    panel: &mut Panel<'_, '_>,
    solved: &Solved,
    heights: Range<f64>,
    height: impl Fn(&Point) -> f64,
) -> anyhow::Result<()> {
    let radius = if solved.points.len() > 300 { 2 } else { 4 };
    let edge = 0.03 * (heights.end - heights.start);
    let (low, high) = (heights.start + edge, heights.end - edge);
    // Where there is none, on the pole, at the lower end.
    let at = |point: &Point| (point.x_px, height(point).max(low).min(high));
    let all = || solved.points.iter().zip(&solved.verdicts);
    let kept = all().filter(|(_, verdict)| verdict.kept);
    let dots = kept.map(|(point, _)| at(point));
    axes::draw_dots(panel, dots, radius, USED.filled())?;
    let rejected = all().filter(|(_, verdict)| !verdict.kept);
    let cross = |point| Cross::new(at(point), radius + 2, REJECTED.stroke_width(2));
    panel.draw_series(rejected.map(|(point, _)| cross(point)))?;
    Ok(())
}

fn least_and_most(numbers: impl Iterator<Item = f64>) -> (f64, f64) {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    numbers.fold(none, |(least, most), x| (least.min(x), most.max(x)))
}

/// The least and the largest of numbers, with room for a part of their difference on either side.
fn around(numbers: impl Iterator<Item = f64>, part: f64) -> (f64, f64) {
    let (least, most) = least_and_most(numbers);
    // What is no wider than rounding gets an axis nevertheless.
    let room = (part * (most - least)).max(0.001);
    (least - room, most + room)
}

/// The axes of a panel over the centres.
fn panel<'a, 'b>(
    area: &'b Area<'a>,
    title: &str,
    centres: Range<f64>,
    heights: Range<f64>,
    name: &str,
) -> anyhow::Result<Panel<'a, 'b>> {
    let axis = |range: Range<f64>, name, ticks| {
        // Two digits more than the range's first.
        let digits = (2.0 - (range.end - range.start).log10()).clamp(0.0, 4.0) as usize;
        Axis::linear((range.start, range.end), name, ticks, digits)
    };
    let (x, y) = (axis(centres, "centre, px", 10), axis(heights, name, 6));
    axes::panel(area, title, 30, &x, &y)
}
