//! How the methods' accuracy depends on the spot's width, in two kinds of noise.

use std::path::Path;

use figures::axes;

use super::curves::{Curve, axis_of_ratios, axis_of_widths, draw_curves};
use crate::programs::cost::accuracy::{MOST_FAULTS, Noise, WIDTHS, shot, white};
use crate::programs::cost::report::Measured;

const PANELS: [(&str, Noise); 2] = [
    ("White noise, SNR 100", white(100.0)),
    (
        "Shot noise: 1000 counts, 5 electrons a count, read noise 2 counts",
        shot(1000.0, 5.0, 2.0),
    ),
];

pub fn draw(measured: &Measured, path: &Path) -> anyhow::Result<()> {
    let root = axes::figure(path, 1120)?;
    let x = axis_of_widths();
    let y = axis_of_ratios(60.0);
    for (area, (title, noise)) in root.split_evenly((2, 1)).iter().zip(PANELS) {
        let bound = WIDTHS.map(|width| (width, 1.0));
        let mut curves = vec![Curve::bound("bound", bound.to_vec())];
        curves.extend(measured.methods.iter().map(|&method| {
            let cells = measured.accuracy.cells.iter();
            let points = cells
                .filter(|cell| cell.method == method && cell.noise == noise)
                .filter(|cell| measured.accuracy.faults(&cell.outcome) <= MOST_FAULTS)
                .map(|cell| (cell.width, cell.outcome.ratio()));
            Curve::of(method, points)
        }));
        draw_curves(area, title, &x, &y, &curves)?;
    }
    Ok(root.present()?)
}
