//! Tests of what silicon needs and the emulated core does not: an erratum's bit, and a log that nobody reads.

use rigless::soc::stm32f427::generated::spi1;

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
    let mut logged = 0;
    while logged <= 2 * size {
        // The row under way loses a word, which is logged.
        run_ms(&mut board, 6);
        with_processor(&mut board, |it| {
            let registers = it.converter_registers();
            registers.set(
                spi1::Register::Sr,
                registers.get(spi1::Register::Sr) | spi1::sr::OVR.mask(),
            );
        });
        let [_, now] = board.log_size_and_place().expect("a log");
        logged += (now + size - place) % size;
        place = now;
        assert!(board.now() < 20_000_000_000, "{logged} of {size} bytes");
    }
    println!("{logged} bytes in a buffer of {size}");
    run_ms(&mut board, 200);
    board.take_lines();
    assert_readings(&fresh_results(&mut board, 4));
    assert_no_reset(&mut board);
    let status = Status::ask(&mut board);
    assert!(status.count("rows failed") > 0);
    status.assert_none(&["rows lost", "rows late"]);
}
