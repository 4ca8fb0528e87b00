//! The rate of rows that the firmware sustains with nothing lost. The sensor head here has no rate limit of
//! its own: the words of a row are in memory about 10 us after the row is due.

use virtual_board::row_rate::{lost_rows, start};

use super::common::*;
use super::identical::{lines_of_pc, options};

/// Runs the firmware with the default estimator for `count` rows. Every row must be read, and every line must
/// be that of the core on a PC.
fn assert_sustained(rows_per_second: f64, rows: u16, count: u64) {
    let mut board = CleanBoard::of(start(firmware(), rows_per_second, rows));
    keep_all_rows(&mut board);
    board.take_lines();
    let before = board.statistics();
    let (began, first) = (board.now(), board.statistics().rows);
    let lost = lost_rows(&mut board, rows_per_second, count);
    assert_eq!(lost.expect("rows"), 0);
    let busy = 1.0 - board.statistics().since(&before).asleep();
    // Rows come at the rate that was asked for, to a row at either end.
    let read = board.statistics().rows - first;
    let due = (board.now() - began) as f64 * 1e-9 * rows_per_second;
    assert!((read as f64 - due).abs() <= 2.0, "{read} rows of {due}");
    let lines = take_results(&mut board);
    let shown = kept_rows(&mut board);
    let status = Status::ask(&mut board);
    status.assert_none(&["rows failed"]);
    let (count, slowest) = (lines.len(), status.count("slowest row cycles"));
    println!("{rows_per_second} rows a second, {rows} a frame: {read} rows, {count} lines");
    println!("the slowest row took {slowest}; the core is busy for {busy:.3} of the time");
    assert_same_lines(&shown, rows, &lines);
}

/// The chip's lines are the PC's, in order. The serial line may be too slow for all of them.
fn assert_same_lines(shown: &[Row], rows: u16, chip: &[String]) {
    let (settings, calibration) = (options(|it| it.rows = rows), Calibration::nominal());
    let (calibration, errors) = (calibration.as_ref(), &CalibrationErrors::Nominal);
    let frames = shown.len() / usize::from(rows);
    assert!(chip.len() >= frames / 8, "{} lines", chip.len());
    // The first lines may be of frames that began before the first of these rows. A frame may begin with any
    // row.
    let chip = &chip[3..];
    let same = (0..usize::from(rows)).map(|first| {
        let pc = lines_of_pc(&shown[first..], settings, calibration, errors, None);
        let mut of_the_pc = pc.iter();
        let is_next = |line: &&String| of_the_pc.any(|pc| pc == *line);
        chip.iter().take_while(is_next).count()
    });
    assert_eq!(same.max(), Some(chip.len()), "lines that are the PC's");
}

#[test]
fn two_thousand_rows_a_second_are_sustained() {
    for rows in [16, 64] {
        assert_sustained(2000.0, rows, 600);
    }
}

/// 168 MHz leave 25,800 instructions for a row, frame ends and interrupts included. With 64 rows a frame, the
/// frame's end takes longer than the three rows that can wait.
#[test]
#[ignore = "takes 20 s; .ci/run runs it"]
fn six_and_a_half_thousand_rows_a_second_are_sustained() {
    assert_sustained(6500.0, 16, 4000);
}
