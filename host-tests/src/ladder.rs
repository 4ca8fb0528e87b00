//! Every rung of the ladder on the same seeded rows.

use rayon::prelude::*;
use slitrange::centre::{Estimator, RowCentre, centre};
use slitrange::fault::Fault;
use slitrange::row::{Geometry, Row};
use slitrange::spot;

use crate::accuracy::{Cell, Outcome, PIXELS};
use simulator::bound;
use simulator::scene::quantise;

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
