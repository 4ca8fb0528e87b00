//! A panel with two axes whose ticks are chosen by hand.

use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::prelude::*;

use super::style::{GRID, TEXT, TITLE, text};

/// How values lie along an axis.
#[derive(Clone, Copy)]
pub enum Scale {
    /// By their logarithm.
    Log,
    /// Ratios to the bound: by the logarithm of what they are above 0.97, so that 1.00, 1.05 and 1.10 lie apart and 50 is
    /// still there.
    AboveBound,
}

impl Scale {
    /// Where a value lies; equal steps are equal lengths.
    fn place(self, value: f64) -> f64 {
        match self {
            Self::Log => value.ln(),
            Self::AboveBound => (value - 0.97).max(1e-3).ln(),
        }
    }
}

/// An axis.
pub struct Axis<'a> {
    /// How values lie along it.
    pub scale: Scale,
    /// Its ends.
    pub range: (f64, f64),
    /// Its ticks; those outside of the range are not shown.
    pub ticks: &'a [f64],
    /// What it shows, with its unit.
    pub name: &'a str,
    /// A tick's text.
    pub tick: &'a dyn Fn(f64) -> String,
}

/// Ticks of an axis of ratios to the bound.
pub const RATIOS: [f64; 13] = [
    1.0, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0,
];

/// A drawing, or a part of one.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A panel. Values beyond an axis lie at its end.
pub type Panel<'a, 'b> = ChartContext<'b, SVGBackend<'a>, Cartesian2d<Ticked, Ticked>>;

/// An axis as plotters takes it.
pub struct Ticked {
    scale: Scale,
    range: (f64, f64),
    ticks: Vec<f64>,
}

impl Axis<'_> {
    fn ticked(&self) -> Ticked {
        let (from, to) = self.range;
        let shown = |tick: &f64| (from..=to).contains(tick);
        Ticked {
            scale: self.scale,
            range: self.range,
            ticks: self.ticks.iter().copied().filter(shown).collect(),
        }
    }
}

impl Ranged for Ticked {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (first, last): (i32, i32)) -> i32 {
        let (from, to) = (
            self.scale.place(self.range.0),
            self.scale.place(self.range.1),
        );
        let part = (self.scale.place(*value) - from) / (to - from);
        first + (part.clamp(0.0, 1.0) * f64::from(last - first)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range.0..self.range.1
    }
}

/// Draws the axes of a panel, with `right` pixels beside it for labels.
///
/// # Errors
/// The file cannot be written.
pub fn panel<'a, 'b>(
    area: &'b Area<'a>,
    title: &str,
    right: i32,
    x: &Axis<'_>,
    y: &Axis<'_>,
) -> anyhow::Result<Panel<'a, 'b>> {
    let mut chart = ChartBuilder::on(area);
    chart
        .margin_top(8)
        .margin_left(6)
        .margin_bottom(6)
        .margin_right(right)
        .x_label_area_size(TEXT + TITLE + 16)
        .y_label_area_size(4 * TEXT + 8);
    if !title.is_empty() {
        chart.caption(title, text(TITLE, BLACK));
    }
    let mut panel = chart.build_cartesian_2d(x.ticked(), y.ticked())?;
    panel
        .configure_mesh()
        .bold_line_style(GRID)
        .max_light_lines(0)
        .axis_style(BLACK)
        .label_style(text(TEXT, BLACK))
        .axis_desc_style(text(TITLE, BLACK))
        .x_desc(x.name)
        .y_desc(y.name)
        .x_label_formatter(&|value| (x.tick)(*value))
        .y_label_formatter(&|value| (y.tick)(*value))
        .draw()?;
    Ok(panel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_lie_where_the_scale_puts_them() {
        let axis = |scale, range| {
            let axis = Axis {
                scale,
                range,
                ticks: &[0.5, 1.0, 10.0, 1000.0],
                name: "",
                tick: &|value| value.to_string(),
            };
            axis.ticked()
        };
        let log = axis(Scale::Log, (1.0, 100.0));
        // Heights run from the bottom, which has the larger number.
        let heights = [0.1, 1.0, 10.0, 100.0, 1e9].map(|value| log.map(&value, (400, 0)));
        assert_eq!(heights, [400, 400, 200, 0, 0]);
        assert_eq!(log.ticks, [1.0, 10.0]);
        // 0.03, 0.3 and 3 above 0.97.
        let ratios = axis(Scale::AboveBound, (1.0, 3.97));
        assert_eq!(
            [1.0, 1.27, 3.97].map(|value| ratios.map(&value, (0, 200))),
            [0, 100, 200]
        );
    }
}
