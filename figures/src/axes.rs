//! A figure's panel with two axes: how every figure of this project looks. Sizes are in pixels of a figure
//! that is 1000 wide. What draws fails if the file cannot be written.

mod figure;

use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

pub use figure::{FINE, Figure, draw_broken_line, draw_dots, draw_line, figure};

/// Size of ticks and labels.
pub const TEXT: i32 = 19;
/// Size of the names of axes and panels.
pub const TITLE: i32 = 21;
/// Colour of the grid's lines.
pub const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);

/// Text in a colour.
pub fn text(size: i32, colour: RGBColor) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&colour)
}

/// Writes lines below each other, from the upper left corner `at` of the first one.
pub fn write_lines(area: &Area<'_>, at: (i32, i32), lines: &[&str]) -> anyhow::Result<()> {
    for (line, number) in lines.iter().zip(0..) {
        let place = (at.0, at.1 + 26 * number);
        area.draw(&Text::new(*line, place, text(TEXT, BLACK)))?;
    }
    Ok(())
}

/// How values lie along an axis.
#[derive(Clone, Copy)]
pub enum Scale {
    /// By their size.
    Linear,
    /// By their logarithm. Values beyond the axis lie at its end.
    Log,
    /// Ratios to the bound: by the logarithm of what they are above 0.97, so that 1.00, 1.05 and 1.10 lie
    /// apart and 50 is still there. Values beyond the axis lie at its end.
    AboveBound,
}

impl Scale {
    /// Where a value lies; equal steps are equal lengths.
    fn place(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Log => value.ln(),
            Self::AboveBound => (value - 0.97).max(1e-3).ln(),
        }
    }
}

/// An axis.
pub struct Axis<'a> {
    ticked: Ticked,
    name: &'a str,
    tick: Box<dyn Fn(f64) -> String + 'a>,
}

impl<'a> Axis<'a> {
    /// An axis with ticks at given values; those outside of the range are left out. `name` is what it shows,
    /// with its unit, and `tick` is a tick's text.
    pub fn new(
        scale: Scale,
        range: (f64, f64),
        name: &'a str,
        ticks: &[f64],
        tick: impl Fn(f64) -> String + 'a,
    ) -> Self {
        let shown = |tick: &f64| (range.0..=range.1).contains(tick);
        let ticked = Ticked {
            scale,
            range,
            ticks: ticks.iter().copied().filter(shown).collect(),
        };
        Self {
            ticked,
            name,
            tick: Box::new(tick),
        }
    }

    /// A logarithmic axis with ticks at given values, which are written as they are.
    pub fn log(range: (f64, f64), name: &'a str, ticks: &[f64]) -> Self {
        Self::new(Scale::Log, range, name, ticks, |value| value.to_string())
    }

    /// A linear axis with about so many ticks at round values, and so many digits after their points.
    pub fn linear(range: (f64, f64), name: &'a str, ticks: usize, digits: usize) -> Self {
        let places = RangedCoordf64::from(range.0..range.1).key_points(ticks);
        let tick = move |value| format!("{value:.digits$}");
        Self::new(Scale::Linear, range, name, &places, tick)
    }
}

/// A drawing, or a part of one.
pub type Area<'a> = DrawingArea<Figure<'a>, Shift>;
/// A panel.
pub type Panel<'a, 'b> = ChartContext<'b, Figure<'a>, Cartesian2d<Ticked, Ticked>>;

/// An axis as plotters takes it.
#[derive(Clone)]
pub struct Ticked {
    scale: Scale,
    range: (f64, f64),
    ticks: Vec<f64>,
}

impl Ticked {
    /// Where a value lies between the first and the last pixel.
    fn place(&self, value: f64, (first, last): (i32, i32)) -> f64 {
        let [from, to, at] = [self.range.0, self.range.1, value].map(|it| self.scale.place(it));
        let part = (at - from) / (to - from);
        let part = match self.scale {
            Scale::Linear => part,
            Scale::Log | Scale::AboveBound => part.clamp(0.0, 1.0),
        };
        f64::from(first) + part * f64::from(last - first)
    }
}

impl Ranged for Ticked {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, ends: (i32, i32)) -> i32 {
        self.place(*value, ends).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range.0..self.range.1
    }
}

/// Draws the axes of a panel, with `right` pixels beside it. Without a name the x axis has no ticks' texts.
pub fn panel<'a, 'b>(
    area: &'b Area<'a>,
    title: &str,
    right: i32,
    x: &Axis<'_>,
    y: &Axis<'_>,
) -> anyhow::Result<Panel<'a, 'b>> {
    let below = match x.name {
        "" => 12,
        _ => TEXT + TITLE + 16,
    };
    let mut chart = ChartBuilder::on(area);
    chart
        .margin_top(8)
        .margin_left(6)
        .margin_bottom(6)
        .margin_right(right)
        .x_label_area_size(below)
        .y_label_area_size(4 * TEXT + 8);
    if !title.is_empty() {
        chart.caption(title, text(TITLE, BLACK));
    }
    let mut panel = chart.build_cartesian_2d(x.ticked.clone(), y.ticked.clone())?;
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
            let ticks = [0.5, 1.0, 10.0, 1000.0];
            Axis::new(scale, range, "", &ticks, |value| value.to_string()).ticked
        };
        let log = axis(Scale::Log, (1.0, 100.0));
        // Heights run from the bottom, which has the larger number.
        let heights = [0.1, 1.0, 10.0, 100.0, 1e9].map(|value| log.map(&value, (400, 0)));
        assert_eq!(heights, [400, 400, 200, 0, 0]);
        assert_eq!(log.ticks, [1.0, 10.0]);
        // 0.03, 0.3 and 3 above 0.97.
        let ratios = axis(Scale::AboveBound, (1.0, 3.97));
        let places = [1.0, 1.27, 3.97].map(|value| ratios.map(&value, (0, 200)));
        assert_eq!(places, [0, 100, 200]);
        // Beyond a linear axis too.
        let linear = axis(Scale::Linear, (0.0, 10.0));
        let places = [0.0, 5.0, 12.0].map(|value| linear.map(&value, (0, 200)));
        assert_eq!(places, [0, 100, 240]);
        assert_eq!(Axis::linear((0.0, 10.0), "", 6, 0).ticked.ticks.len(), 6);
    }
}
