//! Tests of a sensor on a line with others: the setting `address`, and the pin that enables the line's
//! driver.

use super::common;
use super::common::*;

/// A bit at 115200 baud, ns.
const BIT: u64 = 8681;

/// The most time from the last bit to the release of the line, ns: an interrupt that may wait for the pulses.
/// Other sensors answer 3.5 characters later at the earliest, 300 us.
const RELEASE: u64 = 20_000;

/// Asserts that the driver was enabled for all bytes since the last call, and not for longer.
fn assert_driver_covers_the_bytes(board: &mut VirtualBoard) {
    // The last bytes may be on the line.
    run_ms(board, 20);
    let bytes = board.take_bytes();
    let edges = board.take_driver_edges();
    let (pairs, rest) = edges.as_chunks::<2>();
    assert_eq!(rest, [], "the line is released: {edges:?}");
    assert!(!pairs.is_empty());
    let mut bytes = bytes.iter().map(|&(end, _)| end).peekable();
    for &[(rose, up), (fell, down)] in pairs {
        assert!(up && !down, "{edges:?}");
        let mut last = None;
        while let Some(end) = bytes.next_if(|&end| end <= fell) {
            assert!(end - 10 * BIT >= rose, "a byte began before {rose}");
            last = Some(end);
        }
        let last = last.expect("a byte while the driver was enabled");
        assert!(fell - last < RELEASE, "{last} to {fell}");
    }
    assert_eq!(bytes.next(), None, "a byte without the driver");
    println!("{} times enabled", pairs.len());
}

fn say(board: &mut VirtualBoard, line: &str, ms: u64) -> Vec<String> {
    board.take_lines();
    common::say(board, line, ms);
    take_texts(board)
}

fn assert_reads(board: &mut VirtualBoard, command: &str) {
    let readings = say(board, command, 60);
    assert_eq!(readings.len(), 1, "{readings:?}");
    assert!(readings[0].strip_prefix("@5 ").is_some_and(is_reading));
}

#[test]
fn a_sensor_with_an_address_talks_only_if_asked() {
    let (mut board, _) = boot(paper());
    assert_driver_covers_the_bytes(&mut board);
    // One byte after a silence, as an echo is.
    set(&mut board, "echo on");
    say(&mut board, "rows", 30);
    assert_driver_covers_the_bytes(&mut board);
    say(&mut board, "echo off", 60);
    set(&mut board, "rows 2");
    set(&mut board, "address 5");
    assert_driver_covers_the_bytes(&mut board);
    let of_others = "rows,@6 rows,@ 5 rows,@05,frobnicate,,d 800.1 mm,@6 d 1 mm";
    for line in of_others.split(',') {
        assert_eq!(say(&mut board, line, 30), [""; 0], "{line}");
    }
    assert_eq!(board.take_driver_edges(), []);
    assert_eq!(say(&mut board, "@5 rows", 30), ["@5 rows 2"]);
    let unknown = "@5 E1 unknown command, try help";
    assert_eq!(say(&mut board, "@5 frobnicate", 30), [unknown]);
    assert_reads(&mut board, "@5 distance");
    let help = say(&mut board, "@5 help", 600);
    let all = help.iter().all(|line| line.starts_with("@5 "));
    assert!(help.len() > 40 && all, "{help:?}");
    // With a trigger, two readings at a time that the master chooses.
    let trigger = "@5 trigger serial";
    assert_eq!(say(&mut board, trigger, 30), [trigger]);
    assert_reads(&mut board, "@5 measure");
    assert_reads(&mut board, "@5 distance");
    assert_driver_covers_the_bytes(&mut board);
    // For all: nobody answers.
    for line in "@0 rows 3,@0 trigger continuous,@0 distance,@0 help,@0 frobnicate".split(',') {
        assert_eq!(say(&mut board, line, 60), [""; 0], "{line}");
    }
    assert_eq!(say(&mut board, "@5 rows", 30), ["@5 rows 3"]);
    // Saved, and left by `defaults`. Not even a banner after a start.
    board.take_lines();
    tell(&mut board, "@5 save");
    board.reset_pin().expect("the emulator");
    board.take_bytes();
    run_ms(&mut board, 300);
    assert_eq!(board.take_bytes(), []);
    assert_eq!(say(&mut board, "@5 rows", 30), ["@5 rows 3"]);
    assert_eq!(say(&mut board, "@5 defaults", 30), ["@5 defaults"]);
    assert_eq!(say(&mut board, "@5 rows", 30), ["@5 rows 16"]);
    // A sensor of unknown address.
    assert_eq!(say(&mut board, "@0 address 247", 30), [""; 0]);
    assert_eq!(say(&mut board, "@5 rows", 30), [""; 0]);
    assert_eq!(say(&mut board, "@247 rows", 30), ["@247 rows 16"]);
    // Alone again.
    let lines = say(&mut board, "@247 address 0", 300);
    assert_eq!(lines[0], "@247 address 0");
    assert!(lines.len() > 2);
    assert_readings(&lines[1..]);
}
