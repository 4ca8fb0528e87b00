//! The calibration of a comb of slits, compared with the truth.

use calibration::fit::comb::{self, FittedComb};
use calibration::fit::observed::Observed;
use calibration::fit::solve::{Solved, solve};
use calibration::points::{Point, Setup, SlitImage, SlitImages, slit_images};
use calibration::record::{self, form};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use simulator::distorted_optics::DistortedOptics;
use simulator::with;
use slitrange::frame::comb::{MAX_SLITS, NOMINAL_PLACES_UM, Slits};
use slitrange::row::sensor_heads::tcd1304dg;
use slitrange::{CalibrationErrors, Measurement, Options, Pixels, Surface};
use slitrange_device::record::date::Date;
use slitrange_device::record::{MAX_ENCODED, Record, decode, encode};
use statistics::rms;

use super::truth::seeded;

/// The range of the comb in metres.
const NEAR: f64 = 0.55;
const FAR: f64 = 1.10;

/// What displaces the light.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Flaw {
    /// A bent window: by the angle of the light.
    Window,
    /// A lens on the axis: by the place on the row, to third order. At the row's ends this is up to 55 px.
    Lens,
}

/// An unknown sensor: its geometry, the places of its slits, and what displaces the light.
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
        let optics = DistortedOptics::unknown(seed, departure).expect("a geometry");
        let fifth = match flaw {
            Flaw::Window => optics.fifth,
            Flaw::Lens => 0.0,
        };
        Self {
            optics: DistortedOptics { fifth, ..optics },
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
            let x_px = self.centre(slit, distance) + error(slit);
            Some(SlitImage::new(x_px, 800.0 + 40.0 * slit as f64))
        })
    }

    fn exact(&self, distance: f64) -> SlitImages {
        self.images(distance, |_| 0.0)
    }

    /// Points at even steps, with the noise of each centre in pixels.
    fn points(&self, count: usize, noise: f64, random: &mut ChaCha8Rng) -> Vec<Point> {
        let mut at = |i| {
            let distance = NEAR + (FAR - NEAR) * i as f64 / (count - 1) as f64;
            let images = self.images(distance, |_| noise * normal(random));
            point(i, distance, images)
        };
        (0..count).map(&mut at).collect()
    }
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// A point, whose centre the fit finds from the images.
fn point(index: usize, distance: f64, slits: SlitImages) -> Point {
    Point {
        line: index as u64 + 2,
        d_mm: 1e3 * distance,
        slits: Some(slits),
        ..Point::default()
    }
}

/// A calibration as the sensor reads it from its record.
fn calibrated(points: &[Point]) -> (FittedComb, Solved, Record) {
    let comb = comb::fit(points).expect("a fit").expect("a comb");
    let solved = solve(&comb.points, None).expect("a fit");
    let made = form::make(&solved, None).expect("a calibration");
    let date = Date::new(2026, 11, 23).expect("a day");
    let record = record::of(&Setup::default(), date, &solved, &made, Some(&comb));
    let mut buffer = [0; MAX_ENCODED];
    let read = decode(encode(&record, &mut buffer).expect("a record")).expect("a record");
    assert_eq!(read, record);
    (comb, solved, read)
}

/// x0 of images, weighed by their light as on the sensor.
fn x0(record: &Record, images: &SlitImages) -> Pixels {
    let slits = record.comb.as_ref().expect("a comb").slits();
    let (mut sum, mut weights) = (0.0, 0.0);
    for (slit, image) in slits.iter().zip(images) {
        if let Some(image) = image {
            let centre = Pixels::from_bits((image.x_px * 65536.0).round() as i32);
            sum += image.height_counts * slit.to_axis(centre).to_f64();
            weights += image.height_counts;
        }
    }
    Pixels::from_bits((sum / weights * 65536.0).round() as i32)
}

