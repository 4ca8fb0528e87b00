//! Properties that hold for all inputs.

use crate::support::*;
use slitrange::centre::WidthClass;
use slitrange::row::Background;
use slitrange_device::protocol::command::MAX_LINE;
use slitrange_device::protocol::input::{Echo, Input};

fn measurement(geometry: Geometry, rows: u16, black_level: BlackLevel) -> Measurement {
    let options = options(|it| (it.rows, it.black_level) = (rows, black_level));
    Measurement::new(geometry, options)
}

fn counts() -> impl Strategy<Value = Counts> {
    prop_oneof![0..4096 * 256, any::<i32>()].prop_map(Counts::from_bits)
}

fn pixels() -> impl Strategy<Value = Pixels> {
    prop_oneof![0..4096 * 65536, any::<i32>()].prop_map(Pixels::from_bits)
}

prop_compose! {
    /// Any spot, be it one that the search would never find.
    fn spots()(
        centre in prop_oneof![0..5000usize, any::<usize>()],
        block_log2 in prop_oneof![0..9u32, any::<u32>()],
        [height, level, noise] in [counts(), counts(), counts()],
    ) -> Spot {
        let background = Background { level, noise };
        Spot { centre, block_log2, height, background, black_level: level }
    }
}

prop_compose! {
    /// Any row before, of any table.
    fn befores()(
        [centre, width] in [pixels(), pixels()],
        (set, table) in (0..9u8, 0..40u8),
        block in prop_oneof![prop::sample::select(&BLOCKS[..]), any::<u8>()],
    ) -> RowCentre {
        let class = WidthClass { set, table, block };
        with(row_centre(0.0, 1.0 / 65536.0), |it| {
            (it.centre, it.width, it.class) = (centre, width, class);
        })
    }
}

/// Rows of any length: any 12-bit counts, extremes, blocks on a flat row, or a few gaussians on noise.
fn rows() -> impl Strategy<Value = Vec<u16>> {
    let blocks = prop::collection::vec((0..4096usize, 1..400usize, 0..4096u16), 0..8);
    let width = prop_oneof![0.2..2.0f64, 2.0..20.0f64, 20.0..200.0f64];
    let spots = prop::collection::vec((0.0..1.0f64, width, 0.0..6000.0f64), 1..4);
    prop_oneof![
        2 => prop::collection::vec(0..4096u16, 0..=4096),
        2 => prop::collection::vec(prop_oneof![Just(0u16), Just(4095)], 0..=4096),
        2 => (0..4096u16, 0..=4096usize, blocks).prop_map(|(level, length, blocks)| {
            let mut row = vec![level; length];
            for (start, block, value) in blocks {
                let end = (start + block).min(length);
                row[start.min(end)..end].fill(value);
            }
            row
        }),
        4 => (32..=4096usize, 0.0..1000.0f64, spots, 0..8u32, any::<u32>()).prop_map(
            |(length, level, spots, bits, seed)| {
                let count = |i: usize| {
                    let light = |&(place, width, height): &(f64, f64, f64)| {
                        let u = (i as f64 - place * length as f64) / width;
                        height * (-0.5 * u * u).exp()
                    };
                    let mixed = (i as u32).wrapping_mul(seed | 1).wrapping_mul(0x9e37_79b9);
                    let noise = mixed >> (32 - bits.max(1));
                    (level + spots.iter().map(light).sum::<f64>() + f64::from(noise)).min(4095.0) as u16
                };
                (0..length).map(count).collect()
            }
        ),
    ]
}

fn is_width(width: Pixels) -> bool {
    (0.45..=171.0).contains(&width.to_f64())
}

