//! Tests of noise and random bytes on the serial line: the firmware continues to measure and answers only
//! with errors.

use std::time::Duration;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use slitrange::protocol::command::Command;
use slitrange::protocol::input::Input;
use virtual_board::{Line, Nanos, VirtualBoard};

use crate::common::{Status, ask, fresh_results, is_reading, is_result, measuring, set};

/// The number of random bytes.
const BYTES: usize = 10 * 1024;

/// The time to send the bytes at 115200 baud, ten bits each.
const TRANSFER: Duration = Duration::from_micros(BYTES as u64 * 10 * 1_000_000 / 115_200);

/// Uniform random bytes. The probability that they contain a command is about 10^4 / 256^5.
fn random_bytes(seed: u64) -> Vec<u8> {
    let mut bytes = vec![0; BYTES];
    ChaCha8Rng::seed_from_u64(seed).fill(&mut bytes[..]);
    bytes
}

/// Sends the bytes at full line rate. Gives the start time, and all lines that came meanwhile.
fn flood(board: &mut VirtualBoard, bytes: &[u8]) -> (Nanos, Vec<Line>) {
    board.take_lines();
    let start = board.now();
    board.send_at(start, bytes);
    // The last line of the bytes has no end.
    board.send("\r\n");
    board
        .run_for(TRANSFER + Duration::from_millis(50))
        .expect("a run");
    (start, board.take_lines())
}

/// Asserts that every line is a reading or an error, and that there are enough of both.
fn assert_measures_on(lines: &[Line], start: Nanos) {
    let of_another_kind: Vec<&Line> = lines
        .iter()
        .filter(|line| !is_reading(&line.text) && !is_error(&line.text))
        .collect();
    assert!(of_another_kind.is_empty(), "{of_another_kind:#?}");
    let end = start + TRANSFER.as_nanos() as Nanos;
    let readings = lines
        .iter()
        .filter(|line| is_result(&line.text) && (start..end).contains(&line.at))
        .count();
    let errors = lines.iter().filter(|line| is_error(&line.text)).count();
    println!(
        "{BYTES} bytes in {:.3} s: {readings} readings meanwhile, {errors} errors said",
        TRANSFER.as_secs_f64()
    );
    // A frame of 4 rows takes 22.8 ms.
    let frames = (TRANSFER.as_secs_f64() / 0.0228) as usize;
    assert!(readings >= frames - 2, "{readings} of {frames}: {lines:#?}");
    assert!(errors >= 20, "{lines:#?}");
}

/// Whether a line is `E`, a number, a blank and words.
fn is_error(line: &str) -> bool {
    line.strip_prefix('E')
        .and_then(|rest| rest.split_once(' '))
        .is_some_and(|(number, words)| number.parse::<u32>().is_ok() && !words.is_empty())
}

/// Asserts that readings come, that no row was lost, and that a command works.
fn assert_lives_on(board: &mut VirtualBoard) {
    Status::ask(board).assert_none(&[
        "rows lost",
        "rows failed",
        "lines dropped",
        "serial overrun",
    ]);
    set(board, "rows 7");
    let lines = fresh_results(board, 3);
    assert!(
        lines.iter().all(|line| line.contains(" n 7/7 ")),
        "{lines:#?}"
    );
}

/// The core's answers to these bytes.
fn errors_about(bytes: &[u8]) -> Vec<String> {
    let mut input = Input::new();
    bytes
        .iter()
        .chain(b"\r\n")
        .filter_map(|&byte| match input.take(byte)? {
            Ok(Command::Nothing) => None,
            Ok(command) => panic!("the bytes hold the command `{command}`: take another seed"),
            Err(error) => Some(error.to_string()),
        })
        .collect()
}

#[test]
fn random_bytes_are_answered_by_errors_and_measuring_continues() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);
    let bytes = random_bytes(1);
    let (start, lines) = flood(&mut board, &bytes);
    assert_measures_on(&lines, start);
    let errors: Vec<String> = lines
        .into_iter()
        .map(|line| line.text)
        .filter(|line| is_error(line))
        .collect();
    assert_eq!(errors, errors_about(&bytes));
    assert_lives_on(&mut board);
    board.finish().expect("a clean run");
}

#[test]
fn noise_and_framing_errors_are_counted_and_the_line_still_works() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);
    // A tenth of the bytes each.
    board
        .garble_serial_line(100_000, 100_000, 1)
        .expect("the emulator");
    let (start, lines) = flood(&mut board, &random_bytes(2));
    assert_measures_on(&lines, start);
    board.garble_serial_line(0, 0, 1).expect("the emulator");
    // The garbled bytes may have ended within a line.
    board.send("\r\n");
    board.run_for(Duration::from_millis(20)).expect("a run");
    board.take_lines();
    let status = Status::ask(&mut board);
    for kind in ["serial noise", "serial framing"] {
        let count = status.count(kind);
        println!("{kind}: {count}");
        assert!((800..1300).contains(&count), "{kind}: {count} of {BYTES}");
    }
    assert_lives_on(&mut board);
    board.finish().expect("a clean run");
}

#[test]
fn commands_typed_without_a_pause_are_all_answered() {
    let mut board = measuring(16);
    let rows: Vec<u16> = (1..=64).collect();
    let commands: String = rows.iter().map(|rows| format!("rows {rows}\r\n")).collect();
    board.take_lines();
    board.send(&commands);
    board.run_for(Duration::from_millis(150)).expect("a run");
    let answers: Vec<String> = board
        .take_lines()
        .into_iter()
        .map(|line| line.text)
        .filter(|line| !is_result(line))
        .collect();
    let expected: Vec<String> = rows.iter().map(|rows| format!("rows {rows}")).collect();
    assert_eq!(answers, expected);
    assert_eq!(ask(&mut board, "rows"), "rows 64");
    board.finish().expect("a clean run");
}
