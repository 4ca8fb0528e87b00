//! Tests of the commands: each has the documented answer and the documented effect.

use slitrange::base::units::Units;
use slitrange::distance::eq1;
use slitrange::row::pixels::PixelErrors;
use slitrange_device::protocol::help::{Estimators, Help};
use slitrange_device::protocol::info::{Banner, BrownOut, Clock, Hardware, Info};
use slitrange_device::protocol::status::StartCause;

use super::common::*;

const HARDWARE: Hardware = Hardware {
    board: "NUCLEO-F429ZI",
    head: "TCD1304DG",
    row_us: 5700,
    longest_exposure: slitrange::base::exposure::Exposure::LONGEST,
    clock: Clock::External,
    brown_out: BrownOut::Off,
    last_stop: None,
};

#[test]
fn the_banner_names_the_device_and_the_cause_of_the_start() {
    let banner = boot(paper()).1.text;
    assert_eq!(banner, Banner(&HARDWARE, StartCause::PowerOn).to_string());
}

fn assert_answer(board: &mut VirtualBoard, command: &str, expected: &str) {
    let expected: Vec<&str> = expected.split("\r\n").collect();
    assert_eq!(ask_for_lines(board, command, expected.len()), expected);
}

#[test]
fn help_and_info_match_the_core() {
    let mut board = measuring(16);
    assert_answer(&mut board, "help", &Help(Units::default()).to_string());

    for (on, command) in [(true, "calibration on"), (false, "calibration off")] {
        set(&mut board, command);
        let info = Info {
            hardware: &HARDWARE,
            geometry: &sensor_heads::tcd1304dg(),
            settings: &Settings::default(),
            record: Record::nominal().as_ref(),
            is_calibration_on: on,
            pixels: PixelErrors::TCD1304DG,
        }
        .to_string();
        assert_answer(&mut board, "info", &info);
    }
}

/// u is made of its parts, and the difference to `zero` loses what both readings share: all but noise and
/// pixels' far parts, for a target at rest.
#[test]
fn the_parts_of_u_and_the_zero_are_given() {
    let mut board = measuring(16);
    let reading = fresh_results(&mut board, 1).remove(0);
    // Nobody calibrated this sensor.
    assert!(reading.ends_with(" g"), "{reading}");
    let lines = ask_for_lines(&mut board, "uncertainty", 6);
    println!("{reading}\n{lines:#?}");
    let part = |line: &String| {
        let (_, part) = line.split_once(' ').expect("a part");
        number(part, " ", " mm")
    };
    let squares: f64 = lines.iter().map(|line| part(line).powi(2)).sum();
    let u = number(&reading, " u ", " r ");
    assert!((squares.sqrt() / u - 1.0).abs() < 1e-3);

    // The next frame answers, with its distance; then come differences.
    board.send("zero\r\n");
    let line = await_line(&mut board, |line| line.starts_with("z ")).text;
    println!("{line}");
    let off = number(&line, "z ", " mm");
    let [u, r] = [number(&line, " u ", " r "), number(&line, " r ", " x ")];
    // For a spot of 1994 counts sqrt(2) e / L is 0.56, so the surface's part is 0.56 / (1 - 0.56) of the step
    // that was read.
    assert!(off.abs() < 4.0 * u && r < 0.01, "{line}");
    assert!(u < r.hypot(1.3 * off) + 3e-4, "{line}");
    set(&mut board, "zero off");
    await_line(&mut board, |line| line.starts_with("d "));
}

#[test]
fn status_counts_what_happened() {
    let mut board = measuring(4);
    fresh_results(&mut board, 3);
    set(&mut board, "calibration off");
    fresh_results(&mut board, 3);
    let status = Status::ask(&mut board);
    println!("{status:#?}");
    let Status(lines) = &status;

    let name = |line: &String| {
        // Some have a unit.
        let line = line.trim_end_matches([' ', 's', '%']);
        let (name, _) = line.rsplit_once(' ').expect("a value");
        name.strip_prefix("status ").expect("the word").to_owned()
    };
    let names: Vec<String> = lines.iter().map(name).collect();
    let faults: Vec<String> = Fault::NAMES.map(|name| format!("fault {name}")).into();
    let before = "start, uptime, rows read, row cycles, slowest row cycles, sampling spread, \
                  readings, limits, rows lost, rows failed, rows late";
    let after = "stops, triggers missed, lines dropped, serial noise, serial framing, \
                 serial parity, serial overrun";
    let expected = format!("{before}, {}, {after}", faults.join(", "));
    assert_eq!(names.join(", "), expected);

    assert_eq!(lines[0], "status start power-on");
    let uptime = number(&lines[1], "uptime ", " s");
    let ago = board.now() as f64 * 1e-9 - uptime;
    assert!(0.0 < ago && ago <= 0.15, "{uptime} s, {ago} s ago");
    let rows = board.statistics().rows;
    // The firmware read some more rows while it sent the answer: 900 characters take 78 ms.
    let more = rows.checked_sub(status.count("rows read"));
    assert!(more.is_some_and(|more| more <= 16), "{rows}");
    assert!((10_000..200_000).contains(&status.count("row cycles")));
    // A frame's first row searches all of the row for any spot, and takes longer than the rows after it.
    let slowest = status.count("slowest row cycles");
    let possible = status.count("row cycles")..960_000;
    assert!(possible.contains(&slowest), "{slowest}");
    let results = take_results(&mut board);
    let readings = results.iter().filter(|line| is_reading(line)).count() as u64;
    assert_eq!(status.count("readings"), readings, "{results:#?}");
    // Some more faults came after the answer.
    let faults = results.len() as u64 - readings;
    let counted = status.count("fault not calibrated");
    assert!((faults - 3..=faults).contains(&counted), "{results:#?}");
    status.assert_nothing_lost();
    status.assert_none(&["fault no spot", "serial noise", "serial framing"]);
}

