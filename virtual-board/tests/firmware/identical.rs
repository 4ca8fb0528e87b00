//! Compares the chip with a PC: the core on the PC gets the words of the sensor head and the chip's settings.
//! Every line must be the same text.

use std::collections::BTreeMap;

use simulator::scene::{self, SecondReflection};
use slitrange::Surface;
use slitrange::base::exposure;
use slitrange::centre;
use slitrange::frame::comb::Comb;
use slitrange::light::ambient::AmbientMode;
use slitrange::spot;
use slitrange::spot::region::Region;
use slitrange_device::protocol::line::{FaultLine, ReadingLine};

use super::common::*;

/// The two states of the calibration's switch, and what the line of a good centre then is.
pub const CALIBRATIONS: [(&str, &str); 2] = [
    ("calibration on", "reading"),
    ("calibration off", "not calibrated"),
];

/// A random spot on each row: anywhere and beyond the edges, narrower and wider than the estimators allow,
/// from lost in the noise to three times full scale. One row in six has a second spot.
fn any_spots(seed: u64) -> LightSource {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut of_the_second = ChaCha8Rng::seed_from_u64(seed + 1);
    let mut row = 0;
    Box::new(move |_: &Exposure| {
        row += 1;
        let second = SecondReflection {
            offset: of_the_second.random_range(-2000.0..2000.0),
            width: logarithmic(&mut of_the_second, 2.0, 40.0),
            strength: of_the_second.random_range(0.3..1.5),
        };
        let scene = Scene {
            seed,
            second_reflection: (row % 6 == 0).then_some(second),
            black_level: Some(scene::BlackLevel::steady(random.random_range(50.0..800.0))),
            spot: Some(Spot::new(
                logarithmic(&mut random, 0.8, 130.0),
                logarithmic(&mut random, 4.0, 12_000.0),
            )),
            ..Scene::white_paper()
        };
        scene.row_with_centre(row, random.random_range(-20.0..3668.0), 1.0)
    })
}

/// Spots within a pixel or two of each other, so that the rows of a frame more or less agree. In other rows
/// the spots swing.
fn spots_nearby(seed: u64) -> LightSource {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut row = 0;
    Box::new(move |_: &Exposure| {
        row += 1;
        let scene = Scene {
            seed,
            spot: Some(Spot::new(8.6, logarithmic(&mut random, 8.0, 12_000.0))),
            ..Scene::white_paper()
        };
        let scatter = if row % 100 < 50 { 0.0 } else { 2.0 };
        let wave = if row % 200 < 100 { 0.0 } else { 0.3 };
        let swing = wave * (row as f64 / 4.0).sin();
        let centre = 1800.0 + swing + scatter * random.random_range(-1.0..1.0);
        scene.row_with_centre(row, centre, 1.0)
    })
}

pub fn logarithmic(random: &mut ChaCha8Rng, least: f64, most: f64) -> f64 {
    random.random_range(least.ln()..most.ln()).exp()
}

pub fn options(change: impl FnOnce(&mut Options)) -> Options {
    let mut options = Options {
        exposure: ExposureMode::Fixed(exposure::Exposure::LONGEST),
        ..Options::default()
    };
    change(&mut options);
    options
}

/// Runs a board after these commands, and asserts that its lines from number `first` on are the PC's. The
/// exposure is fixed unless a command says otherwise. Gives every row since the start of the firmware, these
/// lines, and the number of lines of each kind.
pub fn run_as_on_this_pc(
    light: LightSource,
    commands: &[&str],
    rows: u64,
    first: usize,
    options: Options,
) -> (Vec<Row>, Vec<String>, BTreeMap<String, usize>) {
    let (mut board, _) = boot(light);
    keep_all_rows(&mut board);
    for command in [&["exposure 5600"], commands].concat() {
        set(&mut board, command);
    }
    board.take_lines();
    // A row takes 5.7 ms.
    let longest = PATIENCE + Duration::from_millis(6) * rows as u32;
    board.run_until_rows(rows, longest).expect("rows");
    // Wait until the last row has its line.
    run_ms(&mut board, 5);
    let chip = take_results(&mut board).split_off(first);
    let shown = kept_rows(&mut board);
    // The comparison below would not notice a lost row or a dropped line.
    Status::ask(&mut board).assert_nothing_lost();
    // Nobody calibrated this sensor.
    let is_on = !commands.contains(&"calibration off");
    let calibration = Calibration::nominal().filter(|_| is_on);
    let errors = CalibrationErrors::Nominal;
    let pc = calibrated_on_this_pc(&chip, &shown, options, calibration.as_ref(), &errors);
    let kinds = assert_same(&chip, &pc, if options.rows == 1 { 2 } else { 1 });
    println!("{commands:?}: {} lines are the same: {kinds:?}", chip.len());
    (shown, chip, kinds)
}

