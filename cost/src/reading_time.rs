//! The whole sensor: how the uncertainty of a distance falls with the time that a reading takes, and where it stops falling.
//!
//! Three scenes on the TCD1304DG with its nominal geometry, a target at 0.8 m:
//! * noise alone: white paper, the rows independent;
//! * the same with each row's light displaced, as speckle does it. A row's displacement is normal and remembers the row
//!   before's: a first-order autoregression. Standard deviation and correlation length are those that a simulation of
//!   speckle by Fresnel integrals gave for a laser spot of 1 mm on a rough target: 16.1 um on the sensor, 68 rows. This is a
//!   stand-in for speckle, in which the displacement has no shape of its own: the spot stays a gaussian.
//! * the same displacement in all rows of a reading: speckle on a target at rest.

use host_tests::bound;
use host_tests::scene::{Scene, quantise};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
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

/// Distance of the target in metres.
const DISTANCE: f64 = 0.8;

/// Exposure in seconds: 2000 counts of white paper.
const EXPOSURE: f64 = 2000.0 / 350_000.0;

/// Standard deviation of a row's displacement by speckle in micrometres on the sensor: 2.75 pixels of 5.86 um.
const DISPLACEMENT: f64 = 16.1;

/// Rows over which the displacement's correlation falls to 1/e.
const CORRELATION: f64 = 68.0;

/// What displaces the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Light {
    /// Nothing.
    NoiseAlone,
    /// Speckle that changes from row to row.
    SpeckleMoving,
    /// Speckle that stays.
    SpeckleAtRest,
}

impl Light {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::NoiseAlone, Self::SpeckleMoving, Self::SpeckleAtRest];

    /// Displacements of a reading's rows in pixels.
    fn displacements(self, pitch: f64, random: &mut ChaCha8Rng) -> Vec<f64> {
        let deviation = DISPLACEMENT * 1e-6 / pitch;
        let kept = match self {
            Self::NoiseAlone => return vec![0.0; MOST_ROWS],
            Self::SpeckleMoving => (-1.0 / CORRELATION).exp(),
            Self::SpeckleAtRest => 1.0,
        };
        let fresh = (1.0 - kept * kept).sqrt();
        let mut last: f64 = random.sample(StandardNormal);
        (0..MOST_ROWS)
            .map(|_| {
                let now = last;
                last = kept * last + fresh * random.sample::<f64, _>(StandardNormal);
                now * deviation
            })
            .collect()
    }
}

const MOST_ROWS: usize = 64;

/// A point of a curve.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Point {
    /// What displaces the rows.
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
pub fn measure(readings: u64) -> Vec<Point> {
    Light::ALL
        .into_iter()
        .flat_map(|light| measure_light(light, readings))
        .collect()
}

fn measure_light(light: Light, readings: u64) -> Vec<Point> {
    let scene = Scene {
        seed: 6,
        ..Scene::white_paper()
    };
    // For each reading, error and claim at each number of rows.
    let results: Vec<Vec<Option<(f64, f64)>>> = (0..readings)
        .into_par_iter()
        .map(|reading| read(&scene, light, reading))
        .collect();
    let bound = bound(&scene);
    ROWS.iter()
        .enumerate()
        .map(|(i, &rows)| {
            let good: Vec<(f64, f64)> = results.iter().filter_map(|result| result[i]).collect();
            let mut claims: Vec<f64> = good.iter().map(|(_, claim)| *claim).collect();
            claims.sort_by(f64::total_cmp);
            let squares: f64 = good.iter().map(|(error, _)| error * error).sum();
            Point {
                light,
                rows,
                milliseconds: rows as f64 / ROWS_PER_SECOND * 1e3,
                micrometres: (squares / good.len() as f64).sqrt(),
                bound_micrometres: bound / (rows as f64).sqrt(),
                claimed_micrometres: claims.get(claims.len() / 2).copied().unwrap_or(f64::NAN),
                faults: readings - good.len() as u64,
            }
        })
        .collect()
}

/// Of a row, in micrometres of distance.
fn bound(scene: &Scene) -> f64 {
    let spot = scene.spot.expect("white paper shows a spot");
    let pixels = bound::Spot {
        width: spot.width,
        amplitude: spot.counts_per_second * EXPOSURE,
        noise: scene.read_noise.map_or(0.0, |noise| noise.counts),
        electrons_per_count: scene.shot_noise.map(|noise| noise.electrons_per_count),
    }
    .bound();
    pixels * scene.optics.metres_per_pixel(scene.optics.centre(DISTANCE)) * 1e6
}

/// The error and the claimed uncertainty in micrometres of a reading, at each number of rows: the first ones of the same 64.
fn read(scene: &Scene, light: Light, reading: u64) -> Vec<Option<(f64, f64)>> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    random.set_stream(reading);
    let displacements = light.displacements(scene.optics.pitch, &mut random);
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
    for (row, displacement) in (1u64..).zip(displacements) {
        let centre = scene.optics.centre(DISTANCE) + displacement;
        let index = reading * MOST_ROWS as u64 + row;
        let light = quantise(&scene.row_with_centre(index, centre, EXPOSURE), full_scale);
        // The sensor's words fall with light.
        let words: Vec<u16> = light.iter().map(|count| full_scale - count).collect();
        for ((&rows, measurement), result) in ROWS.iter().zip(&mut measurements).zip(&mut results) {
            if row > rows {
                continue;
            }
            if let Some(Ok(reading)) = measurement.row(&mut words.clone()) {
                *result = Some((
                    reading.distance.to_f64() - DISTANCE * 1e6,
                    reading.uncertainty.to_f64(),
                ));
            }
        }
    }
    results
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 200 readings give an RMS to 5 %. Noise alone falls as the square root of the rows; at rest, speckle does not fall.
    #[test]
    fn rows_help_against_noise_and_not_against_speckle_at_rest() {
        let points = measure(200);
        let at = |light, rows| {
            let point = points.iter().find(|p| p.light == light && p.rows == rows);
            point.expect("measured").micrometres
        };
        for point in &points {
            println!("{point:?}");
            assert_eq!(point.faults, 0);
        }
        let gain = at(Light::NoiseAlone, 1) / at(Light::NoiseAlone, 64);
        println!("noise alone: 64 rows gain {gain}");
        assert!((gain / 8.0 - 1.0).abs() < 0.2);
        let rest = at(Light::SpeckleAtRest, 1) / at(Light::SpeckleAtRest, 64);
        println!("speckle at rest: {rest}");
        assert!((rest - 1.0).abs() < 0.05);
        // Over n rows of an autoregression the mean's variance over a row's is (n + 2 sum (n - k) e^(-k/68)) / n^2.
        let n = 64.0;
        let sum: f64 = (1..64)
            .map(|k| (n - f64::from(k)) * (-f64::from(k) / CORRELATION).exp())
            .sum();
        let expected = ((n + 2.0 * sum) / (n * n)).sqrt();
        let speckle = at(Light::SpeckleMoving, 64) / at(Light::SpeckleMoving, 1);
        println!("speckle: 64 rows leave {speckle}, expected {expected}");
        assert!((speckle / expected - 1.0).abs() < 0.1);
    }
}