#[test]
fn with_the_stream_off_distance_gives_one_reading() {
    let mut board = measuring(4);
    assert_eq!(ask(&mut board, "stream"), "stream on");
    set(&mut board, "stream off");
    // Lines that already waited are still sent.
    run_ms(&mut board, 30);
    board.take_lines();
    run_ms(&mut board, 150);
    assert_eq!(take_results(&mut board), [""; 0]);

    say(&mut board, "distance", 150);
    let results = take_results(&mut board);
    assert_eq!(results.len(), 1, "{results:#?}");
    assert_readings(&results);

    assert_eq!(ask(&mut board, "stream"), "stream off");
    set(&mut board, "stream on");
    fresh_results(&mut board, 3);
}

fn spot_that_moves(mut centre: impl FnMut(u64) -> f64 + Send + 'static) -> LightSource {
    let mut row = 0;
    let scene = Scene::white_paper();
    Box::new(move |exposure: &Exposure| {
        row += 1;
        scene.row_with_centre(row, centre(row), exposure.laser as f64 * 1e-9)
    })
}

#[test]
fn the_set_mean_is_used() {
    // Of any eight successive rows, one is 3 px off.
    let off = |row| if row % 8 == 0 { 3.0 } else { 0.0 };
    let mut board = measuring_in(spot_that_moves(move |row| 1800.0 + off(row)), 8);
    assert_eq!(ask(&mut board, "mean"), "mean weighted");
    for (command, centre, rows) in [
        ("mean plain", 1800.375, 8.0..=8.0),
        // The weighted mean may leave out one more row.
        ("mean weighted", 1800.0, 6.0..=7.0),
    ] {
        set(&mut board, command);
        assert_eq!(ask(&mut board, "mean"), command);
        assert!(ask_for_lines(&mut board, "info", 19).contains(&format!("info {command}")));
        for line in fresh_results(&mut board, 2) {
            println!("{command}: {line}");
            let off = number(&line, " x ", " a ") - centre;
            // The uncertainty of seven rows is 0.01 px.
            assert!(off.abs() < 0.05, "{line}");
            assert!(rows.contains(&number(&line, " n ", "/8 ")), "{line}");
        }
    }
    for command in ["mean median", "mean plain plain"] {
        assert_eq!(ask(&mut board, command), "E2 expected mean plain|weighted");
    }
    assert_eq!(ask(&mut board, "mean"), "mean weighted");
}

#[test]
fn rows_with_similar_errors_are_flagged() {
    // The centre swings by a tenth of a pixel, in waves of 32 rows. This is ten times the noise, and a wave
    // is not a straight motion.
    let wave = |row: u64| (std::f64::consts::TAU * row as f64 / 32.0).sin();
    let light = spot_that_moves(move |row| 1800.0 + 0.1 * wave(row));
    let mut board = measuring_in(light, 64);
    for end in [" n 64/64 c 1 g", " n 64/64 g"] {
        for line in fresh_results(&mut board, 2) {
            println!("{line}");
            assert!(line.ends_with(end), "{line}");
        }
        board.set_light(spot_that_moves(|_| 1800.0));
    }
}

/// Stray light that shielded pixels do not see, counts.
const STRAY_LIGHT: f32 = 50.0;

fn paper_in_stray_light() -> LightSource {
    let mut light = of_scene(Scene::white_paper(), Target::at(DISTANCE));
    Box::new(move |exposure| {
        let mut counts = light(exposure);
        let lit = counts[LIGHT].iter_mut();
        lit.for_each(|count| *count += STRAY_LIGHT);
        counts
    })
}

#[test]
fn the_set_black_level_is_used() {
    let mut board = measuring_in(paper_in_stray_light(), 4);
    assert_eq!(ask(&mut board, "black"), "black shielded");
    let black = Scene::white_paper().black_level.expect("a level").counts;
    for (command, expected, tolerance) in [
        ("black fixed 1234", 1234.0, 0.0),
        // 9 pixels of 4 rows with noise of 4 counts: 0.7.
        ("black shielded", black, 2.5),
        // Rounded to a count.
        ("black frame", black + f64::from(STRAY_LIGHT), 0.8),
    ] {
        set(&mut board, command);
        assert_eq!(ask(&mut board, "black"), command);
        let centre = ask(&mut board, "centre");
        println!("{command}: {centre}");
        let level = number(&centre, " b ", " e ");
        assert!((level - expected).abs() <= tolerance, "{command}: {centre}");
    }
}

