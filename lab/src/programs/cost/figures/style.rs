//! What all figures have in common. Sizes are in pixels of a figure that is 1000 wide.

use cost_on_chip::methods::Method;
use figures::dark::{BLUE, GREEN, ORANGE, PURPLE, RED};
use plotters::prelude::*;
use slitrange::centre::Estimator;

/// Width of a character over the text's size, on average, in the fonts that a browser takes for sans-serif.
pub const CHARACTER: f64 = 0.6;
/// The Cramér-Rao bound.
pub const BOUND: RGBColor = RGBColor(0x55, 0x55, 0x55);
/// The same as a broad line behind others.
pub const BAND: RGBColor = RGBColor(0xb8, 0xb8, 0xb8);
/// Ticks of an axis of ratios to the bound.
pub const RATIOS: [f64; 13] = [
    1.0, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0,
];

pub fn bold(size: i32, colour: RGBColor) -> TextStyle<'static> {
    ("sans-serif", size, FontStyle::Bold)
        .into_font()
        .color(&colour)
}

pub fn is_default(method: Method) -> bool {
    method == Method::default()
}

/// A method's colour, dark enough for text on white.
pub const fn colour(method: Method) -> RGBColor {
    match method {
        Method::Estimator(Estimator::Centroid) => ORANGE,
        Method::Estimator(Estimator::PhaseTable) => BLACK,
        Method::Estimator(Estimator::Adaptive) => BLUE,
        Method::Repair => PURPLE,
        Method::Estimator(Estimator::GaussNewton) => RED,
        Method::Estimator(Estimator::Fraunhofer) => GREEN,
    }
}