/// For how long the laser was on in a row, if the setting does not say so.
fn exposure(row: &Row, options: &Options) -> Option<exposure::Exposure> {
    if let ExposureMode::Fixed(exposure) = options.exposure {
        return Some(exposure);
    }
    let us = u16::try_from(row.exposure.laser / 1000).expect("shorter than a row");
    exposure::Exposure::from_us(us)
}

/// The PC's lines from the chip's first line on. A frame may begin with any row, and lines before the chip's
/// may have other settings.
pub fn calibrated_on_this_pc(
    chip: &[String],
    rows: &[Row],
    options: Options,
    calibration: Option<&Calibration>,
    errors: &CalibrationErrors,
) -> Vec<String> {
    let of_frame = match options.ambient {
        AmbientMode::Subtract => 2 * options.rows,
        _ => options.rows,
    };
    // Frames that share most rows may give one line alike, but not four.
    let begins = &chip[..4];
    for first in 0..usize::from(of_frame) {
        let mut pc = lines_of_pc(&rows[first..], options, calibration, errors, None);
        if let Some(from) = (0..pc.len()).find(|&from| pc[from..].starts_with(begins)) {
            return pc.split_off(from);
        }
    }
    panic!("the PC nowhere says {begins:#?}")
}

/// The line for each frame of the rows, with a calibration's uncertainties, and a comb if it is not nominal.
pub fn lines_of_pc(
    rows: &[Row],
    options: Options,
    calibration: Option<&Calibration>,
    errors: &CalibrationErrors,
    comb: Option<Comb>,
) -> Vec<String> {
    let mut measurement = Measurement::new(sensor_heads::tcd1304dg(), options);
    comb.into_iter().for_each(|comb| measurement.set_comb(comb));
    let subtracts = options.ambient == AmbientMode::Subtract;
    rows.iter()
        // The laser is off until the firmware knows its settings.
        .skip_while(|row| subtracts && row.exposure.laser == 0)
        .filter_map(|row| {
            if subtracts && row.exposure.laser == 0 {
                measurement.ambient_row(&row.words);
                return None;
            }
            measurement.row_with(&mut row.words.clone(), exposure(row, &options), None)
        })
        .map(|result| {
            match result.and_then(|measured| measured.reading(calibration, errors, Surface::Auto)) {
                Ok(reading) => ReadingLine(&reading).to_string(),
                Err(fault) => FaultLine(&fault, Region::ALL).to_string(),
            }
        })
        .collect()
}

/// How many pixels the estimator summed to one sample; `None` without a centre.
fn block_of(row: &Row) -> Option<u8> {
    let geometry = sensor_heads::tcd1304dg();
    let row = geometry.row(&row.words).ok()?;
    let (spot, _) = spot::find(&row).ok()?;
    let centre = centre::centre(Estimator::default(), &row, &spot, None, &geometry).ok()?;
    Some(centre.class.block)
}

/// Compares line by line, and counts the lines of each kind. At either end, at most `more` lines are missing.
pub fn assert_same(chip: &[String], pc: &[String], more: usize) -> BTreeMap<String, usize> {
    let (ours, theirs) = (pc.len(), chip.len());
    assert!(ours.abs_diff(theirs) <= more, "{ours} and {theirs} lines");
    let mut kinds = BTreeMap::new();
    for (i, (chip, pc)) in chip.iter().zip(pc).enumerate() {
        assert_eq!(chip, pc, "line {i}: the chip and the PC");
        let kind = match chip.strip_prefix("f ") {
            Some(fault) => fault.split(':').next().unwrap_or_default(),
            None => "reading",
        };
        *kinds.entry(kind.to_owned()).or_insert(0) += 1;
    }
    kinds
}

