//! The firmware behind a comb of slits: faults, the sensor's rate, the same lines as on a PC, and readings on
//! white paper with speckle.

use simulator::scene::comb::{Comb, Slit};
use std::collections::BTreeMap;
use virtual_board::upload::upload;

use super::common::*;
use super::faults::{assert_all_are, assert_distance_gives_advice};
use super::identical::{
    CALIBRATIONS, assert_same, calibrated_on_this_pc, logarithmic, options, run_as_on_this_pc,
};
use super::records;

/// The sensor's rows in a second: one in 5.7 ms.
const ROWS_PER_SECOND: f64 = 1.0 / 5.7e-3;

fn behind(comb: Comb) -> Scene {
    with(Scene::white_paper(), |it| it.comb = Some(comb))
}

pub fn paper_behind_a_comb() -> LightSource {
    of_scene(behind(Comb::nominal()), Target::at(DISTANCE))
}

/// A mask of 16 slits with even gaps.
fn even(pitch: f64) -> Comb {
    let slit = |number| Slit {
        place: pitch * (f64::from(number) - 7.5),
        width: 200e-6,
    };
    let slits = (0..16).map(slit).collect();
    Comb { slits }
}

fn settings(rows: u16) -> Options {
    options(|it| (it.rows, it.slits) = (rows, Slits::Comb))
}

fn measuring(light: LightSource, rows: u16, conditions: Conditions) -> CleanBoard {
    let (mut board, _) = boot_under(light, conditions);
    set(&mut board, "slits comb");
    set(&mut board, &format!("rows {rows}"));
    board
}

fn slits_of(line: &str) -> Option<u32> {
    let mut words = line.split(' ').skip_while(|word| *word != "k");
    Some(words.nth(1)?.parse().expect("a count of slits"))
}

fn assert_readings(lines: &[String], slits: Option<u32>) {
    for line in lines {
        assert!(is_reading(line), "readings and nothing else: {lines:#?}");
        let error = number(line, "d ", " mm") - DISTANCE * 1e3;
        assert!(error.abs() < 0.05, "{error} mm off: {lines:#?}");
        assert_eq!(slits_of(line), slits, "slits used: {line}");
    }
}

/// All results must be the fault of this name. `distance` must answer with advice, and `status` must count
/// the fault.
fn assert_fault(board: &mut VirtualBoard, name: &str) -> String {
    let line = fresh_results(board, 4);
    assert_all_are(&line, name);
    assert_distance_gives_advice(board, name);
    let status = Status::ask(board);
    assert!(status.count(&format!("fault {name}")) >= 4, "{status:#?}");
    line[0].clone()
}

#[test]
fn a_comb_is_measured_once_the_firmware_is_told() {
    let mut board = measuring_in(paper_behind_a_comb(), 4);
    // A sensor with one slit sees two spots.
    assert_all_are(&fresh_results(&mut board, 2), "two spots");
    set(&mut board, "slits comb");
    let lines = fresh_results(&mut board, 4);
    println!("{}", lines[0]);
    assert_readings(&lines, Some(16));
}

#[test]
fn one_slit_is_too_few_until_the_setting_is_right_again() {
    let mut board = measuring(paper(), 4, Conditions::default());
    let line = assert_fault(&mut board, "too few slits");
    assert_eq!(line, "f too few slits: 1, needs 4");
    set(&mut board, "slits one");
    assert_readings(&fresh_results(&mut board, 4), None);
}

#[test]
fn a_mask_with_even_gaps_is_unclear() {
    let scene = behind(even(1e-3));
    scene.check().expect("a scene");
    let light = of_scene(scene, Target::at(DISTANCE));
    let mut board = measuring(light, 4, Conditions::default());
    let line = assert_fault(&mut board, "slits unclear");
    let images = number(&line, ": ", " images");
    let other = number(&line, "place, ", " another");
    assert!(images >= 4.0 && (1.0..=images).contains(&other), "{line}");
    // The right mask brings readings back.
    board.set_light(paper_behind_a_comb());
    // Older results wait behind the answer to `status`.
    results(&mut board, 8);
    assert_readings(&fresh_results(&mut board, 4), Some(16));
}

/// Rows of white paper with speckle behind the nominal comb that come one after the other, again and again.
/// They are made beforehand, because a run takes thousands. Each has its own noise, and all of them show one
/// surface.
fn recurring() -> LightSource {
    const COUNT: u64 = 61;
    let simulation = Simulation::new(Scene::load("comb").expect("a scene"));
    let rows: Vec<Vec<f32>> = (0..COUNT)
        .map(|row| simulation.row(row, DISTANCE, 1.0 / ROWS_PER_SECOND))
        .collect();
    let mut next = rows.into_iter().cycle();
    Box::new(move |_: &Exposure| next.next().expect("rows recur for ever"))
}