/// What an estimator may let out: a place on the row that is certain to an eighth of the width (which some
/// then correct by up to an eighth, for the next row), of a spot that has a height.
fn is_sane(found: &RowCentre, pixels: usize) -> bool {
    let place = found.centre.to_f64();
    let (width, uncertainty) = (found.width.to_f64(), found.uncertainty.to_f64());
    (-0.5..=pixels as f64 - 0.5).contains(&place)
        && is_width(found.width)
        && uncertainty > 0.0
        && uncertainty <= width / 7.0 + 1e-3
        && found.amplitude.to_bits() > 0
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// No row, spot or row before makes an estimator or the check panic. Every result is in its range.
    #[test]
    fn any_row_gives_a_centre_or_a_fault(
        light in rows(),
        spot in spots(),
        found in any::<bool>(),
        before in prop::option::of(befores()),
        bits in 0..20u8,
        shot in any::<u16>(),
        saturation in prop_oneof![Just(4095), any::<u16>()],
    ) {
        let geometry = Geometry { bits, saturation, ..geometry(light.len(), shot) };
        let row = slitrange::row::Row::new(&light, &[], saturation).expect("12 bits");
        let ((spot, budget), found) = match slitrange::spot::find(&row) {
            Ok(of_row) if found => (of_row, true),
            _ => ((spot, WorkBudget::of_row()), false),
        };
        // Of a spot and a row before that cannot be, anything may come but a panic.
        let can_be = found && before.is_none_or(|before| is_width(before.width));
        for estimator in Estimator::ALL {
            let alone = centre::centre(estimator, &row, &spot, before.as_ref(), &geometry);
            let before = before.as_ref();
            let checked =
                centre_of_spot(estimator, &row, &spot, before, &geometry, None, budget);
            for found in [alone, checked].iter().flatten() {
                prop_assert!(!can_be || is_sane(found, light.len()), "{estimator:?}: {found:?}");
            }
        }
    }

    /// Rows of any length, with the parts of the sensor at any place. If the words cannot be a row, the
    /// result is the fault "sensor silent".
    #[test]
    fn any_geometry_and_length_gives_a_result(
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
            saturation: b,
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

    /// No row makes the measurement of a comb panic, by any estimator. A reading has its slits.
    #[test]
    fn any_row_of_a_comb_gives_a_reading_or_a_fault(
        light in rows(),
        x0 in 0.0..4096.0f64,
        width in 0.5..40.0f64,
        height in 0.0..5000.0f64,
        covered in any::<u16>(),
    ) {
        let comb = Comb::nominal();
        let mut light = light;
        for (slit, bit) in comb.slits().iter().zip(0..) {
            let centre = slit.from_axis(Pixels::from_f32(x0 as f32)).to_f64();
            for (count, i) in light.iter_mut().zip(0u32..) {
                let u = (f64::from(i) - centre) / width;
                let more = if covered >> bit & 1 == 0 { height * (-0.5 * u * u).exp() } else { 0.0 };
                *count = (f64::from(*count) + more).min(4095.0) as u16;
            }
        }
        let geometry = geometry(light.len(), 6554);
        for estimator in Estimator::ALL {
            let options =
                options(|it| (it.estimator, it.rows, it.slits) = (estimator, 2, Slits::Comb));
            let mut measurement = Measurement::new(geometry.clone(), options);
            prop_assert!(measurement.row(&mut light.clone()).is_none());
            let result = measurement.row(&mut light.clone()).expect("a frame of two rows");
            if let Ok(measured) = result {
                let comb = measured.comb.expect("slits");
                prop_assert!(usize::from(comb.used) >= FEWEST && comb.used <= 16);
                prop_assert!(comb.surface.to_bits() >= 0 && measured.frame.uncertainty.to_bits() > 0);
            }
        }
    }

    #[test]
    fn a_frame_is_complete_after_its_rows(rows in 1..=64u16, level in 0..4096u16) {
        let mut measurement = measurement(sensor_heads::tcd1304dg(), rows, BlackLevel::Shielded);
        for row in 1..=rows {
            let mut words: Vec<u16> = (0..3694).map(|i| level.saturating_sub(i % 3)).collect();
            prop_assert_eq!(measurement.row(&mut words).is_some(), row == rows);
        }
    }

    /// A constant on all words changes no bit of a reading but the black level, if they stay within 12 bits.
    #[test]
    fn a_constant_changes_the_black_level_only(
        centre in 1250.0..2600.0f64,
        width in 0.8..100.0f64,
        amplitude in 100.0..1500.0f64,
        offset in 1..1500u16,
        noise in any::<u32>(),
    ) {
        let read = |offset: u16| -> Result<Reading, Fault> {
            let word = |i: u32| {
                let u = (f64::from(i) - 34.0 - centre) / width;
                let dither = i.wrapping_mul(noise | 1) >> 29;
                (3900.0 - amplitude * (-0.5 * u * u).exp()) as u16 - dither as u16 - offset
            };
            let mut words: Vec<u16> = (0..3694).map(word).collect();
            let result = measurement(sensor_heads::tcd1304dg(), 1, BlackLevel::Shielded).row(&mut words);
            let measured = result.expect("a frame of one row is complete")?;
            nominal_reading(&measured, &CalibrationErrors::Unknown, Surface::Off)
        };
        let without_black = |reading: Reading| Reading { black_level: Counts::from_int(0), ..reading };
        let (dark, light) = (read(0), read(offset));
        prop_assert_eq!(dark.map(without_black), light.map(without_black));
        if let (Ok(dark), Ok(light)) = (dark, light) {
            let rise = light.black_level.to_bits() - dark.black_level.to_bits();
            prop_assert_eq!(rise, Counts::from_int(i32::from(offset)).to_bits());
        }
    }

    /// Bytes in any order give at most one answer for each line end, or one for a line that is too long.
    #[test]
    fn bytes_give_no_more_answers_than_lines(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let ends = bytes.iter().filter(|&&byte| byte == b'\r' || byte == b'\n').count();
        let most = ends + bytes.len() / MAX_LINE;
        let mut input = Input::new();
        let answers = bytes.iter().filter_map(|&byte| input.take(byte)).count();
        prop_assert!(answers <= most, "{answers} answers to {ends} ends");
        let (mut typed, mut echo) = (Input::new(), Echo::default());
        let answers = bytes.iter().filter_map(|&byte| typed.type_in(byte, &mut echo)).count();
        prop_assert!(answers <= most, "{answers} answers to {ends} typed ends");
    }

    /// A terminal shows the line that is read: what it shows, less what was taken back, is the command.
    #[test]
    fn a_typed_line_is_the_one_that_is_shown(bytes in prop::collection::vec(
        prop_oneof![8 => b' '..=b'~', 1 => Just(8u8), 1 => Just(127u8), 1 => Just(3u8)], 0..MAX_LINE,
    )) {
        let (mut typed, mut echo) = (Input::new(), Echo::default());
        let mut shown = Vec::new();
        for &byte in &bytes {
            prop_assert_eq!(typed.type_in(byte, &mut echo), None);
            match echo.as_str() {
                "\u{8} \u{8}" => drop(shown.pop()),
                "\r\n" => shown.clear(),
                character => shown.extend(character.bytes()),
            }
        }
        prop_assert_eq!(typed.is_empty(), shown.is_empty());
        let mut sent = Input::new();
        shown.push(b'\r');
        let command = shown.iter().find_map(|&byte| sent.take(byte));
        prop_assert_eq!(typed.type_in(b'\r', &mut echo), command);
    }
}

/// Words of a TCD1304DG's row: spots of so many counts at places on the light range, of a width in pixels, on
/// a noise of a few counts.
fn words_of(spots: &[(f64, f64, f64)]) -> Vec<u16> {
    let first = sensor_heads::tcd1304dg().light.start as f64;
    let light = |i: u32| {
        let of = |&(centre, width, height): &(f64, f64, f64)| {
            let u = (f64::from(i) - first - centre) / width;
            height * (-0.5 * u * u).exp()
        };
        let noise = i.wrapping_mul(2_654_435_761) >> 30;
        200.0 + spots.iter().map(of).sum::<f64>() + f64::from(noise)
    };
    let word = |i| 4095 - light(i).min(4095.0) as u16;
    (0..3694).map(word).collect()
}

/// Rows that a sensor can deliver give every kind of fault with every estimator, and also a reading.
#[test]
fn every_fault_is_reachable() {
    let spots = |centres: Vec<f64>| {
        let spots = centres.into_iter().map(|it| (it, 8.0, 2000.0));
        words_of(&spots.collect::<Vec<_>>())
    };
    let spot = |centre| spots(vec![centre]);
    // Images 1 mm apart fit the mask in no way that is better than another.
    let even = spots((0..14).map(|i| 900.3 + 132.0 * f64::from(i)).collect());
    let dim = || words_of(&[(1800.3, 8.0, 3.5)]);
    let cut = || words_of(&[(1800.3, 1.0, 60_000.0)]);
    let cases: [(&str, Vec<Vec<u16>>, bool); 15] = [
        ("reading", vec![spot(1800.3)], true),
        ("sensor silent", vec![vec![0xffff; 3694]], true),
        ("no spot", vec![words_of(&[])], true),
        ("too dim", vec![dim()], true),
        ("saturated", vec![cut()], true),
        ("too dim at the longest exposure", vec![dim()], true),
        ("saturated at the shortest exposure", vec![cut()], true),
        ("spot at the edge", vec![spot(-6.0)], true),
        ("two spots", vec![spots(vec![1500.3, 1800.3])], true),
        ("unsteady", vec![spot(1800.3), spot(1900.3)], true),
        ("out of range", vec![spot(100.3)], true),
        ("not calibrated", vec![spot(1800.3)], false),
        ("too few slits", vec![spot(1800.3)], true),
        ("slits unclear", vec![even], true),
        ("laser off", vec![spot(1800.3)], true),
    ];
    for (estimator, (name, rows, calibrated)) in pairs(Estimator::ALL, &cases) {
        let is_comb = name.contains("slits");
        let options = options(|it| {
            (it.estimator, it.rows) = (estimator, rows.len() as u16);
            it.slits = if is_comb { Slits::Comb } else { Slits::One };
            it.laser = *name != "laser off";
        });
        let mut measurement = Measurement::new(sensor_heads::tcd1304dg(), options);
        let exposure = match *name {
            "too dim at the longest exposure" => Some(Exposure::LONGEST),
            "saturated at the shortest exposure" => Some(Exposure::SHORTEST),
            _ => None,
        };
        let of_row = |row: &Vec<u16>| measurement.row_with(&mut row.clone(), exposure, None);
        let result = rows.iter().filter_map(of_row).last();
        let calibration = Calibration::nominal().filter(|_| *calibrated);
        let errors = CalibrationErrors::Unknown;
        let result = (result.expect("the frame is complete"))
            .and_then(|found| found.reading(calibration.as_ref(), &errors, Surface::Off));
        let found = result.map_or_else(|fault| fault.name(), |_| "reading");
        assert_eq!(found, *name, "{estimator:?}: {result:?}");
    }
    // Only a session finds spikes.
    for name in Fault::NAMES.into_iter().filter(|name| *name != "spike") {
        assert!(cases.iter().any(|(case, ..)| *case == name), "{name}");
    }
}
