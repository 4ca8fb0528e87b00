//! Many seeded rows through the core: how far its centres lie from the truth, and from what it claims.

use rayon::prelude::*;
use slitrange::centre::tables::{Sampling, TableSet};
use slitrange::centre::{RowCentre, phase_table};
use slitrange::fault::Fault;
use slitrange::row::{Geometry, Row};
use slitrange::spot;

use simulator::bound;
use simulator::scene::{BlackLevel, ReadNoise, Scene, Sensor, ShotNoise, Spot, quantise};

/// Pixels of a test row: enough for the background of the widest spot.
pub const PIXELS: usize = 2048;

/// One cell of a table: a spot and its noise, on a row of at most [`PIXELS`].
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Sigma in pixels.
    pub width: f64,
    /// Height in counts.
    pub amplitude: f64,
    /// Read noise in counts.
    pub read_noise: f64,
    /// Electrons a count, where the spot has shot noise.
    pub electrons_per_count: Option<f64>,
    /// Rows to run.
    pub rows: u64,
    /// Seed.
    pub seed: u64,
}

/// What came of a cell.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Root mean square error in pixels.
    pub rmse: f64,
    /// The Cramér-Rao bound in pixels.
    pub bound: f64,
    /// Standard deviation of error over claimed uncertainty.
    pub pull: f64,
    /// Rows without a centre.
    pub faults: u64,
    /// Rows whose centre is off by more than half a width and eight times the bound.
    pub gross: u64,
}

impl Outcome {
    /// RMSE over the bound.
    pub fn ratio(&self) -> f64 {
        self.rmse / self.bound
    }
}

impl Cell {
    /// Pixels of a row: enough for the background of the spot, and no more, because making the rows takes the time.
    pub fn pixels(&self) -> usize {
        match self.width {
            width if width <= 3.0 => 512,
            width if width <= 8.0 => 1024,
            _ => PIXELS,
        }
    }

    /// The scene that the cell stands for.
    pub fn scene(&self) -> Scene {
        self.scene_of(self.pixels())
    }

    /// The same with rows of another length.
    pub fn scene_of(&self, pixels: usize) -> Scene {
        Scene {
            seed: self.seed,
            black_level: Some(BlackLevel::steady(
                (8.0 * self.read_noise).clamp(60.0, 1000.0).round(),
            )),
            spot: Some(Spot {
                width: self.width,
                counts_per_second: self.amplitude,
            }),
            shot_noise: self
                .electrons_per_count
                .map(|electrons_per_count| ShotNoise {
                    electrons_per_count,
                }),
            read_noise: (self.read_noise > 0.0).then_some(ReadNoise {
                counts: self.read_noise,
            }),
            ..Scene::dark(Sensor::Row(pixels))
        }
    }

    /// The true centre of a row: over the phases evenly, over the row's middle 200 pixels at random.
    pub fn true_centre(&self, row: u64) -> f64 {
        const GOLDEN: f64 = 0.618_033_988_749_895;
        let place = (row as f64 * 7.0 * GOLDEN).fract();
        self.pixels() as f64 / 2.0 - 100.0 + (place * 200.0).floor() + (row as f64 * GOLDEN).fract()
            - 0.5
    }

    /// Runs the core over the rows.
    pub fn run(&self, tables: &TableSet<'_>) -> Outcome {
        let scene = self.scene();
        let bound = bound::Spot {
            width: self.width,
            amplitude: self.amplitude,
            noise: self.read_noise,
            electrons_per_count: self.electrons_per_count,
        }
        .bound();
        let centres: Vec<(f64, Result<RowCentre, Fault>)> = (0..self.rows)
            .into_par_iter()
            .map(|row| {
                let truth = self.true_centre(row);
                (
                    truth,
                    centre_of(
                        &scene.geometry(),
                        &quantise(&scene.row_with_centre(row, truth, 1.0), 4095),
                        tables,
                    ),
                )
            })
            .collect();
        let errors: Vec<(f64, f64)> = centres
            .iter()
            .filter_map(|(truth, centre)| {
                centre
                    .ok()
                    .map(|centre| (centre.centre.to_f64() - truth, centre.uncertainty.to_f64()))
            })
            .collect();
        let is_gross = |error: f64| error.abs() > (0.5 * self.width).max(8.0 * bound);
        let good: Vec<(f64, f64)> = errors
            .iter()
            .copied()
            .filter(|&(error, _)| !is_gross(error))
            .collect();
        let n = good.len() as f64;
        Outcome {
            rmse: (good.iter().map(|(error, _)| error * error).sum::<f64>() / n).sqrt(),
            bound,
            pull: (good
                .iter()
                .map(|(error, claim)| (error / claim).powi(2))
                .sum::<f64>()
                / n)
                .sqrt(),
            faults: self.rows - errors.len() as u64,
            gross: (errors.len() - good.len()) as u64,
        }
    }
}

/// One row of counts, light positive, through the spot search and the phase tables.
pub fn centre_of(
    geometry: &Geometry,
    light: &[u16],
    tables: &TableSet<'_>,
) -> Result<RowCentre, Fault> {
    let row = Row::new(light, &[], geometry.full_scale()).expect("quantised to 12 bits");
    let spot = spot::find(&row)?;
    phase_table::centre(&row, &spot, None, geometry, tables, Sampling::Fine)
}