/// Runs the firmware with a comb at the sensor's rate. No row is lost, all frames give readings, and the
/// core sleeps at least half of the time.
fn assert_rate(frame: u16, seconds: u64) {
    let mut board = measuring(recurring(), frame, full_speed());
    let before = Status::ask(&mut board);
    run_ms(&mut board, 300);
    let began = board.statistics();
    for second in 1..=seconds {
        run_ms(&mut board, 1_000);
        board.take_lines();
        if second % 60 == 0 {
            println!("{second} s of {seconds}");
        }
    }
    let run = board.statistics().since(&began);
    let (rows, elapsed, free) = (run.rows as f64, run.seconds, run.asleep());
    let status = Status::ask(&mut board);
    let (a_second, of_row) = (rows / elapsed, run.instructions as f64 / rows);
    let slowest = status.count("slowest row cycles");
    println!("{frame} rows a frame, {elapsed:.1} s: {rows} rows, {a_second:.2} a second");
    println!(
        "{of_row:.0} instructions a row, {free:.3} of the time free; the slowest row took {slowest}"
    );
    status.assert_nothing_lost();
    assert_eq!(status.faults(), before.faults(), "{status:#?}");
    let off = rows - ROWS_PER_SECOND * elapsed;
    assert!(off.abs() <= 2.0, "{rows} rows");
    assert!(free >= 0.5, "{free} of the time is free");
}

#[test]
fn a_comb_keeps_the_sensors_rate_with_half_of_the_time_free() {
    assert_rate(16, 1);
}

#[test]
#[ignore = "takes 4 CPU s; run by .ci/run"]
fn a_comb_keeps_the_sensors_rate_in_long_frames() {
    assert_rate(64, 1);
}

#[test]
#[ignore = "an hour of virtual time takes half an hour; .ci/run leaves it out"]
fn a_comb_loses_no_row_in_an_hour() {
    assert_rate(16, 3600);
}

/// Rows of any comb: the nominal mask without some of its slits, with images off their places as speckle puts
/// them, or even gaps; near and beyond the range; dim, saturated, narrow and wide. One row in four has a
/// false image.
pub fn any_combs(seed: u64) -> LightSource {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut row = 0;
    Box::new(move |_: &Exposure| {
        row += 1;
        let missing = random.random_range(0.0..0.9);
        let off = random.random_range(0.0..80e-6);
        let mut comb = match random.random_range(0..10) {
            0 => even(random.random_range(0.85e-3..1.1e-3)),
            _ => Comb::nominal(),
        };
        (comb.slits).retain(|_| random.random_range(0.0..1.0) > missing);
        for slit in &mut comb.slits {
            slit.place += off * random.random_range(-1.0..1.0);
        }
        let width = logarithmic(&mut random, 1.0, 40.0);
        let height = match random.random_range(0..4) {
            0 => logarithmic(&mut random, 4.0, 12_000.0),
            _ => logarithmic(&mut random, 60.0, 3500.0),
        };
        let spot = Spot::new(width, height);
        let distance = random.random_range(0.5..1.2);
        let place = random.random_range(0.0..LIGHT.len() as f64);
        let strength = random.random_range(0.1..1.5);
        let scene = Scene {
            seed,
            spot: (!comb.slits.is_empty()).then_some(spot),
            comb: (!comb.slits.is_empty()).then_some(comb),
            ..Scene::white_paper()
        };
        // With an exposure of one second, the light of a second is the height.
        let mut counts = scene.row(row, distance, 1.0);
        if row % 4 == 0 {
            spot.add(&mut counts[LIGHT], place, strength * height);
        }
        counts
    })
}

/// Frames of combs: for 40 rows a spot stays, and slits come and go. Then the target is elsewhere.
fn frames_of_combs(seed: u64) -> LightSource {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut row, mut shown, mut missing, mut distance) = (0, Comb::nominal(), 0.0, DISTANCE);
    Box::new(move |_: &Exposure| {
        if row % 40 == 0 {
            shown = Comb::nominal();
            for slit in &mut shown.slits {
                slit.place += random.random_range(-30e-6..30e-6);
            }
            missing = random.random_range(0.0..0.4);
            distance = random.random_range(0.56..1.09);
        }
        row += 1;
        let mut comb = shown.clone();
        (comb.slits).retain(|_| random.random_range(0.0..1.0) > missing);
        let scene = Scene {
            seed,
            spot: Some(Spot::new(8.6, logarithmic(&mut random, 60.0, 3500.0))),
            ..behind(comb)
        };
        distance += 2e-6;
        scene.row(row, distance, 1.0)
    })
}