#[test]
fn every_row_gives_the_same_line_on_the_chip_and_on_a_pc() {
    const ROWS: u64 = 420;
    for (command, _) in CALIBRATIONS {
        // The first line may still belong to a frame of 16 rows.
        let (commands, options) = ([command, "rows 1"], options(|it| it.rows = 1));
        let (rows, chip, kinds) = run_as_on_this_pc(any_spots(5), &commands, ROWS, 1, options);
        assert!(chip.len() >= 300, "{}", chip.len());

        let mut blocks = BTreeMap::new();
        for block in rows[rows.len() - chip.len()..].iter().filter_map(block_of) {
            *blocks.entry(block).or_insert(0) += 1;
        }
        println!("centres by pixels in a sample: {blocks:?}");
        assert!(blocks.keys().eq(&centre::tables::BLOCKS), "{blocks:?}");
        for name in Fault::NAMES {
            let here = match name {
                // A frame of one row cannot be unsteady.
                "sensor silent" | "unsteady" | "laser off" | "spike" => false,
                // These are faults of a comb and of auto exposure.
                "too few slits" | "slits unclear" => false,
                "too dim at the longest exposure" | "saturated at the shortest exposure" => false,
                "out of range" => command.ends_with("on"),
                "not calibrated" => command.ends_with("off"),
                _ => true,
            };
            assert_eq!(kinds.contains_key(name), here, "{name}: {kinds:?}");
        }
        let reads = kinds.contains_key("reading");
        assert_eq!(reads, command.ends_with("on"), "{kinds:?}");
    }
}

#[test]
fn every_frame_gives_the_same_line_on_the_chip_and_on_a_pc() {
    for (rows, of_all, mean) in [
        (5, 300, Mean::Weighted),
        (16, 900, Mean::Weighted),
        (16, 400, Mean::Plain),
    ] {
        let set_mean = format!("mean {}", mean.name());
        let commands = ["black frame", &set_mean, &format!("rows {rows}")];
        let options = options(|it| {
            (it.rows, it.mean, it.black_level) = (rows, mean, BlackLevel::Frame);
        });
        let (_, chip, kinds) = run_as_on_this_pc(spots_nearby(6), &commands, of_all, 1, options);
        assert!(chip.len() >= 20);
        let alike = chip.iter().filter(|line| line.contains(" c ")).count();
        println!("{alike} of rows that err alike");
        assert!(kinds["reading"] >= 15, "{kinds:?}");
        assert!(rows < 8 || alike >= 5, "{alike}");
    }
}

/// An estimator that computes in another way than the default, in floats.
#[test]
fn gauss_newton_gives_the_same_lines_on_the_chip_and_on_a_pc() {
    assert_same_lines(&[Estimator::GaussNewton]);
}

#[test]
#[ignore = "starts the board six times, 16 s; .ci/run runs it"]
fn every_estimator_gives_the_same_lines_on_the_chip_and_on_a_pc() {
    assert_same_lines(&[
        Estimator::Centroid,
        Estimator::Adaptive,
        Estimator::Fraunhofer,
    ]);
}

fn assert_same_lines(estimators: &[Estimator]) {
    const ROWS: u64 = 70;
    for &estimator in estimators {
        let command = format!("estimator {}", estimator.name());
        // Without a calibration, a line gives all bits of a centre; with it, the misfits.
        for (switch, centre) in CALIBRATIONS {
            let commands = [switch, "rows 1", &command];
            let options = options(|it| (it.rows, it.estimator) = (1, estimator));
            // The first two lines may still be from the estimator before.
            let (_, chip, kinds) = run_as_on_this_pc(any_spots(7), &commands, ROWS, 2, options);
            assert!(chip.len() >= 40);
            assert!(kinds[centre] >= 5, "{kinds:?}");
        }
    }
}
