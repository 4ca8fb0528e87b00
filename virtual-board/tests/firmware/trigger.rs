//! Tests of the setting `trigger`: what starts a frame, and which rows the frame has.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use super::common::*;

/// The time from row to row, as the firmware states it, ns.
const ROW_PERIOD: u64 = 5_700_000;

/// The time of ten bits at 115200 baud, ns.
const BYTE: u64 = 86_806;

/// From a row's last word to the first byte of its result, ns: the limit of docs/serial-line.md.
const COMPUTING: u64 = 1_000_000;

/// The pixels of the spot before the trigger and after it.
const BEFORE: f64 = 800.0;
const AFTER: f64 = 1800.0;

/// A spot that jumps from one place to the other at an instant that a test sets, in rows that began after
/// that. The exposures that it showed are noted.
fn jumping_spot() -> (LightSource, Arc<AtomicU64>, Arc<Mutex<Vec<Exposure>>>) {
    let (mut before, mut after) = (spot_at(BEFORE, 2000.0), spot_at(AFTER, 2000.0));
    let jump = Arc::new(AtomicU64::new(u64::MAX));
    let exposures = Arc::new(Mutex::new(vec![]));
    let (at, seen) = (Arc::clone(&jump), Arc::clone(&exposures));
    let light = Box::new(move |exposure: &Exposure| {
        seen.lock().expect("a list").push(*exposure);
        if exposure.start >= at.load(Ordering::Relaxed) {
            after(exposure)
        } else {
            before(exposure)
        }
    });
    (light, jump, exposures)
}

/// The lines of a time without a trigger: none but answers.
fn assert_silent(board: &mut VirtualBoard, time: Duration) {
    board.take_lines();
    board.run_for(time).expect("a run");
    assert_eq!(take_results(board), [""; 0]);
}

/// A pulse at the trigger's pin, long before the next row is due.
fn pulse(board: &mut VirtualBoard) {
    for high in [true, false] {
        board.drive_trigger(high).expect("the emulator");
        board.run_for(Duration::from_micros(20)).expect("a run");
    }
}

/// At each phase of the row's period, the frame has only rows that began after the edge, and the first of
/// them: at most a period later.
#[test]
fn a_frame_has_the_first_rows_that_began_after_the_edge() {
    let (light, jump, exposures) = jumping_spot();
    let (mut board, _) = boot(light);
    for command in ["calibration off", "rows 2", "trigger pin"] {
        set(&mut board, command);
    }
    board.take_lines();
    // Longer than the watchdog waits.
    assert_silent(&mut board, Duration::from_secs(3));
    assert_no_reset(&mut board);
    for phase in 0..8 {
        jump.store(u64::MAX, Ordering::Relaxed);
        let time = Duration::from_nanos(20 * ROW_PERIOD + phase * ROW_PERIOD / 8);
        assert_silent(&mut board, time);
        exposures.lock().expect("a list").clear();
        let edge = board.now();
        jump.store(edge, Ordering::Relaxed);
        pulse(&mut board);
        let line = await_line(&mut board, is_result);
        // Both rows show the new place. Rows that disagree would give another centre, or a fault.
        let centre = number(&line.text, ": x ", " u ");
        assert!((centre - AFTER).abs() < 0.1, "{line}");
        let seen = exposures.lock().expect("a list").clone();
        let rows: Vec<&Exposure> = (seen.iter()).filter(|it| it.start >= edge).collect();
        let waited = rows[0].start - edge;
        // The second row's words take a period more. Then the row is computed, and the line is sent.
        let took = line.at - edge;
        println!("waited {waited} ns, answered after {took} ns: {line}");
        assert!(waited <= ROW_PERIOD);
        let words = rows[1].end + ROW_PERIOD;
        let sending = (line.text.len() + "\r\n".len()) as u64 * BYTE;
        assert!((words..words + COMPUTING).contains(&(line.at - sending)));
    }
    // Edges during a frame are missed, and so is a command.
    let missed = Status::ask(&mut board).count("triggers missed");
    assert_eq!(missed, 0);
    set(&mut board, "rows 16");
    board.take_lines();
    (0..3).for_each(|_| pulse(&mut board));
    say(&mut board, "measure", 250);
    let results = take_results(&mut board);
    assert_eq!(results.len(), 1, "{results:#?}");
    assert_eq!(Status::ask(&mut board).count("triggers missed"), 3);
    // Edges start nothing if commands do.
    set(&mut board, "trigger serial");
    pulse(&mut board);
    assert_silent(&mut board, Duration::from_millis(250));
}

#[test]
fn measure_gives_one_result_of_rows_that_began_after_it() {
    let (light, jump, _) = jumping_spot();
    let (mut board, _) = boot(light);
    for command in ["calibration off", "rows 2", "output centre"] {
        set(&mut board, command);
    }
    set(&mut board, "trigger serial");
    board.take_lines();
    assert_silent(&mut board, Duration::from_millis(100));
    for command in ["measure", "distance"] {
        jump.store(u64::MAX, Ordering::Relaxed);
        run_ms(&mut board, 100);
        // The command is understood with its last byte.
        board.send(&format!("{command}\r"));
        let sending = Duration::from_micros(87 * (command.len() as u64 + 1));
        board.run_for(sending).expect("a run");
        jump.store(board.now(), Ordering::Relaxed);
        let line = await_line(&mut board, is_result);
        println!("{line}");
        // `distance` advises about the fault in a line more.
        let centre = number(&line.text, ": x ", " u ");
        assert!((centre - AFTER).abs() < 0.1, "{line}");
        assert_silent(&mut board, Duration::from_millis(100));
    }
    // A silent sensor answers too.
    board.open_line(Some(OpenLine::Ones));
    run_ms(&mut board, 300);
    board.take_lines();
    board.send("measure\r\n");
    let fault = await_line(&mut board, is_result);
    assert!(fault.text.starts_with("f sensor silent"), "{fault}");
}
