//! Which rate of rows the firmware sustains with nothing lost. The sensor head has no rate limit of its own:
//! see [`VirtualBoard::power_on_without_rate_limit`].

use std::time::Duration;

use anyhow::{Result, ensure};
use simulator::scene::{Scene, Spot};

use crate::{Exposure, Firmware, LightSource, Nanos, VirtualBoard};

/// Rows of light that come one after the other, again and again.
const LIGHT: u64 = 61;

/// The longest wait for an answer or for rows.
const PATIENCE: Duration = Duration::from_secs(10);

/// The time that the firmware has to send an answer and to catch up. The longest answer takes 0.27 s.
const SETTLING: Duration = Duration::from_millis(300);

/// Rows that are looked at together: fewer than the head keeps, and than come in a step of the run.
const TOGETHER: u64 = 40;

/// White paper whose spot moves by half a pixel, with noise. The rows are made beforehand, because a run
/// takes thousands.
#[must_use]
pub fn light() -> LightSource {
    let scene = Scene {
        spot: Some(Spot {
            width: 8.6,
            counts_per_second: 2000.0,
        }),
        ..Scene::white_paper()
    };
    let rows: Vec<Vec<f32>> = (0..LIGHT)
        .map(|row| scene.row_with_centre(row, 1800.0 + row as f64 / 128.0, 1.0))
        .collect();
    let mut next = rows.into_iter().cycle();
    Box::new(move |_: &Exposure| next.next().unwrap_or_default())
}

/// Starts the firmware with its default settings, except for the rows of a frame and a fixed exposure: this
/// light does not depend on the laser, whose pulse takes longer than such a row.
///
/// # Errors
///
/// The emulator fails, or the firmware does not answer.
pub fn start(firmware: &Firmware, rows_per_second: f64, rows: u16) -> Result<VirtualBoard> {
    let mut board = VirtualBoard::power_on_without_rate_limit(firmware, light(), rows_per_second)?;
    let starts = |line: &str| line.starts_with("slitrange ");
    board.run_until_line(starts, PATIENCE)?;
    for command in ["exposure 5600", &format!("rows {rows}")] {
        board.send(&format!("{command}\r\n"));
        board.run_until_line(|line| line == command, PATIENCE)?;
    }
    board.run_for(SETTLING)?;
    Ok(board)
}

/// Lets the board read `count` rows. Gives the rows that it lost meanwhile.
///
/// # Errors
///
/// The emulator fails, or the rows do not come.
pub fn lost_rows(board: &mut VirtualBoard, rows_per_second: f64, count: u64) -> Result<u64> {
    let period = 1e9 / rows_per_second;
    let (mut lost, mut read) = (0, 0);
    let mut last: Option<(u64, Nanos)> = None;
    while read < count {
        board.run_until_rows(TOGETHER, PATIENCE)?;
        let rows: Vec<(u64, Nanos)> = board.head(|head| {
            let rows = head.rows().map(|row| (row.number, row.exposure.end));
            rows.filter(|(number, _)| last.is_none_or(|(last, _)| *number > last))
                .collect()
        });
        for (number, end) in rows {
            if let Some((number_before, end_before)) = last {
                ensure!(number == number_before + 1, "the head kept too few rows");
                // A row that is not read is pulsed all the same, so the next row comes whole periods later.
                lost += ((end - end_before) as f64 / period).round() as u64 - 1;
            }
            last = Some((number, end));
            read += 1;
        }
    }
    Ok(lost)
}

/// What a row costs, on average over whole frames.
#[derive(Clone, Debug)]
pub struct Cost {
    /// Instructions that the core executes in a row's time.
    pub instructions: f64,
    /// Instructions of them from the row's words to its centre, the frame's end included, and the interrupts
    /// meanwhile.
    pub computing: f64,
    /// All that the core executed, in order.
    pub path: Vec<crate::trace::Executed>,
    /// The rows in whose time that was.
    pub rows: f64,
}

/// Counts what `frames` frames cost.
///
/// # Errors
///
/// The emulator fails, or the rows do not come.
pub fn cost(firmware: &Firmware, rows_per_second: f64, rows: u16, frames: u64) -> Result<Cost> {
    let mut board = start(firmware, rows_per_second, rows)?;
    board.take_calls();
    board.trace_calls_of(firmware.address_of("measure_row")?);
    board.trace_everything();
    let began = board.now();
    let count = frames * u64::from(rows);
    board.run_for(Duration::from_secs_f64(count as f64 / rows_per_second))?;
    let path = board.take_everything();
    let calls = board.take_calls();
    let computing: u64 = calls.iter().map(crate::trace::Call::instructions).sum();
    let rows = (board.now() - began) as f64 * 1e-9 * rows_per_second;
    ensure!(!calls.is_empty(), "no row was computed");
    Ok(Cost {
        instructions: path.len() as f64 / rows,
        computing: computing as f64 / rows,
        path,
        rows,
    })
}

/// The highest rate without a lost row, in rows a second, to one in a hundred: by bisection between rates of
/// which the first must be sustained. Each trial has `count` rows.
///
/// # Errors
///
/// The emulator fails, a trial shows another fault than lost rows, or not even `from` is sustained.
pub fn highest(firmware: &Firmware, rows: u16, from: f64, to: f64, count: u64) -> Result<f64> {
    // Only a lost row means that a rate is not sustained. Any other error is a fault.
    let is_sustained = |rate: f64| -> Result<bool> {
        let mut board = start(firmware, rate, rows)?;
        let lost = lost_rows(&mut board, rate, count)?;
        board.finish()?;
        Ok(lost == 0)
    };
    ensure!(
        is_sustained(from)?,
        "{from} rows a second are not sustained"
    );
    let (mut sustained, mut not) = (from, to);
    while not > 1.01 * sustained {
        let middle = (sustained * not).sqrt();
        if is_sustained(middle)? {
            sustained = middle;
        } else {
            not = middle;
        }
    }
    Ok(sustained)
}
