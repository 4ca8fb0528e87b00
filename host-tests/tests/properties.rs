//! What holds for all inputs.

use proptest::prelude::*;
use slitrange::black_level::BlackLevel;
use slitrange::calibration::Calibration;
use slitrange::frame::Mean;
use slitrange::measurement::{Measurement, Settings};
use slitrange::protocol::command::{self, MAX_LINE};
use slitrange::protocol::input::Input;
use slitrange::reading::{Fault, Reading};
use slitrange::row::{Geometry, Polarity};
use slitrange::sensor_heads;
use slitrange::triangulation::NOMINAL;
use slitrange::units::Counts;

fn measurement(geometry: Geometry, rows: u16, black_level: BlackLevel) -> Measurement {
    let calibration = Calibration::nominal();
    Measurement::new(
        geometry,
        Settings {
            estimator: slitrange::estimator::Estimator::default(),
            rows,
            mean: Mean::default(),
            black_level,
            calibration,
        },
    )
}

fn black_levels() -> impl Strategy<Value = BlackLevel> {
    prop_oneof![
        Just(BlackLevel::Shielded),
        Just(BlackLevel::Frame),
        (0..4096).prop_map(|counts| BlackLevel::Fixed(Counts::from_int(counts))),
    ]
}

/// Words of a TCD1304DG's row: anything at all, anything the converter can make, or a flat row with a few blocks on it.
fn words() -> impl Strategy<Value = Vec<u16>> {
    let blocks = prop::collection::vec((0..3694usize, 1..400usize, 0..4096u16), 0..8);
    prop_oneof![
        prop::collection::vec(any::<u16>(), 3694),
        prop::collection::vec(0..4096u16, 3694),
        prop::collection::vec(prop_oneof![Just(0u16), Just(4095)], 3694),
        (0..4096u16, blocks).prop_map(|(level, blocks)| {
            let mut words = vec![level; 3694];
            for (start, length, value) in blocks {
                let end = (start + length).min(words.len());
                words[start..end].fill(value);
            }
            words
        }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// No row stops the measurement, and a distance comes from within the calibration only, with an uncertainty.
    #[test]
    fn any_row_gives_a_reading_or_a_fault(mut words in words(), black_level in black_levels()) {
        let mut measurement = measurement(sensor_heads::tcd1304dg(), 1, black_level);
        let result = measurement.row(&mut words).expect("a frame of one row is complete");
        if let Ok(reading) = result {
            let (from, to) = NOMINAL.expect("a curve").valid();
            prop_assert!(reading.centre >= from && reading.centre <= to, "{reading}");
            prop_assert!(reading.centre_uncertainty.to_bits() > 0, "{reading}");
            prop_assert_eq!((reading.rows_used, reading.rows), (1, 1));
        }
    }

    /// Rows of any length, parts of any place: a row that is none is a silent sensor.
    #[test]
    fn any_geometry_and_length_is_borne(
        length in 0..6000usize,
        geometry in (any::<[u16; 5]>(), any::<bool>(), any::<u8>()),
        seed in any::<u32>(),
    ) {
        let ([words, a, b, c, d], falling, bits) = geometry;
        let geometry = Geometry {
            words: if words % 2 == 0 { length } else { usize::from(words) },
            shielded: usize::from(a % 100)..usize::from(b % 100),
            light: usize::from(c % 2000)..usize::from(d % 6000),
            polarity: if falling { Polarity::Falling } else { Polarity::Rising },
            bits,
            shot_variance_per_count_q16: a,
        };
        let mut row: Vec<u16> =
            (0..length as u32).map(|i| (i.wrapping_mul(seed | 1) >> 20) as u16).collect();
        let fits = geometry.words == length;
        let result = measurement(geometry, 1, BlackLevel::Frame).row(&mut row);
        let result = result.expect("a frame of one row is complete");
        if !fits {
            prop_assert_eq!(result, Err(Fault::SensorSilent));
        }
    }

    /// A frame of n rows is complete after n rows, whatever they are, and counts them.
    #[test]
    fn a_frame_is_complete_after_its_rows(rows in 1..=64u16, level in 0..4096u16) {
        let mut measurement = measurement(sensor_heads::tcd1304dg(), rows, BlackLevel::Shielded);
        for row in 1..=rows {
            let mut words: Vec<u16> = (0..3694).map(|i| level.saturating_sub(i % 3)).collect();
            prop_assert_eq!(measurement.row(&mut words).is_some(), row == rows);
        }
    }

    /// A constant on all words that keeps them within 12 bits changes no bit of a reading but the black level.
    #[test]
    fn a_constant_changes_the_black_level_only(
        centre in 1250.0..2600.0f64,
        width in 0.8..100.0f64,
        amplitude in 100.0..1500.0f64,
        offset in 1..1500u16,
        noise in any::<u32>(),
    ) {
        let read = |offset: u16| -> Result<Reading, Fault> {
            let mut words: Vec<u16> = (0..3694u32)
                .map(|i| {
                    let u = (f64::from(i) - 34.0 - centre) / width;
                    let dither = i.wrapping_mul(noise | 1) >> 29;
                    (3900.0 - amplitude * (-0.5 * u * u).exp()) as u16 - dither as u16 - offset
                })
                .collect();
            measurement(sensor_heads::tcd1304dg(), 1, BlackLevel::Shielded)
                .row(&mut words)
                .expect("a frame of one row is complete")
        };
        let without_black = |reading: Reading| Reading { black_level: Counts::from_int(0), ..reading };
        let (dark, light) = (read(0), read(offset));
        prop_assert_eq!(dark.map(without_black), light.map(without_black));
        if let (Ok(dark), Ok(light)) = (dark, light) {
            let rise = light.black_level.to_bits() - dark.black_level.to_bits();
            prop_assert_eq!(rise, Counts::from_int(i32::from(offset)).to_bits());
        }
    }

    /// No line stops the parser; what it takes it would say the same way.
    #[test]
    fn any_line_is_a_command_or_an_error(line in prop_oneof![
        prop::collection::vec(any::<u8>(), 0..80).boxed(),
        "[a-z]{1,12}( [a-z0-9-]{1,9}){0,3}".prop_map(String::into_bytes).boxed(),
        "(rows|black|black fixed|stream|calibration) ?[0-9a-z]{0,6}".prop_map(String::into_bytes).boxed(),
    ]) {
        match command::parse(&line) {
            Ok(command) => prop_assert_eq!(command::parse(command.to_string().as_bytes()), Ok(command)),
            Err(error) => prop_assert!(error.to_string().starts_with('E')),
        }
    }

    /// Bytes in any order give at most an answer a line end, or one for a line that is too long.
    #[test]
    fn bytes_give_no_more_answers_than_lines(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let mut input = Input::new();
        let answers = bytes.iter().filter_map(|&byte| input.take(byte)).count();
        let ends = bytes.iter().filter(|&&byte| byte == b'\r' || byte == b'\n').count();
        prop_assert!(answers <= ends + bytes.len() / MAX_LINE, "{answers} answers to {ends} ends");
    }
}
