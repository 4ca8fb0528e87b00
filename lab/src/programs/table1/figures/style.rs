//! The colours of the methods, and the space beside a panel.

use figures::axes::{self, GRID, Panel};
use figures::dark::BLUE;
use plotters::prelude::*;

use crate::paper::methods::Method;

/// Pixels beside a panel.
pub const RIGHT: i32 = 24;

/// A method's colour: those of the paper's fig. 13, dark enough for text on white, and another for ours.
pub const fn colour(method: Method) -> RGBColor {
    match method {
        Method::PlaneGaussian => RGBColor(0x4f, 0x5d, 0x75),
        Method::Gaussian => RGBColor(0xa8, 0x70, 0x20),
        Method::Fraunhofer => RGBColor(0xc8, 0x3a, 0x6a),
        Method::Ours => BLUE,
    }
}

pub fn draw_zero(panel: &mut Panel<'_, '_>, (from, to): (f64, f64)) -> anyhow::Result<()> {
    axes::draw_line(panel, [(from, 0.0), (to, 0.0)], GRID.stroke_width(2))
}
