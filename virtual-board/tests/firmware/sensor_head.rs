//! Tests of the sensor head as the firmware drives it, at the highest rate of readings.

use std::time::Duration;

use slitrange::sensor_heads::TCD1304DG_LEAD_IN;
use virtual_board::Row;
use virtual_board::sensor_head::limits;

use crate::common::{
    Status, fresh_results, is_reading, is_result, measuring, run_into_a_row, stop_the_transfer,
};

/// The time from row to row, as the firmware states it, ns.
const ROW_PERIOD: f64 = 5_700_000.0;

#[test]
fn one_reading_a_row_for_a_second_loses_no_row() {
    let mut board = measuring(1);
    fresh_results(&mut board, 1);
    board.take_lines();
    board.head(|head| head.keep_all_rows(true));
    let (start, first) = (board.now(), board.head(|head| head.row_count()));
    board.run_for(Duration::from_secs(1)).expect("a run");
    let seconds = (board.now() - start) as f64 * 1e-9;
    let read = board.head(|head| head.row_count()) - first;
    let lines = board.take_lines();
    let rows: Vec<Row> = board.head(|head| head.rows().cloned().collect());
    let rows = &rows[rows.len() - read as usize..];

    let rate = read as f64 / seconds;
    let readings = lines.iter().filter(|line| is_reading(&line.text)).count();
    println!("{rate:.1} rows/s, {readings} readings in {seconds:.3} s");
    assert!(rate >= 150.0, "{rate} rows/s");
    assert!(readings as f64 >= 150.0 * seconds, "{readings} readings");
    assert_eq!(
        lines.iter().filter(|line| is_result(&line.text)).count(),
        readings,
        "{lines:#?}"
    );

    let lead_ins: Vec<i64> = rows.iter().map(|row| row.lead_in).collect();
    println!("lead-in {}", lead_ins[0]);
    assert_eq!(lead_ins, vec![TCD1304DG_LEAD_IN as i64; rows.len()]);

    let least = rows.iter().map(|row| row.phase.0).fold(1.0, f64::min);
    let most = rows.iter().map(|row| row.phase.1).fold(0.0, f64::max);
    println!(
        "sampled at {least:.3} to {most:.3} of a pixel's time over {} rows",
        rows.len()
    );
    assert!(rows.len() >= 100, "{} rows", rows.len());
    assert!(limits::HOLD_PHASE.contains(&least) && limits::HOLD_PHASE.contains(&most));
    assert!(most - least < 0.1, "{least} to {most}");

    let periods: Vec<f64> = rows
        .windows(2)
        .map(|rows| (rows[1].read_out - rows[0].read_out) as f64)
        .collect();
    let shortest = periods.iter().copied().fold(f64::INFINITY, f64::min);
    let longest = periods.iter().copied().fold(0.0, f64::max);
    println!(
        "a row every {:.4} to {:.4} ms",
        shortest * 1e-6,
        longest * 1e-6
    );
    assert!(
        periods
            .iter()
            .all(|period| (period - ROW_PERIOD).abs() <= 2_000.0),
        "{shortest} to {longest} ns"
    );

    Status::ask(&mut board).assert_none(&["rows lost", "rows failed", "lines dropped"]);
    board.finish().expect("a clean run");
}

#[test]
fn a_violated_limit_is_an_error_of_the_run() {
    let mut board = measuring(4);
    run_into_a_row(&mut board);
    stop_the_transfer(&mut board);
    let error = board
        .run_for(Duration::from_millis(30))
        .expect_err("a violation")
        .to_string();
    println!("{error}");
    assert!(error.contains("chip select was low for"), "{error}");
    assert!(board.finish().is_err());
}
