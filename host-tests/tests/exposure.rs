//! Auto exposure: how it follows a target whose brightness changes.

use host_tests::changing_light::{DELAY, Sensor, scene};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use slitrange::exposure::{
    AutoExposure, Brightness, Exposure, ExposureMode, LEAST_PERCENT, MOST_PERCENT,
};
use slitrange::fault::Fault;
use slitrange::reading::{Measured, Reading};
use slitrange::settings::Settings;
use slitrange::uncertainty::{CalibrationErrors, Surface};
use slitrange::{Calibration, Counts};

fn us(us: u16) -> Exposure {
    Exposure::from_us(us).expect("an exposure")
}

/// The next exposure after one row.
fn after(row: u16, brightness: Brightness) -> u16 {
    let mut auto = AutoExposure::new();
    // The exposure in use is the row's.
    let here = Brightness::Height {
        height: 700,
        room: 1000,
    };
    auto.take(us(row), Brightness::Saturated { pixels: 100 }, us(row));
    auto.take(us(row), here, us(row));
    auto.take(us(row), brightness, Exposure::LONGEST);
    auto.next(Exposure::LONGEST).us()
}

/// 70 % of the room over the height, times the row's exposure.
#[test]
fn a_row_tells_the_exposure_that_fits() {
    let of = |height, room| Brightness::Height { height, room };
    let limit = us(1000);
    for (brightness, expected) in [
        (of(700, 3500), 1000),
        (of(3400, 3500), 720),
        (of(35_000, 3500), 70),
        (of(1750, 3500), 1000),
        (of(2974, 3500), 1000),
        (of(1700, 3500), 1000),
        (of(0, 3500), 1000),
        (of(65_535, 1), 10),
        (Brightness::Unknown, 1000),
        (Brightness::Nothing, 1000),
        (Brightness::Saturated { pixels: 33 }, 31),
        (Brightness::Saturated { pixels: 32 }, 250),
    ] {
        let mut auto = AutoExposure::new();
        auto.take(
            Exposure::LONGEST,
            Brightness::Saturated { pixels: 3 },
            limit,
        );
        assert_eq!(auto.next(limit), limit);
        auto.take(limit, brightness, limit);
        assert_eq!(auto.next(limit).us(), expected, "{brightness:?}");
    }
    assert_eq!(after(10, Brightness::Nothing), 1000);
    assert_eq!(after(56, of(7, 3500)), 5600);
    // Rows that were exposed before the last change bring nothing new.
    let mut auto = AutoExposure::new();
    for _ in 0..DELAY {
        auto.take(us(5600), Brightness::Saturated { pixels: 100 }, us(5600));
        assert_eq!(auto.next(Exposure::LONGEST), us(175));
    }
}

/// The scene's mean reading by frames of these settings, without what is not the rows' own.
fn reading(measured: &Measured) -> Reading {
    let calibration = Calibration::nominal();
    let errors = CalibrationErrors::Unknown;
    let reading = measured.reading(calibration.as_ref(), &errors, Surface::Off);
    reading.expect("a place in the middle of the range")
}

/// The error of a reading over its u, which holds noise, shape and pixels.
fn error_over_u(measured: &Measured, truth: f64) -> f64 {
    let calibration = Calibration::nominal().expect("a curve");
    let reading = reading(measured);
    let per_pixel = calibration.distance_at(reading.centre).expect("in range").1;
    let error = (measured.frame.centre.to_f64() - truth) * f64::from(per_pixel);
    (error / reading.uncertainty.to_f64()).abs()
}

fn is_flagged(measured: &Measured) -> bool {
    let frame = &measured.frame;
    2 * frame.misfits > frame.rows_used || frame.correlated.is_some()
}

/// Once the exposure has settled, it stays: noise does not change it from frame to frame.
#[test]
fn the_exposure_does_not_hunt() {
    for reflectivity in [1.0, 0.3, 0.03, 3e-3, 1e-3, 3e-4, 1e-4] {
        let mut sensor = Sensor::new(scene(), Settings::default());
        sensor.frames(reflectivity, 2);
        let mut seen = std::collections::BTreeMap::new();
        for _ in 0..320 {
            let (exposure, result) = sensor.row(reflectivity);
            *seen.entry(exposure.us()).or_insert(0) += 1;
            if let Some(result) = result {
                let measured = result.expect("a centre");
                assert!(error_over_u(&measured, sensor.true_centre()) < 4.0);
            }
        }
        println!("{reflectivity}: exposures {seen:?}");
        assert_eq!(seen.len(), 1, "{reflectivity}: {seen:?}");
        let (&exposure, _) = seen.first_key_value().expect("rows");
        let percent = 3e8 * reflectivity * f64::from(exposure) * 1e-6 / 3795.0 * 100.0;
        let is_longest = exposure == Exposure::LONGEST.us() && percent < 70.0;
        let band = f64::from(LEAST_PERCENT) - 1.0..=f64::from(MOST_PERCENT) + 1.0;
        assert!(is_longest || band.contains(&percent), "{percent}");
    }
}

