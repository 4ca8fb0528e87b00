//! The watchdog, and what a start says about its cause.

use std::time::Duration;

use virtual_board::VirtualBoard;

use crate::common::{
    PATIENCE, ask, boot, fresh_results, is_reading, measuring, paper, run_into_a_row,
};

/// Lets the board boot again, and makes sure that it says why, and that it measures with the settings of a start.
fn assert_starts_again(board: &mut VirtualBoard, cause: &str) {
    let banner = board
        .run_until_line(|line| line.starts_with("slitrange "), PATIENCE)
        .expect("a banner");
    println!("{banner}");
    assert!(
        banner.text.ends_with(&format!(", started by {cause}")),
        "{banner}"
    );
    let lines = fresh_results(board, 2);
    assert!(
        lines
            .iter()
            .all(|line| is_reading(line) && line.contains(" n 16/16 ")),
        "{lines:#?}"
    );
    assert_eq!(ask(board, "status"), format!("status start {cause}"));
}

#[test]
fn a_computation_that_hangs_is_ended_by_the_watchdog() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);
    assert_eq!(board.resets().expect("resets"), []);

    board.hang_at("measure_row").expect("the function");
    let hung = board.now();
    while board.resets().expect("resets").is_empty() {
        assert!(
            board.now() - hung < 2_500_000_000,
            "no reset within 2.5 s: {:?}",
            board.take_lines()
        );
        board.run_for(Duration::from_millis(10)).expect("a run");
    }
    board.unhang("measure_row").expect("the function");

    let resets = board.resets().expect("resets");
    println!(
        "reset {:.3} s after the hang: {resets:?}",
        (resets[0].at.0 - hung) as f64 * 1e-9
    );
    assert_eq!(format!("{:?}", resets[0].cause), r#"Model("IWDG")"#);
    // One look and eight without a change, and the watchdog's own second.
    assert!((resets[0].at.0 - hung) > 1_500_000_000, "too early");
    assert_starts_again(&mut board, "watchdog");
    assert_eq!(board.resets().expect("resets").len(), 1);
    board.finish().expect("a clean run");
}

#[test]
fn the_reset_pin_is_named_and_settings_are_those_of_a_start() {
    let mut board = measuring(4);
    // In the middle of a read-out, as a finger would.
    run_into_a_row(&mut board);
    board.reset_pin().expect("the emulator");
    assert_starts_again(&mut board, "reset pin");
    let resets = board.resets().expect("resets");
    assert_eq!(resets.len(), 1, "{resets:?}");
    assert_eq!(format!("{:?}", resets[0].cause), "Pin");
    board.finish().expect("a clean run");
}

#[test]
fn a_silent_sensor_is_no_reason_to_start_again() {
    let (mut board, _) = boot(paper());
    board.silence_sensor(true).expect("a converter");
    // Longer than the watchdog waits.
    board.run_for(Duration::from_millis(2500)).expect("a run");
    assert_eq!(board.resets().expect("resets"), []);
    board.finish().expect("a clean run");
}
