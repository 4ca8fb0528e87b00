//! Commands: each is answered as documented, and what it sets is in force.

use std::time::Duration;

use host_tests::scene::Scene;
use slitrange::black_level::BlackLevel;
use slitrange::measurement::Settings;
use slitrange::protocol::answer::HELP;
use slitrange::protocol::info::{Banner, Hardware, Info};
use slitrange::protocol::status::StartCause;
use slitrange::reading::Fault;
use slitrange::{sensor_heads, triangulation};
use virtual_board::light::{LIGHT, Target, of_scene};
use virtual_board::{LightSource, VirtualBoard};

use crate::common::{
    DISTANCE, Status, ask, ask_for_lines, boot, fresh_results, is_reading, is_result, measuring,
    number, paper, set,
};

const HARDWARE: Hardware = Hardware {
    board: "NUCLEO-F429ZI",
    head: "TCD1304DG",
    row_us: 5700,
};

/// Every line since this was last asked that is a result.
fn taken_results(board: &mut VirtualBoard) -> Vec<String> {
    let lines = board.take_lines().into_iter().map(|line| line.text);
    lines.filter(|line| is_result(line)).collect()
}

#[test]
fn the_banner_says_what_this_is_and_why_it_started() {
    let (board, banner) = boot(paper());
    println!("{banner}");
    assert_eq!(
        banner.text,
        Banner(&HARDWARE, StartCause::PowerOn).to_string()
    );
    board.finish().expect("a clean run");
}

#[test]
fn help_and_info_are_what_the_core_says() {
    let mut board = measuring(16);
    let help: Vec<&str> = HELP.split("\r\n").collect();
    assert_eq!(ask_for_lines(&mut board, "help", help.len()), help);

    for (calibration, command) in [
        (triangulation::NOMINAL.ok(), "calibration on"),
        (None, "calibration off"),
    ] {
        set(&mut board, command);
        let info = Info {
            hardware: &HARDWARE,
            geometry: &sensor_heads::tcd1304dg(),
            settings: &Settings {
                estimator: slitrange::estimator::Estimator::default(),
                rows: 16,
                black_level: BlackLevel::Shielded,
                calibration,
            },
        }
        .to_string();
        let info: Vec<&str> = info.split("\r\n").collect();
        assert_eq!(ask_for_lines(&mut board, "info", info.len()), info);
    }
    board.finish().expect("a clean run");
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

    let names: Vec<&str> = lines
        .iter()
        .map(|line| {
            let (name, value) = line.rsplit_once(' ').expect("a value");
            // A time has a unit.
            if value == "s" {
                name.rsplit_once(' ').expect("a time").0
            } else {
                name
            }
        })
        .collect();
    let faults: Vec<String> = Fault::NAMES
        .iter()
        .map(|name| format!("status fault {name}"))
        .collect();
    let mut expected = vec![
        "status start",
        "status uptime",
        "status rows read",
        "status rows lost",
        "status rows failed",
        "status row cycles",
        "status readings",
    ];
    expected.extend(faults.iter().map(String::as_str));
    expected.extend([
        "status lines dropped",
        "status serial noise",
        "status serial framing",
        "status serial overrun",
    ]);
    assert_eq!(names, expected);

    assert_eq!(lines[0], "status start power-on");
    let uptime = number(&lines[1], "uptime ", " s");
    let now = board.now() as f64 * 1e-9;
    assert!(
        (now - 0.15..now).contains(&uptime),
        "{uptime} s, it is {now} s"
    );
    let rows = board.head(|head| head.row_count());
    // Some more were read while the answer was sent.
    assert!(
        (rows - 12..=rows).contains(&status.count("rows read")),
        "{rows}"
    );
    assert!((10_000..200_000).contains(&status.count("row cycles")));
    let results = taken_results(&mut board);
    let readings = results.iter().filter(|line| is_reading(line)).count() as u64;
    assert_eq!(status.count("readings"), readings, "{results:#?}");
    // Some more were said after the answer.
    let faults = results.len() as u64 - readings;
    let counted = status.count("fault not calibrated");
    assert!((faults - 3..=faults).contains(&counted), "{results:#?}");
    status.assert_none(&[
        "rows lost",
        "rows failed",
        "lines dropped",
        "fault sensor silent",
        "fault no spot",
        "serial noise",
        "serial framing",
        "serial overrun",
    ]);
    board.finish().expect("a clean run");
}

