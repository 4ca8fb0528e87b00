//! Curves with their names at their right ends.

use cost_on_chip::methods::Method;
use figures::axes::{self, Area, Axis, Panel, Scale, TEXT, panel, text};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::labels::spread;
use super::style::{self, RATIOS, bold};
use crate::programs::cost::accuracy::WIDTHS;

/// What a curve shows.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Something measured.
    Measured,
    /// The measurement that the reader looks for first.
    Default,
    /// What would be measured without a limit: a thin line with hollow points.
    Hollow,
    /// The bound: a broad band below the others, so that it shows where one lies on it.
    Bound,
}

/// A curve.
#[derive(Clone)]
pub struct Curve {
    /// What stands at its end, if anything.
    pub name: String,
    /// Of the line and of the name.
    pub colour: RGBColor,
    /// How it is drawn.
    pub kind: Kind,
    /// From left to right.
    pub points: Vec<(f64, f64)>,
}

impl Curve {
    /// Of the bound.
    pub fn bound(name: &str, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            colour: style::BOUND,
            kind: Kind::Bound,
            points,
        }
    }

    /// Of a method; values that are no numbers are left out.
    pub fn of(method: Method, points: impl Iterator<Item = (f64, f64)>) -> Self {
        Self {
            name: method.name().into(),
            colour: style::colour(method),
            kind: match style::is_default(method) {
                true => Kind::Default,
                false => Kind::Measured,
            },
            points: points.filter(|(_, y)| y.is_finite()).collect(),
        }
    }
}

/// The axis of the spot's width.
pub fn axis_of_widths() -> Axis<'static> {
    let range = (WIDTHS[0] * 0.95, WIDTHS[WIDTHS.len() - 1] * 1.05);
    let name = "width of the spot (σ), px";
    Axis::new(Scale::Log, range, name, &WIDTHS, |value| value.to_string())
}

/// The axis of errors over the bound, up to `worst`.
pub fn axis_of_ratios(worst: f64) -> Axis<'static> {
    let range = (0.985, worst);
    Axis::new(
        Scale::AboveBound,
        range,
        "RMS error / bound",
        &RATIOS,
        |value| value.to_string(),
    )
}

/// Pixels beside the panel, for the names.
const NAMES: i32 = 190;

/// Draws a panel of curves, and gives it. Values beyond the axis are drawn at its end.
///
/// # Errors
/// The file cannot be written.
pub fn draw_curves<'a, 'b>(
    area: &'b Area<'a>,
    title: &str,
    x: &Axis<'_>,
    y: &Axis<'_>,
    curves: &[Curve],
) -> anyhow::Result<Panel<'a, 'b>> {
    let mut panel = panel(area, title, NAMES, x, y)?;
    for curve in curves {
        let (width, colour) = match curve.kind {
            Kind::Measured => (2, curve.colour),
            Kind::Hollow => (1, curve.colour),
            Kind::Default => (4, curve.colour),
            Kind::Bound => (9, style::BAND),
        };
        let line = curve.points.clone();
        axes::draw_line(&mut panel, line, colour.stroke_width(width))?;
        let points = curve.points.iter();
        match curve.kind {
            Kind::Bound => {}
            Kind::Hollow => {
                axes::draw_dots(&mut panel, points.clone().copied(), 3, WHITE.filled())?;
                axes::draw_dots(&mut panel, points.copied(), 3, colour.stroke_width(1))?;
            }
            _ => {
                axes::draw_dots(&mut panel, points.copied(), width + 1, colour.filled())?;
            }
        }
    }

    // Names from top to bottom, apart, and a line to each from its curve's end.
    let (columns, rows) = panel.plotting_area().get_pixel_range();
    let (left, top) = area.get_base_pixel();
    let mut ends: Vec<(&Curve, (i32, i32))> = curves
        .iter()
        .filter(|curve| !curve.name.is_empty())
        .filter_map(|curve| Some((curve, panel.backend_coord(curve.points.last()?))))
        .collect();
    ends.sort_by_key(|(_, (_, height))| *height);
    let heights: Vec<f64> = ends
        .iter()
        .map(|(_, (_, height))| f64::from(*height))
        .collect();
    let range = (f64::from(rows.start) + 4.0, f64::from(rows.end) - 4.0);
    let heights = spread(&heights, f64::from(TEXT) + 4.0, range);
    for ((curve, (x, y)), height) in ends.into_iter().zip(heights) {
        let name = columns.end - left + 34;
        area.draw(&PathElement::new(
            [(x - left + 4, y - top), (name - 5, height as i32 - top)],
            curve.colour.stroke_width(1),
        ))?;
        let style = match curve.kind {
            Kind::Default => bold(TEXT, curve.colour),
            _ => text(TEXT, curve.colour),
        };
        area.draw(&Text::new(
            curve.name.clone(),
            (name, height as i32 - top),
            style.pos(Pos::new(HPos::Left, VPos::Center)),
        ))?;
    }
    Ok(panel)
}