/// Errors of a record's distances in micrometres between the points. `images` gives those of a distance.
fn errors_of(record: &Record, mut images: impl FnMut(f64) -> SlitImages) -> Vec<f64> {
    let error = |distance| {
        let x0 = x0(record, &images(distance));
        let (found, _) = record.calibration.distance_at(x0).ok()?;
        Some(found.to_f64() - 1e6 * distance)
    };
    between_points(400).filter_map(error).collect()
}

/// Distances between those of the points.
fn between_points(count: u32) -> impl Iterator<Item = f64> {
    let share = move |i| (f64::from(i) + 0.37) / f64::from(count);
    (0..count).map(move |i| NEAR + (FAR - NEAR) * share(i))
}

/// Noise of a slit's centre in pixels, in a point of 8 frames of 64 rows with a quarter of full scale. One
/// frame has 0.004 px (see `whole_rows_are_calibrated`).
const NOISE: f64 = 0.001;

/// 60 points without speckle, on combs of unknown geometry.
#[test]
fn sixty_points_give_the_curve_of_a_comb_to_1_5_um() {
    let far = 300e-6;
    for (departure, flaw) in [(far, Flaw::Window), (far, Flaw::Lens), (1e-6, Flaw::Window)] {
        for noise in [NOISE, 5.0 * NOISE] {
            let mut all = vec![];
            for seed in 0..20 {
                let sensor = Sensor::unknown(seed, departure, flaw);
                let (comb, _, record) = calibrated(&sensor.points(60, noise, &mut seeded(seed)));
                let exact = errors_of(&record, |at| sensor.exact(at));
                assert!(exact.len() > 390);
                all.push(rms(&exact));
                assert!(comb.slits.iter().all(|slit| slit.degree == Some(3)));
                let sum: f64 = comb.slits.iter().map(|slit| slit.correction_px).sum();
                assert!(sum.abs() < 1e-3, "{sum}");
            }
            let error = rms(&all);
            println!("{departure} m by a {flaw:?}, noise {noise} px: RMS {error:.3} um");
            println!("each sensor: {all:.3?} um");
            assert!(error < 1.5 && all.iter().all(|&error| error < 2.0));
        }
    }
}

/// Fewer points get corrections of a lower degree, and slits without points keep the mask's drawing.
#[test]
fn few_points_get_corrections_of_a_lower_degree() {
    let sensor = Sensor::unknown(3, 1e-6, Flaw::Window);
    for (count, degree) in [(60, 3), (12, 3), (11, 2), (8, 2), (7, 1), (4, 1), (3, 0)] {
        let points = sensor.points(count, NOISE, &mut seeded(count as u64));
        let (comb, _, record) = calibrated(&points);
        println!("{count} points");
        assert!(comb.slits.iter().all(|it| it.degree == Some(degree)));
        for slit in record.comb.as_ref().expect("a comb").slits() {
            let mut higher = slit.correction().iter().skip(degree + 1);
            assert!(higher.all(|term| *term == Pixels::default()));
        }
        let error = rms(errors_of(&record, |at| sensor.exact(at)));
        println!("{count} points: degree {degree}, RMS {error:.2} um");
        assert!(error < 30.0);
    }
    // Of 60 points, some slits have few images.
    let mut points = sensor.points(60, NOISE, &mut seeded(1));
    let has = |slit: usize, index: usize| match slit {
        2 => false,
        5 => index == 30,
        6 => index == 10 || index == 50,
        7 => index.is_multiple_of(12),
        8 => index.is_multiple_of(7),
        // Many images on a part of the range.
        9 => index < 20,
        10 => index < 36,
        _ => true,
    };
    for (index, point) in points.iter_mut().enumerate() {
        for (slit, image) in point.slits.iter_mut().flatten().enumerate() {
            *image = image.filter(|_| has(slit, index));
        }
    }
    let (comb, _, record) = calibrated(&points);
    let degrees: Vec<_> = comb.slits.iter().map(|slit| slit.degree).collect();
    println!("{degrees:?}");
    // None is below 0.
    let due = [-1, 3, 3, -1, 0, 1, 2, 1, 2];
    let found = degrees[2..11].iter();
    assert!(found.map(|it| it.map_or(-1, |it| it as i32)).eq(due));
    // Whichever slits have an image, the distance is about the same: a slit without a correction is off by 5
    // um of the mask, which are 0.6 px or 0.2 mm.
    let (left, right) = (&[0, 1, 2, 3, 4, 5], &[9, 11, 12, 13, 14, 15]);
    for missing in [&[] as &[usize], &[2, 5], left, right] {
        let errors = errors_of(&record, |distance| {
            let mut images = sensor.exact(distance);
            missing.iter().for_each(|&slit| images[slit] = None);
            images
        });
        println!("without {missing:?}: RMS {:.2} um", rms(&errors));
        let without_drawing = missing.contains(&2) && missing.contains(&5);
        assert!(rms(&errors) < if without_drawing { 25.0 } else { 60.0 });
    }
}

