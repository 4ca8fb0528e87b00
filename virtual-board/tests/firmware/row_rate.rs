//! The rate of rows that the firmware sustains. The sensor head here has no rate limit of its own: the words
//! of a row are in memory about 10 us after the row is due.

use std::time::Duration;

use slitrange::distance::Calibration;
use slitrange::settings::Settings;
use virtual_board::{Exposure, LightSource, Row, VirtualBoard};

use crate::common::{PATIENCE, Status, firmware, is_result, set, spot_at};
use crate::identical::on_this_pc;

/// Rows of each run.
const ROWS: u64 = 4000;

/// Rows of light that come one after the other, again and again.
const LIGHT: usize = 61;

/// White paper whose spot moves by half a pixel, with noise. The rows are made beforehand, because a run
/// takes thousands.
fn some_rows() -> LightSource {
    let exposure = Exposure { start: 0, end: 0 };
    let rows: Vec<Vec<f32>> = (0..LIGHT)
        .map(|row| spot_at(1800.0 + row as f64 / 128.0, 2000.0)(&exposure))
        .collect();
    let mut turn = 0;
    Box::new(move |_: &Exposure| {
        turn += 1;
        rows[turn % LIGHT].clone()
    })
}

/// The first rows of a list that are not lost: those before a row that comes more than half a period late.
fn without_gap(rows: &[Row], rows_per_second: f64) -> usize {
    let late = 1.5e9 / rows_per_second;
    let gap = rows.windows(2).position(|pair| {
        let [before, now] = [pair[0].exposure.end, pair[1].exposure.end];
        (now - before) as f64 > late
    });
    gap.map_or(rows.len(), |gap| gap + 1)
}

/// Runs the firmware with the default estimator. Every row must be read, and every line must be that of the
/// core on a PC.
fn assert_sustained(rows_per_second: f64, rows: u16) {
    let light = some_rows();
    let mut board = VirtualBoard::power_on_without_rate_limit(firmware(), light, rows_per_second)
        .expect("the board starts");
    let banner = board.run_until_line(|line| line.starts_with("slitrange "), PATIENCE);
    banner.expect("a banner");
    set(&mut board, &format!("rows {rows}"));
    // The answer to a command may cost rows: wait until its text is out.
    board.run_for(Duration::from_millis(50)).expect("a run");
    board.head(|head| head.keep_all_rows(true));
    board.take_lines();
    let lost_before = Status::ask(&mut board);
    board.run_for(Duration::from_millis(300)).expect("a run");
    let (first, began, before) = (
        board.head(|head| head.row_count()),
        board.now(),
        board.statistics(),
    );
    board.take_lines();
    board.run_until_rows(ROWS, 10 * PATIENCE).expect("rows");
    let after = board.statistics();
    let read = board.head(|head| head.row_count()) - first;
    let expected = (board.now() - began) as f64 * 1e-9 * rows_per_second;
    let lines: Vec<String> = board
        .take_lines()
        .into_iter()
        .map(|line| line.text)
        .collect();
    let status = Status::ask(&mut board);
    let shown: Vec<Row> = board.head(|head| head.rows().cloned().collect());
    let sustained = &shown[shown.len() - ROWS as usize..];
    println!(
        "{rows_per_second} rows a second, {rows} a frame: {read} of {expected:.1} rows, {:.0} instructions a \
         row, {} at most from words to centre, {:.1} % asleep, {} lines; lost {} to {}",
        (after.instructions - before.instructions) as f64 / read as f64,
        status.count("slowest row cycles"),
        100.0
            - 100.0 * (after.instructions - before.instructions) as f64
                / (168e6 * (after.seconds - before.seconds)),
        lines.len(),
        lost_before.count("rows lost"),
        status.count("rows lost"),
    );
    assert!(
        (read as f64 - expected).abs() < 1.5,
        "{read} rows of {expected}"
    );
    assert_eq!(without_gap(sustained, rows_per_second), ROWS as usize);
    status.assert_none(&["rows failed"]);
    assert_same_lines(&shown, rows, &lines);
    let [whole, computed] = instructions_per_row(&mut board, rows);
    println!("{whole:.0} instructions a row, {computed:.0} of them from words to centre");
    board.finish().expect("a clean run");
}

/// Instructions per row over some frames: all that the core executes, and those from a row's words to its
/// centre.
fn instructions_per_row(board: &mut VirtualBoard, rows: u16) -> [f64; 2] {
    board.take_calls();
    board.trace_calls_of(firmware().address_of("measure_row").expect("it is there"));
    let count = |board: &mut VirtualBoard| board.head(|head| head.row_count());
    let (first, before) = (count(board), board.statistics().instructions);
    board
        .run_until_rows(4 * u64::from(rows), PATIENCE)
        .expect("rows");
    let whole = (board.statistics().instructions - before) as f64 / (count(board) - first) as f64;
    let calls = board.take_calls();
    println!(
        "{:?}",
        calls
            .iter()
            .map(|call| call.instructions())
            .collect::<Vec<_>>()
    );
    let frames = calls.len() / usize::from(rows) * usize::from(rows);
    let computed: u64 = calls[..frames].iter().map(|call| call.instructions()).sum();
    [whole, computed as f64 / frames as f64]
}

/// The chip's lines are the PC's, in order. The serial line may be too slow for all of them.
fn assert_same_lines(shown: &[Row], rows: u16, chip: &[String]) {
    let settings = Settings {
        rows,
        ..Settings::default()
    };
    let calibration = Calibration::nominal();
    let chip: Vec<&String> = chip.iter().filter(|line| is_result(line)).collect();
    let enough = shown.len() / usize::from(rows) / 8;
    assert!(chip.len() >= enough, "{} lines", chip.len());
    // A frame may begin with any row.
    let mut same = 0;
    for first in 0..usize::from(rows) {
        let pc = on_this_pc(&shown[first..], settings, calibration.as_ref());
        let mut of_the_pc = pc.iter();
        let found = chip
            .iter()
            .take_while(|line| of_the_pc.any(|pc| pc == **line));
        same = same.max(found.count());
    }
    assert_eq!(
        same,
        chip.len(),
        "lines that are the PC's, of those of the chip"
    );
}

#[test]
fn rows_are_sustained() {
    assert_sustained(2000.0, 16);
    assert_sustained(2000.0, 64);
}

#[test]
#[ignore = "temporary"]
fn search() {
    let rate = std::env::var("RATE").map_or(4000.0, |rate| rate.parse().expect("a number"));
    let rows = std::env::var("FRAME").map_or(16, |rate| rate.parse().expect("a number"));
    assert_sustained(rate, rows);
}
