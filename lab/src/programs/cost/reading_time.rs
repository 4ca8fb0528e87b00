//! The whole sensor: how the uncertainty of a distance falls with the time that a reading takes, and where it
//! stops falling.
//!
//! White paper at 0.8 m, seen by the TCD1304DG with its nominal geometry:
//! * noise alone: no speckle, the rows are independent;
//! * speckle on a target at rest: all rows of a reading share its error;
//! * speckle on a target that moves away from the sensor, and on one that slides past under the laser;
//! * speckle on a target at rest behind a comb of 16 slits.
//!
//! They are the scenes `speckle-*` of `scenes/`; speckle is summed as a field ([`simulator::field`]). Each
//! reading sees a surface of its own. Its truth is the target's mean distance over its rows.

use cost_on_chip::whole_rows::COMB;
use judges::frames::words;
use simulator::bound;
use simulator::scene::Effect;
use simulator::scene::comb::Comb;
use slitrange::Options;
use slitrange_device::record;

use crate::prelude::*;
use crate::programs::cost::chip::whole_rows::WholeRows;

/// Rows a second that the sensor is read out with.
pub const ROWS_PER_SECOND: f64 = 175.4;

pub const ROWS: [u64; 7] = [1, 2, 4, 8, 16, 32, 64];

const MOST_ROWS: u64 = 64;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    /// That of a surface without speckle.
    NoiseAlone,
    /// The same speckle in all rows.
    SpeckleAtRest,
    /// Speckle of a target that moves along the laser, at 10 mm/s.
    SpeckleReceding,
    /// Speckle of a target that moves across the laser, at 20 mm/s.
    SpeckleSliding,
    /// The same speckle in all rows, behind a comb of 16 slits.
    SpeckleBehindComb,
}

impl Light {
    pub const ALL: [Self; 5] = [
        Self::NoiseAlone,
        Self::SpeckleAtRest,
        Self::SpeckleReceding,
        Self::SpeckleSliding,
        Self::SpeckleBehindComb,
    ];

    fn estimators(self) -> Vec<Estimator> {
        match self {
            Self::NoiseAlone | Self::SpeckleAtRest => Estimator::ALL.into(),
            Self::SpeckleReceding | Self::SpeckleSliding | Self::SpeckleBehindComb => {
                vec![Estimator::default()]
            }
        }
    }

    fn scene(self) -> Result<Scene> {
        match self {
            Self::NoiseAlone => Ok(Scene::load("speckle-at-rest")?.without(Effect::Speckle)),
            Self::SpeckleAtRest => Scene::load("speckle-at-rest"),
            Self::SpeckleReceding => Scene::load("speckle-receding"),
            Self::SpeckleSliding => Scene::load("speckle-sliding"),
            Self::SpeckleBehindComb => Ok(Scene {
                comb: Some(Comb::nominal()),
                ..Scene::load("speckle-at-rest")?
            }),
        }
    }

    /// What the chip computes for a reading of so many rows, in milliseconds.
    fn computing(self, chip: &WholeRows, estimator: Estimator, rows: u64) -> Option<f64> {
        match self {
            Self::SpeckleBehindComb => chip.reading_milliseconds(COMB, rows),
            _ => chip.reading_milliseconds(estimator.name(), rows),
        }
    }
}

/// The record of a sensor that was calibrated on white paper: the demo's, by `cargo surfaces`.
const CALIBRATED_ON_PAPER: &[u8] =
    include_bytes!("../../../../virtual-board/src/bin/demo/paper.record");

#[derive(Clone, Copy, Debug)]
pub struct Point {
    pub light: Light,
    pub estimator: Estimator,
    pub rows: u64,
    /// Time of a reading in milliseconds: the longer one of the sensor's and the chip's.
    pub milliseconds: f64,
    /// What the chip computes for a reading, in milliseconds.
    pub computing_milliseconds: f64,
    /// Root mean square error of a reading in micrometres.
    pub micrometres: f64,
    /// The Cramér-Rao bound for noise alone in micrometres: that of a row over sqrt(rows).
    pub bound_micrometres: f64,
    /// Median of the readings' u in micrometres.
    pub u_micrometres: f64,
    /// Median of the readings' r in micrometres.
    pub r_micrometres: f64,
}

