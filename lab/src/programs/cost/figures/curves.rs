//! Curves with their names at their right ends.

use cost_on_chip::methods::Method;
use figures::axes::{self, Area, Axis, Panel, Scale, TEXT, panel, text};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::style::{self, RATIOS, bold};
use crate::programs::cost::accuracy::WIDTHS;

#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Measured,
    /// The measurement that the reader looks for first.
    Default,
    /// What would be measured without a limit: a thin line with hollow points.
    Hollow,
    /// The bound: a broad band below the others, so that it shows where one lies on it.
    Bound,
}

#[derive(Clone)]
pub struct Curve {
    /// What stands at its end, if anything.
    pub name: String,
    pub colour: RGBColor,
    pub kind: Kind,
    /// From left to right.
    pub points: Vec<(f64, f64)>,
}

impl Curve {
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

pub fn axis_of_widths() -> Axis<'static> {
    let range = (WIDTHS[0] * 0.95, WIDTHS[WIDTHS.len() - 1] * 1.05);
    Axis::log(range, "width of the spot (σ), px", &WIDTHS)
}

/// The axis of errors over the bound, up to `worst`.
pub fn axis_of_ratios(worst: f64) -> Axis<'static> {
    let (range, name) = ((0.985, worst), "RMS error / bound");
    Axis::new(Scale::AboveBound, range, name, &RATIOS, |it| it.to_string())
}

/// Pixels beside a panel, for the names.
const NAMES: i32 = 190;

/// Draws a panel of curves, and gives it. Values beyond the axis are drawn at its end.
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
        axes::draw_line(&mut panel, curve.points.clone(), colour.stroke_width(width))?;
        let points = curve.points.iter().copied();
        match curve.kind {
            Kind::Bound => {}
            Kind::Hollow => {
                axes::draw_dots(&mut panel, points.clone(), 3, WHITE.filled())?;
                axes::draw_dots(&mut panel, points, 3, colour.stroke_width(1))?;
            }
            _ => axes::draw_dots(&mut panel, points, width + 1, colour.filled())?,
        }
    }
    let (columns, rows) = panel.plotting_area().get_pixel_range();
    write_names(area, &panel, curves, columns.end + 34, rows.end)?;
    Ok(panel)
}

/// Writes the curves' names into a column that begins at a pixel and ends above another one, from top to
/// bottom and apart, with a line to each from its curve's end.
pub fn write_names(
    area: &Area<'_>,
    panel: &Panel<'_, '_>,
    curves: &[Curve],
    column: i32,
    lowest: i32,
) -> anyhow::Result<()> {
    let (_, rows) = panel.plotting_area().get_pixel_range();
    let (left, top) = area.get_base_pixel();
    let mut ends: Vec<(&Curve, (i32, i32))> = curves
        .iter()
        .filter(|curve| !curve.name.is_empty())
        .filter_map(|curve| Some((curve, panel.backend_coord(curve.points.last()?))))
        .collect();
    ends.sort_by_key(|(_, (_, height))| *height);
    let heights = ends.iter().map(|(_, (_, height))| f64::from(*height));
    let range = (f64::from(rows.start) + 12.0, f64::from(lowest) - 4.0);
    let heights = spread(heights, f64::from(TEXT) + 4.0, range);
    for ((curve, (x, y)), height) in ends.into_iter().zip(heights) {
        let (name, height) = (column - left, height as i32 - top);
        let line = [(x - left + 4, y - top), (name - 5, height)];
        area.draw(&PathElement::new(line, curve.colour.stroke_width(1)))?;
        let style = match curve.kind {
            Kind::Default => bold(TEXT, curve.colour),
            _ => text(TEXT, curve.colour),
        };
        let style = style.pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(curve.name.clone(), (name, height), style))?;
    }
    Ok(())
}

/// Moves labels at these heights, which are in ascending order, apart until they are `apart` from one
/// another, within the range, and no further than that takes.
fn spread(heights: impl IntoIterator<Item = f64>, apart: f64, range: (f64, f64)) -> Vec<f64> {
    // Groups of labels that touch lie about the mean of where they want to be.
    struct Group {
        wanted: f64,
        count: f64,
    }
    let top = |group: &Group| {
        let span = (group.count - 1.0) * apart;
        let middle = group.wanted / group.count;
        // The upper end of the range wins where there is no room.
        (middle - span / 2.0).min(range.1 - span).max(range.0)
    };
    let mut groups: Vec<Group> = vec![];
    for height in heights {
        groups.push(Group {
            wanted: height,
            count: 1.0,
        });
        while let [.., upper, lower] = &groups[..] {
            if top(upper) + upper.count * apart <= top(lower) {
                break;
            }
            let (wanted, count) = (upper.wanted + lower.wanted, upper.count + lower.count);
            groups.truncate(groups.len() - 2);
            groups.push(Group { wanted, count });
        }
    }
    let places = groups.iter().flat_map(|group| {
        let first = top(group);
        (0..group.count as usize).map(move |i| first + i as f64 * apart)
    });
    places.collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn heights_spread_no_further_than_they_must() {
        let spread = |heights: &[f64]| super::spread(heights.iter().copied(), 10.0, (0.0, 100.0));
        assert_eq!(spread(&[10.0, 30.0, 31.0, 90.0]), [10.0, 25.5, 35.5, 90.0]);
        assert_eq!(spread(&[95.0, 99.0, 100.0]), [80.0, 90.0, 100.0]);
        assert_eq!(spread(&[1.0, 2.0]), [0.0, 10.0]);
    }
}
