//! The whole sensor: how the uncertainty of a distance falls with the time that a reading takes, and where it stops falling.
//!
//! White paper at 0.8 m, seen by the TCD1304DG with its nominal geometry:
//! * noise alone: no speckle, the rows are independent;
//! * speckle on a target at rest: all rows of a reading share its error;
//! * speckle on a target that moves away from the sensor, and on one that slides past under the laser.
//!
//! They are the scenes `speckle-*` of `scenes/`; speckle is summed as a field ([`host_tests::field`]). Each reading sees a surface of
//! its own. Its truth is the target's mean distance over its rows.

use anyhow::Result;
use host_tests::bound;
use host_tests::scene::{Effect, Scene, Simulation, quantise};
use rayon::prelude::*;
use serde::Serialize;
use slitrange::black_level::BlackLevel;
use slitrange::estimator::Estimator;
use slitrange::measurement::{Measurement, Settings};
use slitrange::triangulation;

/// Rows a second that the sensor is read out with.
pub const ROWS_PER_SECOND: f64 = 175.4;

/// Rows in a reading.
pub const ROWS: [u64; 7] = [1, 2, 4, 8, 16, 32, 64];

const MOST_ROWS: u64 = 64;

/// What falls on the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Light {
    /// That of a surface without speckle.
    NoiseAlone,
    /// The same speckle in all rows.
    SpeckleAtRest,
    /// Speckle of a target that moves along the laser, at 10 mm/s.
    SpeckleReceding,
    /// Speckle of a target that moves across the laser, at 20 mm/s.
    SpeckleSliding,
}

impl Light {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::NoiseAlone,
        Self::SpeckleAtRest,
        Self::SpeckleReceding,
        Self::SpeckleSliding,
    ];

    fn scene(self) -> Result<Scene> {
        match self {
            Self::NoiseAlone => Ok(Scene::load("speckle-at-rest")?.without(Effect::Speckle)),
            Self::SpeckleAtRest => Scene::load("speckle-at-rest"),
            Self::SpeckleReceding => Scene::load("speckle-receding"),
            Self::SpeckleSliding => Scene::load("speckle-sliding"),
        }
    }
}

/// A point of a curve.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Point {
    /// What falls on the sensor.
    pub light: Light,
    /// Rows in a reading.
    pub rows: u64,
    /// Time of a reading in milliseconds.
    pub milliseconds: f64,
    /// Root mean square error of a reading in micrometres.
    pub micrometres: f64,
    /// The Cramér-Rao bound for noise alone in micrometres: that of a row over sqrt(rows).
    pub bound_micrometres: f64,
    /// Median of the uncertainty that the readings claim, in micrometres.
    pub claimed_micrometres: f64,
    /// Readings without a distance.
    pub faults: u64,
}

/// Measures all scenes with the default rung, this many readings a point.
///
/// # Errors
/// A scene cannot be read.
pub fn measure(readings: u64) -> Result<Vec<Point>> {
    let bound = bound(&Light::NoiseAlone.scene()?);
    let mut points = vec![];
    for light in Light::ALL {
        let scene = light.scene()?;
        // For each reading, error and claim at each number of rows.
        let results: Vec<Vec<Option<Found>>> = (0..readings)
            .into_par_iter()
            .map(|reading| read(&scene, reading))
            .collect();
        points.extend(
            (ROWS.iter().enumerate())
                .map(|(i, &rows)| point(light, rows, bound, results.iter().map(|found| found[i]))),
        );
    }
    Ok(points)
}

/// Of a row, in micrometres of distance.
fn bound(scene: &Scene) -> f64 {
    let pixels = bound::of_row(
        &Simulation::new(scene.clone()),
        scene.distance,
        scene.exposure,
    )
    .expect("paper without speckle is noise alone");
    pixels
        * scene
            .optics
            .metres_per_pixel(scene.optics.centre(scene.distance))
        * 1e6
}

/// The error and the claimed uncertainty of a reading, in micrometres.
#[derive(Clone, Copy, Debug)]
struct Found {
    error: f64,
    claim: f64,
}

fn point(
    light: Light,
    rows: u64,
    bound: f64,
    readings: impl ExactSizeIterator<Item = Option<Found>>,
) -> Point {
    let count = readings.len();
    let found: Vec<Found> = readings.flatten().collect();
    let mut claims: Vec<f64> = found.iter().map(|found| found.claim).collect();
    claims.sort_by(f64::total_cmp);
    let squares: f64 = found.iter().map(|found| found.error.powi(2)).sum();
    Point {
        light,
        rows,
        milliseconds: rows as f64 / ROWS_PER_SECOND * 1e3,
        micrometres: (squares / found.len() as f64).sqrt(),
        bound_micrometres: bound / (rows as f64).sqrt(),
        claimed_micrometres: claims.get(claims.len() / 2).copied().unwrap_or(f64::NAN),
        faults: (count - found.len()) as u64,
    }
}

/// A reading on a surface of its own, at each number of rows: the first ones of the same 64.
fn read(scene: &Scene, reading: u64) -> Vec<Option<Found>> {
    let simulation = Simulation::new(Scene {
        seed: scene.seed + reading,
        ..scene.clone()
    });
    let mut measurements = ROWS.map(|rows| {
        let settings = Settings {
            rows: rows as u16,
            estimator: Estimator::default(),
            black_level: BlackLevel::Shielded,
            calibration: triangulation::NOMINAL.ok(),
        };
        Measurement::new(scene.geometry(), settings)
    });
    let mut results = vec![None; ROWS.len()];
    let full_scale = scene.geometry().full_scale();
    let mut sum_of_truths = 0.0;
    for row in 0..MOST_ROWS {
        let light = quantise(
            &simulation.row(row, scene.distance, scene.exposure),
            full_scale,
        );
        sum_of_truths += simulation.true_distance(row, scene.distance) * 1e6;
        // The sensor's words fall with light.
        let words: Vec<u16> = light.iter().map(|count| full_scale - count).collect();
        for ((&rows, measurement), result) in ROWS.iter().zip(&mut measurements).zip(&mut results) {
            if row >= rows {
                continue;
            }
            if let Some(Ok(reading)) = measurement.row(&mut words.clone()) {
                *result = Some(Found {
                    error: reading.distance.to_f64() - sum_of_truths / rows as f64,
                    claim: reading.uncertainty.to_f64(),
                });
            }
        }
    }
    results
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look() {
        let t = std::time::Instant::now();
        for point in measure(200).unwrap() {
            println!("{point:?}");
        }
        println!("{:?}", t.elapsed());
    }
}
