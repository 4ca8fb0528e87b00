//! The sensor's own spot: a sensor with a lopsided laser beam is calibrated, and then reads as well as one
//! with a symmetric beam.

use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use slitrange::black_level::BlackLevel;
use slitrange::centre::Estimator;
use slitrange::check;
use slitrange::measurement::Measurement;
use slitrange::pixels::PixelErrors;
use slitrange::profile::Profile;
use slitrange::reading::{Measured, Reading};
use slitrange::sensor_heads::tcd1304dg;
use slitrange::settings::Settings;
use slitrange::uncertainty::{CalibrationErrors, Surface};
use slitrange::units::Counts;
use slitrange::{Calibration, centre, spot};
use slitrange_tool::fit::{calibration, errors, profile, solve::solve};
use slitrange_tool::points::{Points, Setup};
use slitrange_tool::sensor::answers;
use slitrange_tool::sensor::run::taken;
use slitrange_tool::sensor::session::Before;
use slitrange_tool::sensor::taken::PointsFile;

use crate::truth::{FAR, NEAR, Truth, rms, seeded};

/// A sensor in front of a smooth target.
struct Sensor {
    truth: Truth,
    /// The skewness of the laser's spot.
    skewness: f64,
    estimator: Estimator,
}

/// Counts of an unlit pixel, and its noise.
const BLACK: f64 = 300.0;
const READ_NOISE: f64 = 4.0;

impl Sensor {
    fn of(skewness: f64, estimator: Estimator) -> Self {
        Self {
            truth: Truth::nominal(),
            skewness,
            estimator,
        }
    }

    /// The words of a row. The spot is wider for a target that is farther away.
    fn words(&self, distance: f64, height: f64, random: &mut ChaCha8Rng) -> Vec<u16> {
        let geometry = tcd1304dg();
        let centre = self.truth.centre(distance);
        let width = 7.7 * (0.95 + 0.1 * (distance - NEAR) / (FAR - NEAR));
        let mut words = vec![0; geometry.words];
        let first = geometry.light.start;
        for (index, word) in words.iter_mut().enumerate() {
            let u = (index as f64 - first as f64 - centre) / width;
            let light = if u.abs() < 7.0 {
                let lopsided = 1.0 + self.skewness / 6.0 * (u.powi(3) - 3.0 * u);
                (height * (-0.5 * u * u).exp() * lopsided).max(0.0)
            } else {
                0.0
            };
            let shot = light * f64::from(geometry.shot_variance_per_count_q16) / 65536.0;
            let normal: f64 = StandardNormal.sample(random);
            let counts = BLACK + light + (READ_NOISE.powi(2) + shot).sqrt() * normal;
            *word = geometry.full_scale() - counts.round().clamp(0.0, 4095.0) as u16;
        }
        words
    }

    fn settings(&self, rows: u16) -> Settings {
        Settings {
            rows,
            estimator: self.estimator,
            ..Settings::default()
        }
    }

    fn frame(
        &self,
        measurement: &mut Measurement,
        distance: f64,
        height: f64,
        random: &mut ChaCha8Rng,
    ) -> Measured {
        let measured = loop {
            if let Some(measured) = measurement.row(&mut self.words(distance, height, random)) {
                break measured;
            }
        };
        Measured {
            // The simulated pixels are all alike.
            pixels: PixelErrors {
                response_q16: 0,
                offset: Counts::default(),
            },
            ..measured.expect("a centre")
        }
    }

    /// Calibrates the sensor, while it uses a profile: points as `calibrate run` takes them, and the fit.
    fn calibrate(&self, known: Option<Profile>, seed: u64) -> Calibrated {
        let mut random = seeded(seed);
        let mut measurement = Measurement::new(tcd1304dg(), self.settings(64));
        measurement.set(self.settings(64), known);
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("points.csv");
        let setup = Setup {
            head: Some("TCD1304DG".to_owned()),
            serial_number: Some(17),
            estimator: Some(self.estimator),
            black_level: Some(BlackLevel::Shielded),
        };
        let before = Before {
            streamed: true,
            rows: Some(16),
        };
        let mut file = PointsFile::open(&path, &setup, before, "today").expect("a file");
        const POINTS: usize = 30;
        for point in 0..POINTS {
            let distance = NEAR + (FAR - NEAR) * point as f64 / (POINTS - 1) as f64;
            let height = 1000.0 * (0.8 / distance).powi(2);
            let centres: Vec<answers::Centre> = (0..8)
                .map(|_| {
                    let measured = self.frame(&mut measurement, distance, height, &mut random);
                    let line = measured.to_string();
                    answers::centre(&[line])
                        .expect("an answer")
                        .expect("a centre")
                })
                .collect();
            file.add(taken(1e3 * distance, &centres)).expect("added");
        }
        file.put_in_order().expect("in order");
        println!("{}", std::fs::read_to_string(&path).expect("text"));
        let points = Points::read(&path).expect("points").points;
        let solved = solve(&points, None).expect("a fit");
        let made = calibration::make(&solved, None).expect("a calibration");
        Calibrated {
            errors: errors::of(&solved, &made),
            profile: profile::of(&solved, &made.calibration).expect("a profile"),
            calibration: made.calibration,
        }
    }