#[test]
fn every_row_of_a_comb_gives_the_same_line_on_the_chip_and_on_a_pc() {
    const ROWS: u64 = 250;
    for (command, centre) in CALIBRATIONS {
        let commands = [command, "slits comb", "rows 1"];
        // The first lines may still belong to frames of 16 rows.
        let (_, chip, kinds) = run_as_on_this_pc(any_combs(11), &commands, ROWS, 2, settings(1));
        assert!(chip.len() >= 180, "{}", chip.len());
        let mut slits = BTreeMap::new();
        for line in chip.iter().filter(|line| is_reading(line)) {
            *slits.entry(slits_of(line)).or_insert(0) += 1;
        }
        println!("readings by slits: {slits:?}");
        for kind in [centre, "too few slits", "slits unclear", "no spot"] {
            assert!(kinds.contains_key(kind), "{kind}: {kinds:?}");
        }
    }
}

#[test]
fn every_frame_of_a_comb_gives_the_same_line_on_the_chip_and_on_a_pc() {
    for (rows, of_all) in [(5, 150), (16, 400)] {
        let commands = ["slits comb", &format!("rows {rows}")];
        let light = frames_of_combs(12);
        let (_, chip, kinds) = run_as_on_this_pc(light, &commands, of_all, 2, settings(rows));
        assert!(chip.len() >= 20);
        assert!(kinds["reading"] >= 10, "{kinds:?}");
    }
}

/// The calibration of a sensor whose geometry is nominal: u is from noise, pixels and the scatter of the
/// slits.
fn record() -> Record {
    Record {
        errors: records::fitted(1, 0),
        estimator: Options::default().estimator,
        black_level: Options::default().black_level,
        profile: None,
        comb: Some(slitrange::frame::comb::Comb::nominal()),
        ..records::record(Calibration::nominal().expect("a curve"))
    }
}

/// RMS error in um, share of errors within 2u, and mean number of slits, of lines with their true distances
/// in metres.
fn errors<'a>(lines: impl Iterator<Item = (&'a str, f64)>) -> (f64, f64, f64) {
    let (mut count, mut squares, mut within, mut slits) = (0.0, 0.0, 0.0, 0.0);
    for (line, distance) in lines {
        let error = number(line, "d ", " mm") - 1e3 * distance;
        count += 1.0;
        squares += error * error;
        within += f64::from(u8::from(error.abs() <= 2.0 * number(line, "u ", " ")));
        slits += f64::from(slits_of(line).expect("a comb's reading"));
    }
    let rms = 1e3 * f64::sqrt(squares / count);
    (rms, within / count, slits / count)
}

/// White paper at random distances over the whole range, with another surface each time, in the light of a
/// laser with a single wavelength and a spot of 1 mm.
#[test]
#[ignore = "simulates 220 surfaces behind 16 slits, a minute; .ci/run runs it"]
fn speckle_moves_readings_on_the_chip_as_on_a_pc() {
    const SURFACES: u64 = 220;
    const ROWS: u16 = 4;
    let mut random = ChaCha8Rng::seed_from_u64(13);
    let target = Target::at(DISTANCE);
    let scene = Scene::load("comb").expect("a scene");
    let (mut board, _) = boot(of_scene(scene, target.clone()));
    keep_all_rows(&mut board);
    let record = record();
    let encoded = EncodedRecord::new(record.clone()).expect("a record");
    // Sets `slits comb`.
    upload(&mut board, encoded.bytes(), PATIENCE).expect("an upload");
    set(&mut board, &format!("rows {ROWS}"));
    board.take_lines();
    // The true distance, and the number of the line that is compared with it.
    let mut compared = Vec::new();
    let mut lines = Vec::new();
    for surface in 0..SURFACES {
        let distance = random.random_range(0.552..1.098);
        target.move_to(distance);
        target.show_surface(surface);
        lines.extend(results(&mut board, 3));
        compared.push((lines.len() - 1, distance));
    }
    let shown = kept_rows(&mut board);
    Status::ask(&mut board).assert_nothing_lost();

    let calibration = Some(&record.calibration);
    // The first line may be from other settings. A frame may begin with any row.
    let first_line = 2;
    let chip = &lines[first_line..];
    let pc = calibrated_on_this_pc(chip, &shown, settings(ROWS), calibration, &record.errors);
    let kinds = assert_same(chip, &pc, 1);
    println!("{kinds:?}");
    let mut readings = compared;
    readings.retain(|&(number, _)| is_reading(&lines[number]));
    let on = |lines: &[String]| {
        let compared = readings.iter();
        errors(compared.map(|&(number, distance)| (lines[number].as_str(), distance)))
    };
    let of_pc = [&lines[..first_line], &pc[..]].concat();
    for (name, (rms, within, slits)) in [("chip", on(&lines)), ("PC", on(&of_pc))] {
        println!(
            "{name}: {} readings of {SURFACES}, RMS error {rms:.1} um, {:.1} % within 2u, {slits:.2} slits",
            readings.len(),
            100.0 * within
        );
    }
    let (rms, within, _) = on(&lines);
    assert!(readings.len() >= 200);
    assert!(rms < 140.0, "{rms} um");
    assert!(within >= 0.93, "{within}");
}