/// Some slits have no image, and some images are a reflection's: only these images are lost.
#[test]
fn missing_and_false_images_do_not_bias_the_others() {
    let (mut all, mut counts) = (vec![], vec![]);
    for seed in 0..10 {
        let sensor = Sensor::unknown(seed, 300e-6, Flaw::Window);
        let mut random = seeded(seed);
        let mut points = sensor.points(60, NOISE, &mut random);
        for point in &mut points {
            for image in point.slits.iter_mut().flatten() {
                if random.random_bool(0.3) {
                    *image = None;
                } else if random.random_bool(0.03)
                    && let Some(image) = image
                {
                    image.x_px += random.random_range(-12.0..12.0);
                }
            }
        }
        let (comb, _, record) = calibrated(&points);
        counts.push(comb.rejected);
        all.push(rms(errors_of(&record, |at| sensor.exact(at))));
    }
    println!("RMS {:.3} um, images left out {counts:?}", rms(&all));
    // 16 * 60 * 0.7 * 0.03 = 20 false images.
    assert!(rms(&all) < 1.5 && counts.iter().all(|count| (8..40).contains(count)));
}

/// What a record says of the surface holds what the slits share, and not their scatter.
#[test]
fn the_scatter_of_the_slits_is_not_counted_twice() {
    const SETS: u64 = 40;
    // Of one count, in pixels: 1 px at 1000 counts.
    let of_one_count = 1000f64.sqrt();
    for shared_um in [0.0, 100.0] {
        let (mut found, mut sigmas, mut offs) = (vec![], vec![], vec![]);
        for seed in 0..SETS {
            let sensor = Sensor::unknown(seed, 1e-6, Flaw::Window);
            let mut random = seeded(500 + seed);
            let at = |i| {
                let distance = NEAR + (FAR - NEAR) * f64::from(i) / 59.0;
                // In proportion to d - D, D = -115 mm; `shared_um` at 0.8 m.
                let share = (distance + 0.115) / 0.915;
                let moved = distance + 1e-6 * shared_um * share * normal(&mut random);
                let mut images = sensor.exact(moved);
                for image in images.iter_mut().flatten() {
                    // The light of two speckle patterns.
                    let light = |random: &mut ChaCha8Rng| -random.random::<f64>().ln();
                    let height = 500.0 * (light(&mut random) + light(&mut random));
                    image.height_counts = height.clamp(20.0, 4000.0);
                    let deviation = of_one_count / image.height_counts.sqrt();
                    image.x_px += deviation * normal(&mut random);
                }
                point(i as usize, distance, images)
            };
            let points: Vec<Point> = (0..60).map(at).collect();
            let (comb, solved, record) = calibrated(&points);
            let CalibrationErrors::Fitted(errors) = &record.errors else {
                panic!("{:?}", record.errors);
            };
            found.push(errors.surface.as_ref().expect("60 points").deviation[4].to_f64());
            sigmas.push(comb.scatter_px);
            let curve = &solved.plain;
            let off = |it: &Observed| it.distance - curve.distance(it.centre);
            let observed = solved.observed.iter();
            offs.extend(observed.map(|it| off(it) / curve.slope(it.centre)));
        }
        println!(
            "{shared_um} um shared: found {:.1} um in the middle, scatter {:.4} px, residuals {:.4} px",
            rms(&found),
            rms(&sigmas),
            rms(&offs)
        );
        if shared_um == 0.0 {
            // One pixel is 0.38 mm in the middle, so 16 slits scatter by 95 um. 60 points know the square of
            // this scatter to sqrt(2 / 57), 19 %. So chance alone may leave sqrt(0.19) of 95 um, 41 um.
            assert!(rms(&found) < 45.0);
            assert!((rms(&sigmas) / rms(&offs) - 1.0).abs() < 0.15);
        } else {
            assert!((rms(&found) / 100.0 - 1.0).abs() < 0.25);
        }
    }
}