#[test]
fn with_the_stream_off_distance_gives_one_reading() {
    let mut board = measuring(4);
    assert_eq!(ask(&mut board, "stream"), "stream on");
    set(&mut board, "stream off");
    // What had been handed to the line before is still said.
    board.run_for(Duration::from_millis(30)).expect("a run");
    board.take_lines();
    board.run_for(Duration::from_millis(150)).expect("a run");
    assert_eq!(taken_results(&mut board), [""; 0]);

    board.send("distance\r\n");
    board.run_for(Duration::from_millis(150)).expect("a run");
    let results = taken_results(&mut board);
    let [reading] = &results[..] else {
        panic!("not one reading but {results:#?}");
    };
    println!("{reading}");
    assert!(is_reading(reading), "{reading}");

    assert_eq!(ask(&mut board, "stream"), "stream off");
    set(&mut board, "stream on");
    fresh_results(&mut board, 3);
    board.finish().expect("a clean run");
}

#[test]
fn rows_are_as_many_as_set() {
    let mut board = measuring(16);
    assert_eq!(ask(&mut board, "rows"), "rows 16");
    for rows in [1, 7, 64] {
        set(&mut board, &format!("rows {rows}"));
        assert_eq!(ask(&mut board, "rows"), format!("rows {rows}"));
        let lines = fresh_results(&mut board, 1);
        println!("{}", lines[0]);
        assert!(
            lines[0].contains(&format!(" n {rows}/{rows} ")),
            "{lines:?}"
        );
    }
    board.finish().expect("a clean run");
}

/// Stray light that shielded pixels do not see, counts.
const STRAY_LIGHT: f32 = 50.0;

/// White paper in a room that is not dark.
fn paper_in_stray_light() -> LightSource {
    let mut light = of_scene(Scene::white_paper(), Target::at(DISTANCE));
    Box::new(move |exposure| {
        let mut counts = light(exposure);
        counts[LIGHT]
            .iter_mut()
            .for_each(|count| *count += STRAY_LIGHT);
        counts
    })
}

#[test]
fn the_black_level_is_found_in_the_way_that_is_set() {
    let (mut board, _) = boot(paper_in_stray_light());
    set(&mut board, "rows 4");
    assert_eq!(ask(&mut board, "black"), "black shielded");
    let black = Scene::white_paper().black_level;
    for (command, expected, tolerance) in [
        ("black fixed 1234", 1234.0, 0.0),
        // 13 pixels of 4 rows with noise of 4 counts: 0.6.
        ("black shielded", black, 2.5),
        ("black frame", black + f64::from(STRAY_LIGHT), 0.3),
    ] {
        set(&mut board, command);
        assert_eq!(ask(&mut board, "black"), command);
        let lines = fresh_results(&mut board, 2);
        println!("{command}: {}", lines[0]);
        for line in &lines {
            let level = number(line, " b ", "");
            assert!(
                (level - expected).abs() <= tolerance,
                "{command}: {lines:#?}"
            );
        }
    }
    board.finish().expect("a clean run");
}

#[test]
fn calibration_says_whether_it_is_on() {
    let mut board = measuring(4);
    assert_eq!(ask(&mut board, "calibration"), "calibration on");
    for command in ["calibration off", "calibration on"] {
        set(&mut board, command);
        assert_eq!(ask(&mut board, "calibration"), command);
    }
    board.finish().expect("a clean run");
}

#[test]
fn what_is_no_command_is_an_error_with_a_number() {
    let mut board = measuring(16);
    let long = [b'x'; 65];
    let cases: [(&[u8], &str); 6] = [
        (b"frobnicate", "E1 unknown command, try help"),
        (b"rows many", "E2 expected rows 1..64"),
        (
            b"black fixed",
            "E2 expected black fixed 0..4095|shielded|frame",
        ),
        (b"rows 65", "E3 out of range, expected rows 1..64"),
        (&long, "E4 line longer than 64 characters"),
        (b"rows \xff16", "E5 not ASCII text"),
    ];
    for (command, error) in cases {
        let now = board.now();
        board.send_at(now, command);
        assert_eq!(ask(&mut board, ""), error);
    }
    assert_eq!(ask(&mut board, "rows"), "rows 16", "nothing was set");
    board.finish().expect("a clean run");
}
