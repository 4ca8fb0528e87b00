//! A board continues in a core that has run the firmware before, and does the same as in a new core.

use super::common::*;

/// The lines with their times, the log, and the statistics of a run with commands, a hang and a reset.
fn run(firmware: &Firmware) -> String {
    let mut board = VirtualBoard::power_on(firmware, paper()).expect("the board starts");
    run_ms(&mut board, 60);
    assert_eq!(firmware.warm_cores(), 0, "the board's core waits, too");
    board.send("rows 4\r\nestimator gauss-newton\r\nstatus\r\n");
    run_ms(&mut board, 60);
    board.hang_at("measure_row").expect("a function");
    run_ms(&mut board, 10);
    board.unhang("measure_row").expect("a function");
    board.reset_pin().expect("a reset");
    run_ms(&mut board, 70);
    let (lines, log) = (board.take_lines(), board.take_log());
    assert!(lines.len() > 20 && !log.is_empty(), "{lines:#?} {log:#?}");
    let statistics = board.finish().expect("a clean run");
    format!("{lines:#?} {log:#?} {statistics:?}")
}

#[test]
fn a_board_in_a_warm_core_does_the_same() {
    // No other test shares its cores.
    let firmware = Firmware::build().expect("the firmware");
    let cold = run(&firmware);
    for _ in 0..2 {
        assert_eq!(firmware.warm_cores(), 1);
        let warm = run(&firmware);
        let mut lines = cold.lines().zip(warm.lines());
        assert_eq!(lines.find(|(cold, warm)| cold != warm), None);
        assert!(cold == warm);
    }
}
