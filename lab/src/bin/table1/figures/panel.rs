//! What the figures have in common: colours, sizes for a figure that is 1000 pixels wide, and a panel with two axes.

use std::ops::Range;

use lab::paper::apparatus::Aperture;
use lab::paper::methods::Method;
use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

/// Ticks and labels.
pub const TEXT: i32 = 19;
/// The names of axes and panels.
pub const TITLE: i32 = 21;
/// Lines of the grid.
pub const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);

/// A drawing, or a part of one.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A panel.
pub type Panel<'a, 'b> =
    ChartContext<'b, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// An axis.
pub struct Axis<'a> {
    /// Its ends.
    pub range: Range<f64>,
    /// What it shows, with its unit.
    pub name: &'a str,
    /// Ticks, about.
    pub ticks: usize,
    /// Digits after a tick's point.
    pub digits: usize,
}

/// A method's colour: those of the paper's fig. 13, dark enough for text on white, and another for ours.
pub fn colour(aperture: Aperture, method: &Method) -> RGBColor {
    match (aperture, method) {
        (Aperture::Lens, _) => RGBColor(0x4f, 0x5d, 0x75),
        (Aperture::Slit, &Method::PAPERS_GAUSSIAN) => RGBColor(0xa8, 0x70, 0x20),
        (Aperture::Slit, &Method::PAPERS_FRAUNHOFER) => RGBColor(0xc8, 0x3a, 0x6a),
        (Aperture::Slit, _) => RGBColor(0x15, 0x55, 0xd0),
    }
}

/// Text in a colour.
pub fn text(size: i32, colour: RGBColor) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&colour)
}

/// Draws the axes of a panel.
///
/// # Errors
/// The file cannot be written.
pub fn panel<'a, 'b>(
    area: &'b Area<'a>,
    title: &str,
    x: &Axis<'_>,
    y: &Axis<'_>,
) -> anyhow::Result<Panel<'a, 'b>> {
    let mut chart = ChartBuilder::on(area);
    chart
        .margin_top(8)
        .margin_left(6)
        .margin_bottom(6)
        .margin_right(24)
        .x_label_area_size(if x.name.is_empty() {
            12
        } else {
            TEXT + TITLE + 16
        })
        .y_label_area_size(4 * TEXT + 8);
    if !title.is_empty() {
        chart.caption(title, text(TITLE, BLACK));
    }
    let mut panel = chart.build_cartesian_2d(x.range.clone(), y.range.clone())?;
    panel
        .configure_mesh()
        .bold_line_style(GRID)
        .max_light_lines(0)
        .axis_style(BLACK)
        .label_style(text(TEXT, BLACK))
        .axis_desc_style(text(TITLE, BLACK))
        .x_desc(x.name)
        .y_desc(y.name)
        .x_labels(x.ticks)
        .y_labels(y.ticks)
        .x_label_formatter(&|value| match x.ticks {
            0 => String::new(),
            _ => format!("{value:.0$}", x.digits),
        })
        .y_label_formatter(&|value| format!("{value:.0$}", y.digits))
        .draw()?;
    Ok(panel)
}
