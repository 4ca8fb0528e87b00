//! The methods' errors without noise: the largest over the sub-pixel phase, against the spot's width.

use std::path::Path;

use figures::axes::{self, Axis, Scale};
use simulator::bound;

use super::curves::{Curve, axis_of_widths, draw_curves};
use crate::programs::cost::accuracy::WIDTHS;
use crate::programs::cost::report::Measured;

/// Smaller ones are drawn here: the centre's own resolution is 1.5e-5.
const SMALLEST: f64 = 1e-5;

pub fn draw(measured: &Measured, path: &Path) -> anyhow::Result<()> {
    let root = axes::figure(path, 720)?;
    let x = axis_of_widths();
    let y = Axis::new(
        Scale::Log,
        (SMALLEST, 1.0),
        "largest bias over the phase, px",
        &[1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0],
        |value| match value <= SMALLEST {
            true => "≤ 1e-5".into(),
            false => value.to_string(),
        },
    );
    let bound = WIDTHS.map(|width| (width, bright(width)));
    let mut curves = vec![Curve::bound("bound, one row", bound.to_vec())];
    curves.extend(measured.methods.iter().map(|&method| {
        let biases = measured.accuracy.biases.iter();
        let points = biases
            .filter(|bias| bias.method == method)
            .map(|bias| (bias.width, bias.pixels.unwrap_or(f64::NAN)));
        Curve::of(method, points)
    }));
    let title = "Bias of a noiseless spot, and the noise of one bright row";
    draw_curves(&root, title, &x, &y, &curves)?;
    Ok(root.present()?)
}

/// The bound in pixels for a row of the brightest spot: 3800 counts, 10 electrons each, a count of read
/// noise.
fn bright(width: f64) -> f64 {
    bound::Spot {
        width,
        amplitude: 3800.0,
        noise: 1.0,
        electrons_per_count: Some(10.0),
    }
    .bound()
}
