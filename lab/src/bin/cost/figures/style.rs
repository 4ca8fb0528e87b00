//! What all figures have in common. Sizes are in pixels of a figure that is 1000 wide.

use plotters::prelude::*;
use slitrange::centre::Estimator;

/// Ticks and labels.
pub const TEXT: i32 = 19;
/// The names of axes and panels.
pub const TITLE: i32 = 21;
/// Width of a character over the text's size, on average, in the fonts that a browser takes for sans-serif.
pub const CHARACTER: f64 = 0.6;
/// The Cramér-Rao bound.
pub const BOUND: RGBColor = RGBColor(0x55, 0x55, 0x55);
/// The same as a broad line behind others.
pub const BAND: RGBColor = RGBColor(0xb8, 0xb8, 0xb8);
/// Lines of the grid.
pub const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);

/// Text in a colour.
pub fn text(size: i32, colour: RGBColor) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&colour)
}

/// The same in bold type.
pub fn bold(size: i32, colour: RGBColor) -> TextStyle<'static> {
    ("sans-serif", size, FontStyle::Bold)
        .into_font()
        .color(&colour)
}

/// The default rung stands out.
pub fn is_default(estimator: Estimator) -> bool {
    estimator == Estimator::default()
}

/// A rung's colour, dark enough for text on white.
pub const fn colour(estimator: Estimator) -> RGBColor {
    match estimator {
        Estimator::Centroid => RGBColor(0xb3, 0x59, 0x00),
        Estimator::Parabola => RGBColor(0x6b, 0x6b, 0x00),
        Estimator::LogParabola => RGBColor(0x80, 0x50, 0x45),
        Estimator::ZeroCrossing => RGBColor(0xc2, 0x18, 0x7b),
        Estimator::Blocks => RGBColor(0x00, 0x7c, 0x89),
        Estimator::PhaseTable => RGBColor(0, 0, 0),
        Estimator::Adaptive => RGBColor(0x15, 0x55, 0xd0),
        Estimator::Robust => RGBColor(0x7a, 0x1b, 0xaa),
        Estimator::GaussNewton => RGBColor(0xc6, 0x20, 0x20),
        Estimator::Fraunhofer => RGBColor(0x2a, 0x78, 0x2e),
    }
}