/// Rows of a sensor with a comb: gaussians with shot noise and read noise.
fn row(sensor: &Sensor, distance: f64, mut noise: Option<&mut ChaCha8Rng>) -> Vec<u16> {
    let head = tcd1304dg();
    let mut light = vec![0.0f64; head.words];
    for slit in 0..MAX_SLITS {
        let centre = sensor.centre(slit, distance) + head.light.start as f64;
        let from = (centre - 60.0) as usize;
        for (place, count) in light.iter_mut().enumerate().skip(from).take(121) {
            let off = (place as f64 - centre) / 8.6;
            *count += 1000.0 * (-0.5 * off * off).exp();
        }
    }
    let word = |count: f64| {
        let deviation = (count / 10.0 + 16.0).sqrt();
        let noise = noise.as_mut().map(|random| deviation * normal(random));
        let word = 4095.0 - 300.0 - count - noise.unwrap_or_default();
        word.round().clamp(0.0, 4095.0) as u16
    };
    light.into_iter().map(word).collect()
}

/// 60 points, each a frame of 64 noisy rows that the core measures behind the nominal mask. Then the core
/// measures exact rows with the record, and gives distances.
#[test]
fn whole_rows_are_calibrated() {
    let options = |rows| {
        with(Options::default(), |it| {
            (it.rows, it.slits) = (rows, Slits::Comb)
        })
    };
    let mut all = vec![];
    for seed in 0..3 {
        let sensor = Sensor::unknown(seed, 300e-6, Flaw::Window);
        let mut random = seeded(900 + seed);
        let mut measurement = Measurement::new(tcd1304dg(), options(64));
        let mut measured = |distance: f64| {
            let mut words = || row(&sensor, distance, Some(&mut random));
            let frame = (0..64).find_map(|_| measurement.row(&mut words()));
            frame.expect("64 rows").expect("a centre")
        };
        let at = |i| {
            let distance = NEAR + (FAR - NEAR) * f64::from(i) / 59.0;
            let measured = measured(distance);
            let comb = measured.comb.expect("a comb");
            assert!(comb.used >= 14);
            Point {
                x_px: measured.frame.centre.to_f64(),
                sigma_px: Some(measured.frame.uncertainty.to_f64()),
                ..point(i as usize, distance, slit_images(&comb.centres))
            }
        };
        let points: Vec<Point> = (0..60).map(at).collect();
        let (comb, _, record) = calibrated(&points);
        let mut measurement = Measurement::new(tcd1304dg(), options(1));
        measurement.set_comb(comb.comb.clone());
        let error = |distance| {
            let measured = measurement.row(&mut row(&sensor, distance, None));
            let measured = measured.expect("a row").expect("a centre");
            let calibration = Some(&record.calibration);
            let reading = measured.reading(calibration, &record.errors, Surface::Auto);
            Some(reading.ok()?.distance.to_f64() - 1e6 * distance)
        };
        let errors: Vec<f64> = between_points(200).filter_map(error).collect();
        // See `NOISE`.
        let noise = rms(comb.slits.iter().map(|slit| slit.residual_px));
        let (error, places) = (rms(&errors), errors.len());
        println!("sensor {seed}: {error:.3} um at {places} places, a slit's noise {noise:.4} px");
        all.push(error);
    }
    assert!(all.iter().all(|error| *error < 1.5));
}