    /// The share of rows whose centre is not the estimator's own, because the repair replaced it.
    fn repaired(&self, profile: Option<&Profile>, rows: usize, seed: u64) -> f64 {
        let mut random = seeded(seed);
        let geometry = tcd1304dg();
        let repaired = (0..rows).filter(|_| {
            let (distance, height) = anywhere(&mut random);
            let mut words = self.words(distance, height, &mut random);
            let row = geometry.row(&mut words).expect("a row");
            let spot = spot::find(&row).expect("a spot");
            let own = centre::centre(self.estimator, &row, &spot, None, &geometry);
            let checked = check::centre(self.estimator, &row, &spot, None, &geometry, profile);
            own.expect("a centre").centre != checked.expect("a centre").centre
        });
        repaired.count() as f64 / rows as f64
    }
}

/// A distance and a height.
fn anywhere(random: &mut ChaCha8Rng) -> (f64, f64) {
    let distance = random.random_range(NEAR + 0.002..FAR - 0.002);
    (distance, 200.0 * 15f64.powf(random.random()))
}

/// What a calibration found.
struct Calibrated {
    calibration: Calibration,
    errors: CalibrationErrors,
    profile: Profile,
}

/// How readings compare with the truth.
struct Judged {
    /// The share with an error within 2u.
    within: f64,
    /// Errors over u, root mean square.
    over_u: f64,
    /// Median u in micrometres.
    u_um: f64,
    /// The root mean square of the errors, in micrometres.
    rms_um: f64,
    /// The share of the rows with a flag.
    flagged: f64,
}

impl Calibrated {
    /// Readings at other distances and heights, with or without the profile.
    fn judge(&self, sensor: &Sensor, profile: Option<Profile>, count: usize, seed: u64) -> Judged {
        const ROWS: u16 = 16;
        let mut random = seeded(seed);
        let mut measurement = Measurement::new(tcd1304dg(), sensor.settings(ROWS));
        measurement.set(sensor.settings(ROWS), profile);
        let readings: Vec<(f64, Reading)> = (0..count)
            .map(|_| {
                let (distance, height) = anywhere(&mut random);
                let measured = sensor.frame(&mut measurement, distance, height, &mut random);
                let reading = measured.reading(Some(&self.calibration), &self.errors, Surface::Off);
                let reading = reading.expect("in range");
                (reading.distance.to_f64() - 1e6 * distance, reading)
            })
            .collect();
        let u = |reading: &Reading| reading.uncertainty.to_f64();
        let over: Vec<f64> = readings.iter().map(|(error, it)| error / u(it)).collect();
        let errors: Vec<f64> = readings.iter().map(|(error, _)| *error).collect();
        let mut sorted: Vec<f64> = readings.iter().map(|(_, it)| u(it)).collect();
        sorted.sort_by(f64::total_cmp);
        let misfits: f64 = readings.iter().map(|(_, it)| f64::from(it.misfits)).sum();
        Judged {
            within: over.iter().filter(|over| over.abs() <= 2.0).count() as f64 / count as f64,
            over_u: rms(&over),
            u_um: sorted[count / 2],
            rms_um: rms(&errors),
            flagged: misfits / (count * usize::from(ROWS)) as f64,
        }
    }
}

#[test]
fn probe() {
    for estimator in [Estimator::PhaseTable, Estimator::Adaptive] {
        for skewness in [0.0, 0.1] {
            let sensor = Sensor::of(skewness, estimator);
            let calibrated = sensor.calibrate(None, 1);
            println!("{:?}", calibrated.profile);
            println!(
                "{}",
                serde_json::to_string(&slitrange_tool::record_file::Shown::of(
                    &slitrange::record::encoded::EncodedRecord::new(slitrange::record::Record {
                        profile: Some(calibrated.profile),
                        calibration: calibrated.calibration.clone(),
                        errors: calibrated.errors.clone(),
                        ..slitrange::record::Record::nominal().expect("r")
                    })
                    .expect("e")
                ))
                .expect("j")
            );
            for profile in [Some(calibrated.profile), None] {
                let it = calibrated.judge(&sensor, profile, 1000, 2);
                println!(
                    "{} skewness {skewness}, profile {}: within 2u {:.3}, error/u {:.2}, u {:.2} um, rms {:.2} um, flags {:.4}, \
                 repaired {:.4}",
                    estimator.name(),
                    profile.is_some(),
                    it.within,
                    it.over_u,
                    it.u_um,
                    it.rms_um,
                    it.flagged,
                    sensor.repaired(profile.as_ref(), 1000, 3)
                );
            }
        }
    }
}
