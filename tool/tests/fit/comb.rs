//! The calibration of a comb of slits, compared with the truth.

use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use simulator::distorted_optics::DistortedOptics;
use slitrange::black_level::BlackLevel;
use slitrange::centre::Estimator;
use slitrange::comb::{MAX_SLITS, NOMINAL_PLACES_UM, SlitCentres};
use slitrange::fault::Fault;
use slitrange::measurement::Measurement;
use slitrange::reading::Measured;
use slitrange::record::date::Date;
use slitrange::record::{MAX_ENCODED, Record, decode, encode};
use slitrange::sensor_heads::tcd1304dg;
use slitrange::settings::Settings;
use slitrange::uncertainty::CalibrationErrors;
use slitrange::units::Pixels;
use slitrange_tool::fit::comb::{self, FittedComb};
use slitrange_tool::fit::report::{Report, ShownComb};
use slitrange_tool::fit::solve::{Solved, solve};
use slitrange_tool::fit::{calibration, errors, figure};
use slitrange_tool::points::{Point, SlitImage, SlitImages};

use crate::truth::{rms, seeded};

/// The range of the comb in metres.
const NEAR: f64 = 0.55;
const FAR: f64 = 1.10;

/// What displaces the light.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Flaw {
    /// A bent window: by the angle of the light.
    Window,
    /// A lens on the axis: by the place on the row, which is up to three times as far from the axis.
    Lens,
}

/// A sensor that nobody has been told of: its geometry, the places of its slits, and what displaces the light.
struct Sensor {
    optics: DistortedOptics,
    places: [f64; MAX_SLITS],
    flaw: Flaw,
}

impl Sensor {
    /// Mask places are off by 5 um RMS. A slit on the axis departs from eq. (1) by `departure` metres.
    fn unknown(seed: u64, departure: f64, flaw: Flaw) -> Self {
        let mut random = seeded(100 + seed);
        let mut off = || -> f64 { StandardNormal.sample(&mut random) };
        Self {
            optics: DistortedOptics::unknown(seed, departure).expect("a geometry"),
            places: NOMINAL_PLACES_UM.map(|um| 1e-6 * (f64::from(um) + 5.0 * off())),
            flaw,
        }
    }

    /// Where a slit shows a target, in pixels. Distances count from the laser.
    fn centre(&self, slit: usize, distance: f64) -> f64 {
        let optics = self.optics.optics.behind(self.places[slit]);
        let centre = optics.centre(distance);
        let axis = match self.flaw {
            Flaw::Window => optics.axis,
            Flaw::Lens => self.optics.optics.axis,
        };
        let field = (centre - axis) / 600.0;
        centre + self.optics.third * field.powi(3) + self.optics.fifth * field.powi(5)
    }

    /// All images of a target. Their heights are those of nobody's speckle.
    fn images(&self, distance: f64, mut error: impl FnMut(usize) -> f64) -> SlitImages {
        std::array::from_fn(|slit| {
            Some(SlitImage {
                x_px: self.centre(slit, distance) + error(slit),
                height_counts: 800.0 + 40.0 * slit as f64,
            })
        })
    }