/// Jumps between two reflectivities: how many rows pass until the frame is valid, and no reading is wrong.
fn jump(random: &mut ChaCha8Rng, jumps: u32) {
    let mut sensor = Sensor::new(scene(), Settings::default());
    let (mut worst, mut faults) = (0.0f64, [0; Fault::KINDS]);
    let mut invalid = 0;
    for number in 0..jumps {
        let reflectivity = 10f64.powf(-4.0 * random.random::<f64>());
        // The frame in which the target changes begins with rows of the target before.
        for frame in 0..2 {
            for result in sensor.frames(reflectivity, 1) {
                match result {
                    Ok(measured) => {
                        let error = error_over_u(&measured, sensor.true_centre());
                        if is_flagged(&measured) {
                            continue;
                        }
                        worst = worst.max(error);
                        assert!(
                            error <= 5.0,
                            "jump {number} to {reflectivity}, frame {frame}: off by {error} u"
                        );
                    }
                    Err(fault) => {
                        faults[fault.kind()] += 1;
                        invalid += u32::from(frame == 1);
                        assert_eq!(frame, 0, "jump {number} to {reflectivity}: {fault}");
                    }
                }
            }
        }
        // The next jump comes anywhere in a frame.
        for _ in 0..random.random_range(0..16) {
            if let (_, Some(_)) = sensor.row(reflectivity) {
                break;
            }
        }
    }
    let faults: Vec<_> = Fault::NAMES
        .iter()
        .zip(faults)
        .filter(|it| it.1 > 0)
        .collect();
    println!(
        "{jumps} jumps: {invalid} invalid second frames, largest error {worst:.2} u, first frames {faults:?}"
    );
}

#[test]
fn a_jump_of_the_brightness_costs_at_most_a_frame() {
    jump(&mut ChaCha8Rng::seed_from_u64(19), 300);
}

#[test]
#[ignore = "a million jumps take 20 minutes or more; `cargo exposure` runs them too"]
fn no_jump_of_a_million_gives_a_wrong_reading() {
    jump(&mut ChaCha8Rng::seed_from_u64(20), 1_000_000);
}

/// Short exposures make the same spot of a brighter target.
#[test]
fn exposures_are_those_of_the_settings() {
    let fixed = Settings {
        exposure: ExposureMode::Fixed(us(300)),
        ..Settings::default()
    };
    let limited = Settings {
        exposure_limit: us(200),
        ..fixed
    };
    let auto = Settings {
        exposure: ExposureMode::Auto,
        ..limited
    };
    for (settings, expected) in [(fixed, 300), (limited, 200), (auto, 200)] {
        let mut sensor = Sensor::new(scene(), settings);
        let measured = sensor
            .frames(3e-3, 3)
            .pop()
            .expect("three")
            .expect("a centre");
        assert_eq!(measured.frame.exposure, Some(us(expected)));
        let height = 3e8 * 3e-3 * f64::from(expected) * 1e-6;
        let found = measured.frame.amplitude.to_f64();
        println!("{expected} us: {found} counts, of the scene {height:.1}");
        assert!((found / height - 1.0).abs() < 0.1);
        assert!(measured.frame.amplitude > Counts::from_int(0));
    }
}

/// With auto exposure, a fault says that no exposure helps.
#[test]
fn faults_name_the_end_of_the_exposures() {
    let mut sensor = Sensor::new(scene(), Settings::default());
    let dim = sensor.frames(6e-6, 3).pop().expect("three");
    println!("{dim:?}");
    assert!(
        matches!(dim, Err(Fault::DimAtLongest { exposure, .. }) if exposure == Exposure::LONGEST),
        "{dim:?}"
    );
    let bright = sensor.frames(4.0, 3).pop().expect("three");
    println!("{bright:?}");
    assert!(
        matches!(bright, Err(Fault::SaturatedAtShortest { exposure, .. }) if exposure == us(10)),
        "{bright:?}"
    );
}