/// Every estimator measures the same target, within its uncertainty and its bias.
#[test]
fn the_set_estimator_is_used() {
    let mut board = measuring(4);
    assert_eq!(ask(&mut board, "estimator"), "estimator adaptive");
    let calibration = eq1::NOMINAL.expect("a calibration");
    for estimator in Estimator::ALL {
        let command = format!("estimator {}", estimator.name());
        set(&mut board, &command);
        assert_eq!(ask(&mut board, "estimator"), command);
        for line in fresh_results(&mut board, 2) {
            println!("{line}");
            assert!(is_reading(&line), "{line}");
            let off = number(&line, "d ", " mm") - 1e3 * DISTANCE;
            let centre = Pixels::from_f32(number(&line, " x ", " a ") as f32);
            let (_, slope) = calibration.distance_at(centre).expect("a distance");
            // A twentieth of a pixel is for the bias of the simple estimators. The slope is in um a pixel.
            let bias = 0.05 * 1e-3 * f64::from(slope.abs());
            let noise = number(&line, " r ", " x ");
            assert!(off.abs() <= 5.0 * noise + bias, "{off} mm off: {line}");
        }
        let centre = ask(&mut board, "centre");
        let letter = format!(" e {} w ", estimator.letter());
        assert!(centre.contains(&letter), "{centre}");
    }
    let info = ask_for_lines(&mut board, "info", 19).join("\n");
    assert!(info.contains("\ninfo estimator fraunhofer\n"), "{info}");
    let names = Estimator::ALL.map(Estimator::name).join(" ");
    let error = format!("E6 unknown estimator, one of {names}; try help estimator");
    assert_eq!(ask(&mut board, "estimator guess"), error);
    let error = format!("E2 expected estimator NAME, one of {names}; try help estimator");
    assert_eq!(ask(&mut board, "estimator gauss newton"), error);
    assert_eq!(ask(&mut board, "estimator"), "estimator fraunhofer");
}

#[test]
fn help_estimator_lists_every_estimator_and_loses_no_reading() {
    // One row in a frame gives the most lines that the serial line can carry.
    let mut board = measuring(1);
    set(&mut board, "estimator adaptive");
    fresh_results(&mut board, 1);
    let expected = Estimators.to_string();
    assert_answer(&mut board, "help estimator", &expected);
    for estimator in Estimator::ALL {
        let start = format!("e {} {} ", estimator.letter(), estimator.name());
        let estimators = expected.lines().filter(|line| line.starts_with(&start));
        assert_eq!(estimators.count(), 1, "{start}");
    }
    fresh_results(&mut board, 4);
    Status::ask(&mut board).assert_nothing_lost();
    assert_eq!(ask(&mut board, "help rows"), "E2 expected help [estimator]");
}

#[test]
fn unknown_commands_are_answered_by_numbered_errors() {
    let mut board = measuring(16);
    let long = [b'x'; 81];
    let black = "E2 expected black fixed 0..4095|shielded|frame";
    let cases: [(&[u8], &str); 6] = [
        (b"frobnicate", "E1 unknown command, try help"),
        (b"rows many", "E2 expected rows 1..64"),
        (b"black fixed", black),
        (b"rows 65", "E3 out of range, expected rows 1..64"),
        (&long, "E4 line longer than 80 characters"),
        (b"rows \xff16", "E5 not ASCII text"),
    ];
    for (command, error) in cases {
        let now = board.now();
        board.send_at(now, command);
        assert_eq!(ask(&mut board, ""), error);
    }
    assert_eq!(ask(&mut board, "rows"), "rows 16", "nothing was set");
}

/// A person types beside the stream: each key comes back, and no reading tears the line. Readings go on after
/// the line, and ten seconds after the last key of a line that nobody ends.
#[test]
fn typed_keys_are_shown_and_readings_wait_for_the_end_of_the_line() {
    let mut board = measuring(1);
    set(&mut board, "echo on");
    fresh_results(&mut board, 3);
    board.take_lines();
    for key in ["r", "o", "x", "\u{7f}", "w", "s"] {
        board.send(key);
        run_ms(&mut board, 200);
    }
    board.send("\r");
    let shown = "rox\u{8} \u{8}ws";
    let line = await_line(&mut board, |line| line.ends_with(shown)).text;
    println!("{}", line.escape_debug());
    await_text(&mut board, "rows 1");
    fresh_results(&mut board, 3);
    board.send("ro");
    run_ms(&mut board, 1_000);
    take_results(&mut board);
    run_ms(&mut board, 8_000);
    assert_eq!(take_results(&mut board), [""; 0]);
    run_ms(&mut board, 2_000);
    assert!(take_results(&mut board).len() > 50);
    board.send("\u{3}echo off\r");
    await_text(&mut board, "echo off");
    Status::ask(&mut board).assert_none(&["rows lost", "rows failed", "lines dropped"]);
}