    /// Points at even steps, with the noise of each centre in pixels.
    fn points(&self, count: usize, noise: f64, random: &mut ChaCha8Rng) -> Vec<Point> {
        (0..count)
            .map(|i| {
                let distance = NEAR + (FAR - NEAR) * i as f64 / (count - 1) as f64;
                point(
                    i,
                    distance,
                    self.images(distance, |_| noise * normal(random)),
                )
            })
            .collect()
    }
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// A point, whose centre the fit finds from the images.
fn point(index: usize, distance: f64, slits: SlitImages) -> Point {
    Point {
        line: index as u64 + 2,
        x_px: 0.0,
        d_mm: 1e3 * distance,
        sigma_px: None,
        height_counts: None,
        shape: None,
        slits: Some(slits),
    }
}

/// A calibration as the sensor reads it from its record.
fn calibrated(points: &[Point]) -> (FittedComb, Solved, Record) {
    let comb = comb::fit(points).expect("a fit").expect("a comb");
    let solved = solve(&comb.points, None).expect("a fit");
    let made = calibration::make(&solved, None).expect("a calibration");
    let record = Record {
        serial_number: 1,
        date: Date::new(2026, 11, 23).expect("a day"),
        geometry: tcd1304dg(),
        estimator: Estimator::default(),
        black_level: BlackLevel::Shielded,
        errors: errors::of(&solved, &made),
        profile: None,
        calibration: made.calibration,
        comb: Some(comb.comb.clone()),
    };
    let mut buffer = [0; MAX_ENCODED];
    let bytes = encode(&record, &mut buffer).expect("a record");
    let read = decode(bytes).expect("a record");
    assert_eq!(read, record);
    (comb, solved, read)
}

/// x0 of images, weighed by their light as on the sensor.
fn x0(record: &Record, images: &SlitImages) -> Pixels {
    let slits = record.comb.as_ref().expect("a comb").slits();
    let (mut sum, mut weights) = (0.0, 0.0);
    for (slit, image) in slits.iter().zip(images) {
        if let Some(SlitImage {
            x_px,
            height_counts,
        }) = image
        {
            let centre = Pixels::from_bits((x_px * 65536.0).round() as i32);
            sum += height_counts * slit.to_axis(centre).to_f64();
            weights += height_counts;
        }
    }
    Pixels::from_bits((sum / weights * 65536.0).round() as i32)
}

/// Errors of a record's distances in micrometres at places between the points, where `images` gives those of a
/// distance.
fn errors_of(record: &Record, mut images: impl FnMut(f64) -> SlitImages) -> Vec<f64> {
    (0..400)
        .map(|i| NEAR + (FAR - NEAR) * (f64::from(i) + 0.37) / 400.0)
        .filter_map(|distance| {
            let x0 = x0(record, &images(distance));
            let (found, _) = record.calibration.distance_at(x0).ok()?;
            Some(found.to_f64() - 1e6 * distance)
        })
        .collect()
}

/// Noise of a slit's centre in pixels, in a point of 8 frames of 64 rows with a quarter of full scale: 0.02 px a
/// row (see `whole_rows_are_calibrated`).
const NOISE: f64 = 0.001;

/// 60 points without speckle, on combs of unknown geometry.
#[test]
fn sixty_points_give_the_curve_of_a_comb_to_1_5_um() {
    for (departure, flaw) in [
        (300e-6, Flaw::Window),
        (300e-6, Flaw::Lens),
        (1e-6, Flaw::Window),
    ] {
        for noise in [NOISE, 5.0 * NOISE] {
            let (mut all, mut largest, mut before, mut claims) = (vec![], 0.0f64, vec![], vec![]);
            for seed in 0..20 {
                let sensor = Sensor::unknown(seed, departure, flaw);
                let points = sensor.points(60, noise, &mut seeded(seed));
                let (comb, _, record) = calibrated(&points);
                let exact = errors_of(&record, |distance| sensor.images(distance, |_| 0.0));
                assert!(exact.len() > 390);
                largest = exact
                    .iter()
                    .fold(largest, |most, error| most.max(error.abs()));
                all.push(rms(&exact));
                before.push(rms(&comb
                    .slits
                    .iter()
                    .map(|it| it.correction_px)
                    .collect::<Vec<_>>()));
                if let CalibrationErrors::Fitted(errors) = &record.errors {
                    claims.push(rms(&errors.curve.map(|um| um.to_f64())));
                }
                assert!(comb.slits.iter().all(|slit| slit.degree == Some(3)));
                let sum: f64 = comb.slits.iter().map(|slit| slit.correction_px).sum();
                assert!(sum.abs() < 1e-3, "{sum}");
            }
            let error = rms(&all);
            println!(
                "departure of {:.0} um by a {flaw:?}, noise {noise} px: RMS {error:.3} um, worst sensor {:.3}, \
                 largest {largest:.2}, claimed {:.3}; corrections {:.2} px",
                1e6 * departure,
                all.iter().copied().fold(0.0, f64::max),
                rms(&claims),
                rms(&before),
            );
            assert!(error < 1.5 && all.iter().all(|&error| error < 2.0));
        }
    }
}
