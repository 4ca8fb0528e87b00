//! Every rung of the ladder on the same seeded rows.

use nalgebra::{Matrix4, Vector4};
use phase_tables::gaussian;
use rayon::prelude::*;
use slitrange::estimator::{Estimator, RowCentre, centre};
use slitrange::reading::Fault;
use slitrange::row::{Geometry, Row};
use slitrange::spot;

use crate::accuracy::{Cell, Outcome, PIXELS};
use crate::bound;
use crate::scene::quantise;

/// One row of counts, light positive, through the spot search and a rung.
pub fn centre_of(
    geometry: &Geometry,
    light: &[u16],
    estimator: Estimator,
) -> Result<RowCentre, Fault> {
    let row = Row::new(light, &[], 4095).expect("quantised to 12 bits");
    centre(estimator, &row, &spot::find(&row)?, None, geometry)
}

/// Runs a rung over a cell's rows.
pub fn run_estimator(cell: &Cell, estimator: Estimator) -> Outcome {
    let bound = bound::Spot {
        width: cell.width,
        amplitude: cell.amplitude,
        noise: cell.read_noise,
        electrons_per_count: cell.electrons_per_count,
    }
    .bound();
    run_at(cell, estimator, bound, |row| cell.true_centre(row))
}

/// Runs a rung over a cell's rows with the spot's centre given for each, against a given bound.
pub fn run_at(
    cell: &Cell,
    estimator: Estimator,
    bound: f64,
    true_centre: impl Fn(u64) -> f64 + Sync,
) -> Outcome {
    let scene = cell.scene_of(PIXELS);
    let errors: Vec<(f64, f64)> = (0..cell.rows)
        .into_par_iter()
        .filter_map(|row| {
            let truth = true_centre(row);
            let light = quantise(&scene.row_with_centre(row, truth, 1.0), 4095);
            centre_of(&scene.geometry(), &light, estimator)
                .ok()
                .map(|found| (found.centre.to_f64() - truth, found.uncertainty.to_f64()))
        })
        .collect();
    let is_gross = |error: f64| error.abs() > (0.5 * cell.width).max(8.0 * bound);
    let good: Vec<(f64, f64)> = errors
        .iter()
        .copied()
        .filter(|&(error, _)| !is_gross(error))
        .collect();
    let n = good.len() as f64;
    let root_mean = |sum: f64| (sum / n).sqrt();
    Outcome {
        rmse: root_mean(good.iter().map(|(error, _)| error * error).sum()),
        bound,
        pull: root_mean(
            good.iter()
                .map(|(error, claim)| (error / claim).powi(2))
                .sum(),
        ),
        faults: cell.rows - errors.len() as u64,
        gross: (errors.len() - good.len()) as u64,
    }
}

/// The Cramér-Rao bound in pixels for a spot at `centre` that is cut by the sensor's edge, which is before pixel 0: from
/// the Fisher information, in four parameters, of the pixels that there are.
pub fn cut_bound(spot: &bound::Spot, centre: f64) -> f64 {
    let h = 1e-4 * spot.width;
    let last = (centre + 6.0 * spot.width + 3.0).ceil() as i32;
    let mut information = Matrix4::zeros();
    for i in 0..=last {
        let offset = f64::from(i) - centre;
        let light = gaussian(offset, spot.width);
        let by_centre =
            (gaussian(offset - h, spot.width) - gaussian(offset + h, spot.width)) / (2.0 * h);
        let by_width =
            (gaussian(offset, spot.width + h) - gaussian(offset, spot.width - h)) / (2.0 * h);
        // In units of the width and of the height, so that the matrix can be inverted.
        let gradient = spot.amplitude
            * Vector4::new(by_centre * spot.width, light, 1.0, by_width * spot.width);
        let shot = spot
            .electrons_per_count
            .map_or(0.0, |electrons| spot.amplitude * light / electrons);
        information +=
            gradient * gradient.transpose() / (spot.noise * spot.noise + 1.0 / 12.0 + shot);
    }
    let inverse = information
        .try_inverse()
        .expect("four derivatives of a gaussian are independent");
    inverse[(0, 0)].sqrt() * spot.width
}
