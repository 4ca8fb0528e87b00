//! How the rungs' accuracy hangs on the spot's width, in two kinds of noise.

use std::path::Path;

use plotters::prelude::*;
use slitrange_tool::axes::{Axis, Scale};

use super::curves::{Curve, draw_curves};
use super::style::RATIOS;
use crate::accuracy::{MOST_FAULTS, Noise, WIDTHS};
use crate::report::Measured;

const PANELS: [(&str, Noise); 2] = [
    ("White noise, SNR 100", Noise::White { snr: 100.0 }),
    (
        "Shot noise: 1000 counts, 5 electrons a count, read noise 2 counts",
        Noise::Shot {
            amplitude: 1000.0,
            electrons_per_count: 5.0,
            read_noise: 2.0,
        },
    ),
];

/// Draws the figure.
pub fn draw(measured: &Measured, path: &Path) -> anyhow::Result<()> {
    let root = SVGBackend::new(path, (1000, 1120)).into_drawing_area();
    root.fill(&WHITE)?;
    let x = Axis::new(
        Scale::Log,
        (WIDTHS[0] * 0.95, WIDTHS[WIDTHS.len() - 1] * 1.05),
        "width of the spot (σ), px",
        &WIDTHS,
        |value| value.to_string(),
    );
    let y = Axis::new(
        Scale::AboveBound,
        (0.985, 60.0),
        "RMS error / bound",
        &RATIOS,
        |value| value.to_string(),
    );
    for (area, (title, noise)) in root.split_evenly((2, 1)).iter().zip(PANELS) {
        let curves: Vec<Curve> = measured
            .methods
            .iter()
            .map(|&method| {
                let cells = measured.accuracy.cells.iter();
                let points = cells
                    .filter(|cell| cell.method == method && cell.noise == noise)
                    .filter(|cell| measured.accuracy.faults(&cell.outcome) <= MOST_FAULTS)
                    .map(|cell| (cell.width, cell.outcome.ratio()));
                Curve::of(method, points)
            })
            .collect();
        let bound = Curve::bound("bound", WIDTHS.map(|width| (width, 1.0)).to_vec());
        draw_curves(area, title, &x, &y, &[&[bound], &curves[..]].concat())?;
    }
    root.present()?;
    Ok(())
}