/// Measures all scenes, this many readings a point. `chip` says how long the chip computes. A target on the
/// move is measured by the default estimator only.
pub fn measure(readings: u64, chip: &WholeRows) -> Result<Vec<Point>> {
    let of_lights = Light::ALL.map(|light| measure_light(light, readings, chip));
    Ok(of_lights.into_iter().collect::<Result<Vec<_>>>()?.concat())
}

fn measure_light(light: Light, readings: u64, chip: &WholeRows) -> Result<Vec<Point>> {
    let bound = bound(&Light::NoiseAlone.scene()?);
    let scene = light.scene()?;
    let estimators = light.estimators();
    // For each reading, what is found by each estimator at each number of rows.
    let results: Vec<Vec<Option<Found>>> = (0..readings)
        .into_par_iter()
        .map(|reading| read(&scene, reading, &estimators))
        .collect();
    let cases = estimators
        .iter()
        .flat_map(|&estimator| ROWS.map(|rows| (estimator, rows)));
    let point = |(i, (estimator, rows)): (usize, (Estimator, u64))| {
        let found: Vec<Found> = results.iter().filter_map(|found| found[i]).collect();
        let faults = readings - found.len() as u64;
        ensure!(
            faults <= (readings / 20).max(2),
            "{faults} of {readings} readings of {rows} rows have a fault: {light:?}"
        );
        let computing = light.computing(chip, estimator, rows).unwrap_or(f64::NAN);
        Ok(Point {
            light,
            estimator,
            rows,
            // The maximum of a number and NaN is the number.
            milliseconds: (rows as f64 / ROWS_PER_SECOND * 1e3).max(computing),
            computing_milliseconds: computing,
            micrometres: rms(found.iter().map(|found| found.error)),
            bound_micrometres: bound / (rows as f64).sqrt(),
            u_micrometres: upper_median(found.iter().map(|found| found.u)),
            r_micrometres: upper_median(found.iter().map(|found| found.r)),
        })
    };
    cases.enumerate().map(point).collect()
}

/// Standard deviation of the spot's image, as micrometres of distance.
fn image_of_the_spot(scene: &Scene) -> Result<f64> {
    let (optics, d) = (scene.optics, scene.distance);
    let spot = scene.laser_spot.context("the scene has no laser spot")?;
    // The waist is the diameter where a gaussian beam's light is 1/e^2.
    let image =
        spot.waist / 4.0 * optics.focal_length / optics.range(d) * optics.viewing_angle(d).cos();
    Ok(image / optics.pitch * optics.metres_per_pixel(optics.centre(d)) * 1e6)
}

/// The error that speckle leaves of a row, in micrometres, behind a slit that is much narrower than a
/// speckle: s / sqrt 2, where s is the size of the spot's image.
pub fn speckle_limit() -> Result<f64> {
    Ok(image_of_the_spot(&Light::SpeckleAtRest.scene()?)? / 2f64.sqrt())
}

/// Of a row, in micrometres of distance.
fn bound(scene: &Scene) -> f64 {
    let (optics, distance) = (&scene.optics, scene.distance);
    let pixels = bound::of_row(&Simulation::new(scene.clone()), distance, scene.exposure);
    let pixels = pixels.expect("paper without speckle is noise alone");
    pixels * optics.metres_per_pixel(optics.centre(distance)) * 1e6
}

/// The error, u and r of a reading, in micrometres.
#[derive(Clone, Copy, Debug)]
struct Found {
    error: f64,
    u: f64,
    r: f64,
}

