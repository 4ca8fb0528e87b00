//! Tests of what silicon needs and the emulated core does not: an erratum's bit, and a log that nobody reads.

use super::common::*;

/// The auxiliary control register (ARMv7-M manual, B3.2.2) and its bit that switches the write buffer off.
const ACTLR: u64 = 0xE000_E008;
const DISDEFWBUF: u64 = 1 << 1;

/// Erratum 838869 of the core: a buffered store may let an interrupt come twice.
#[test]
fn the_start_switches_the_write_buffer_off() {
    let mut board = measuring(4);
    let register = board.probe_reads(ACTLR).expect("a run");
    let register = register.expect("a register");
    assert_eq!(register & DISDEFWBUF, DISDEFWBUF, "{register:#x}");
}

/// probe-rs sets the log's blocking mode. If it then goes away, the firmware must not wait for it: the rows
/// would stop, and the watchdog would start the board again.
#[test]
fn a_log_that_nobody_reads_stops_nothing() {
    let mut board = measuring(4);
    board.lose_log_reader().expect("a log");
    let [size, mut place] = board.log_size_and_place().expect("a log");
    // Each of these bytes makes embassy's driver log an error.
    garble(&mut board, 1_000_000, 0);
    let mut logged = 0;
    while logged <= 2 * size {
        board.send("?");
        run_ms(&mut board, 1);
        let [_, now] = board.log_size_and_place().expect("a log");
        logged += (now + size - place) % size;
        place = now;
        assert!(board.now() < 20_000_000_000, "{logged} of {size} bytes");
    }
    println!("{logged} bytes in a buffer of {size}");
    garble(&mut board, 0, 0);
    board.send("\r\n");
    assert_readings(&fresh_results(&mut board, 4));
    assert_no_reset(&mut board);
    Status::ask(&mut board).assert_none(&["rows lost", "rows failed", "rows late"]);
}
