//! Which rate of rows the firmware sustains with nothing lost. The sensor head has no rate limit of its own,
//! and rows are due as often as the caller asks for.
//!
//! The firmware is the one that is flashed. Its clock (TIM5) runs faster than on silicon, so all its times
//! are shorter by one factor: the row's period, timeouts, and the uptime that it states. The core executes as
//! many instructions a second as before. A row's words are in memory about 10 us after the row is due.

use std::time::Duration;

use anyhow::{Result, ensure};
use simulator::scene::Scene;

use crate::base::Nanos;
use crate::board::{Conditions, INSTRUCTIONS_PER_SECOND};
use crate::firmware::Firmware;
use crate::run::VirtualBoard;
use crate::sensor_head::{Exposure, LightSource};

/// Rows of light that come one after the other, again and again.
const LIGHT: u64 = 61;

/// The firmware's time from one row to the next by its own clock, s (`ROW_PERIOD`).
const FIRMWARE_ROW_PERIOD: f64 = 5.7e-3;

/// The longest wait for an answer or for rows.
const PATIENCE: Duration = Duration::from_secs(10);

/// The time that the firmware has to send an answer and to catch up. The longest answer takes 0.27 s.
const SETTLING: Duration = Duration::from_millis(300);

/// Rows that are looked at together: fewer than the head keeps, and than come in a step of the run.
const TOGETHER: u64 = 40;

/// White paper whose spot moves by half a pixel, with noise. The rows are made beforehand, because a run
/// takes thousands.
pub fn light() -> LightSource {
    let scene = Scene::white_paper().with_height(2000.0);
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
/// The emulator fails, or the firmware does not answer.
pub fn start(firmware: &Firmware, rows_per_second: f64, rows: u16) -> Result<VirtualBoard> {
    // The rates that the pages state are those of one instruction a cycle.
    let conditions = Conditions {
        has_rate_limit: false,
        instructions_per_second: INSTRUCTIONS_PER_SECOND,
        row_timer_speed: rows_per_second * FIRMWARE_ROW_PERIOD,
        ..Conditions::default()
    };
    let mut board = VirtualBoard::power_on_under(firmware, light(), conditions)?;
    let starts = |line: &str| line.starts_with("slitrange ");
    board.run_until_line(starts, PATIENCE)?;
    board.tell("exposure 5600", PATIENCE)?;
    board.tell(&format!("rows {rows}"), PATIENCE)?;
    board.run_for(SETTLING)?;
    Ok(board)
}

/// Lets the board read `count` rows. Gives the rows that it lost meanwhile.
///
/// # Errors
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