/// A reading on a surface of its own, by each estimator at each number of rows: the first ones of the same
/// 64.
fn read(scene: &Scene, reading: u64, estimators: &[Estimator]) -> Vec<Option<Found>> {
    let simulation = Simulation::new(with(scene.clone(), |it| it.seed = scene.seed + reading));
    let slits = match scene.comb {
        Some(_) => Slits::Comb,
        None => Slits::One,
    };
    let measurement = |estimator, rows: u64| {
        let options = Options {
            rows: rows as u16,
            estimator,
            slits,
            ..Options::default()
        };
        (rows, Measurement::new(scene.geometry(), options))
    };
    let mut measurements: Vec<(u64, Measurement)> = estimators
        .iter()
        .flat_map(|&estimator| ROWS.map(|rows| measurement(estimator, rows)))
        .collect();
    let calibration = Calibration::nominal();
    // The curve is exact here. What it says of the surface is what a calibration on white paper finds.
    let errors = record::decode(CALIBRATED_ON_PAPER).map(|record| record.errors);
    // That calibration has one slit. What it finds of the surface is no part that the slits of a comb share.
    let errors = (errors.ok())
        .filter(|_| scene.comb.is_none())
        .unwrap_or(CalibrationErrors::Unknown);
    let mut results = vec![None; measurements.len()];
    let geometry = scene.geometry();
    let mut sum_of_truths = 0.0;
    for row in 0..MOST_ROWS {
        let light = simulation.row(row, scene.distance, scene.exposure);
        let words = words(&light, &geometry);
        sum_of_truths += simulation.true_distance(row, scene.distance) * 1e6;
        for ((rows, measurement), result) in measurements.iter_mut().zip(&mut results) {
            if row >= *rows {
                continue;
            }
            let Some(Ok(measured)) = measurement.row(&mut words.clone()) else {
                continue;
            };
            let reading = measured.reading(calibration.as_ref(), &errors, Surface::Auto);
            if let Ok(reading) = reading {
                *result = Some(Found {
                    error: reading.distance.to_f64() - sum_of_truths / *rows as f64,
                    u: reading.uncertainty.to_f64(),
                    r: reading.parts.noise.to_f64(),
                });
            }
        }
    }
    results
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// Errors of the first row and of the mean of so many rows in micrometres, for each of `surfaces`
    /// surfaces, where the slit is so narrow that all that speckle does is to tilt the wave: the light moves
    /// by z times the gradient of its phase over k, which is Im(sum E* dE/du) / sum |E|^2 over the
    /// polarisations. The field is summed over scatterers on a line, with exact paths: the beam's extent
    /// across the baseline changes nothing for a slit that is short, too.
    fn behind_a_narrow_slit(scene: &Scene, rows: u64, surfaces: u64) -> Vec<[f64; 2]> {
        const PITCH: f64 = 4e-6;
        const ALONG_THE_SLIT: f64 = 1e-6;
        let optics = scene.optics;
        let spot = scene.laser_spot.expect("a laser spot");
        let wander = spot.wander;
        let speed = scene.motion.map_or(0.0, |motion| motion.speed);
        let radius = spot.waist / 2.0;
        let k = std::f64::consts::TAU / optics.wavelength;
        (0..surfaces)
            .into_par_iter()
            .map(|surface| {
                let mut random = ChaCha8Rng::seed_from_u64(11);
                random.set_stream(surface);
                let count = ((2.25 * 2.0 * radius + 8e-3) / PITCH) as usize;
                // Real and imaginary part for two polarisations.
                let scatterers: Vec<[f64; 4]> = (0..count)
                    .map(|_| std::array::from_fn(|_| random.sample(StandardNormal)))
                    .collect();
                let errors: Vec<f64> = (0..rows)
                    .map(|row| {
                        let moved = speed * row as f64 / ROWS_PER_SECOND;
                        let distance = scene.distance + moved;
                        let range = optics.range(distance);
                        let mut fields = [[0.0; 4]; 2];
                        for (i, scatterer) in scatterers.iter().enumerate() {
                            let x = i as f64 * PITCH - 2.25 * radius - wander * moved;
                            if x.abs() > 2.25 * radius {
                                continue;
                            }
                            let amplitude = (-(x / radius).powi(2)).exp();
                            for (field, u) in fields.iter_mut().zip([-1.0, 1.0]) {
                                let u = u * ALONG_THE_SLIT / range;
                                let across = optics.baseline + u * distance - x;
                                let path = across.hypot(distance - u * optics.baseline);
                                let (im, re) = (k * (path - range)).sin_cos();
                                for (field, part) in field.chunks_mut(2).zip(scatterer.chunks(2)) {
                                    field[0] += amplitude * (part[0] * re - part[1] * im);
                                    field[1] += amplitude * (part[0] * im + part[1] * re);
                                }
                            }
                        }
                        let [before, after] = fields;
                        let turned: f64 = (0..2)
                            .map(|p| {
                                before[2 * p] * after[2 * p + 1] - before[2 * p + 1] * after[2 * p]
                            })
                            .sum();
                        let light: f64 = before.iter().zip(after).map(|(a, b)| a * b).sum();
                        let gradient = turned / light / (2.0 * ALONG_THE_SLIT);
                        let pixels = optics.focal_length * gradient / k / optics.pitch;
                        pixels * optics.metres_per_pixel(optics.centre(distance)) * 1e6
                    })
                    .collect();
                [errors[0], statistics::mean(&errors)]
            })
            .collect()
    }

    fn at(points: &[Point], light: Light, rows: u64) -> f64 {
        let default = Estimator::default();
        let is_it = |it: &&Point| (it.light, it.rows, it.estimator) == (light, rows, default);
        points.iter().find(is_it).expect("measured").micrometres
    }

    /// 40 readings give an RMS to 11 %.
    #[test]
    fn rows_help_against_noise() {
        let points = measure_light(Light::NoiseAlone, 40, &WholeRows::default()).expect("a scene");
        let noise = at(&points, Light::NoiseAlone, 1) / at(&points, Light::NoiseAlone, 64);
        println!("noise alone: 64 rows gain {noise}");
        assert!((noise / 8.0 - 1.0).abs() < 0.3);
    }

    /// 160 readings give an RMS to 6 %, and to about 8 % in speckle, because dim rows are far off.
    #[test]
    #[ignore = "speckle takes 44 s of processor time; .ci/run runs it"]
    fn rows_help_against_speckle_as_far_as_it_changes() {
        const READINGS: u64 = 160;
        let points = measure(READINGS, &WholeRows::default()).expect("scenes");
        for point in &points {
            println!("{point:?}");
        }
        let gain = |light| at(&points, light, 1) / at(&points, light, 64);
        let rest = gain(Light::SpeckleAtRest);
        println!("speckle at rest: 64 rows gain {rest}");
        assert!((rest - 1.0).abs() < 0.03);
        // Behind a narrow slit it is s / sqrt 2: see below. A slit of 200 um, and pixels as tall as that, see
        // a mean over a part of a speckle.
        let row = at(&points, Light::SpeckleAtRest, 1) / speckle_limit().expect("a spot");
        println!("speckle at rest: {row} of a row behind a narrow slit");
        assert!((0.7..1.2).contains(&row));
        for light in [Light::SpeckleReceding, Light::SpeckleSliding] {
            let errors = behind_a_narrow_slit(&light.scene().expect("a scene"), 64, 300);
            let [one, mean] = [0, 1].map(|which| rms(errors.iter().map(|it| it[which])));
            let (found, narrow) = (gain(light), one / mean);
            println!("{light:?}: 64 rows gain {found}, behind a narrow slit {narrow}");
            assert!((found / narrow - 1.0).abs() < 0.35);
        }
    }

    /// Let sum |E|^2 be the light over two polarisations, with a mean of 1. For a given sum, the shift is
    /// normal with a variance of s^2 / (2 sum |E|^2), where s is the standard deviation of the spot's image.
    /// So 2 / s times the shift has Student's t distribution with 4 degrees of freedom. The median of its
    /// absolute value is 0.7407, and its standard deviation is sqrt 2. The median of 3000 shifts is exact to
    /// 2 %.
    #[test]
    fn a_narrow_slit_has_a_closed_form() {
        let scene = Light::SpeckleAtRest.scene().expect("a scene");
        let errors = behind_a_narrow_slit(&scene, 1, 3000);
        let found = upper_median(errors.iter().map(|error| error[0].abs()));
        let expected = 0.7407 * 0.5 * image_of_the_spot(&scene).expect("a spot");
        println!("median {found:.1} um, expected {expected:.1} um");
        assert!((found / expected - 1.0).abs() < 0.06);
    }
}
