//! Measures rows: brings rows and settings to the pure core, and its results to the serial line.

use core::sync::atomic::Ordering;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, with_timeout};
use slitrange::fault::Fault;
use slitrange::measurement::Measurement;
use slitrange::reading::Measured;
use slitrange::settings::Settings;

use super::shared::{COUNTERS, FREE, FULL, PAUSED, RESULTS, SETTINGS, WORDS};
use super::{board, tcd1304};

/// The sensor is silent if no row comes for so long, 17 row periods.
const SILENCE: Duration = Duration::from_millis(100);

/// Measures for ever. Deadline: a row within [`super::acquisition::ROW_PERIOD`], or rows are lost.
#[embassy_executor::task]
pub async fn measure() {
    let mut measurement = Measurement::new(tcd1304::geometry(), Settings::default());
    loop {
        // Settings first, so that they hold for every row that comes after them.
        match select(SETTINGS.wait(), with_timeout(SILENCE, FULL.receive())).await {
            Either::Second(Ok(row)) if paused() => {
                FREE.send(row).await;
                // The frame starts again after the pause.
                measurement.set(*measurement.settings());
            }
            Either::Second(Ok(row)) => {
                let start = board::cycles();
                let result = measure_row(&mut measurement, row);
                COUNTERS.row_cycles.set(board::cycles().wrapping_sub(start));
                FREE.send(row).await;
                if let Some(result) = result {
                    publish(result);
                }
            }
            Either::Second(Err(_)) if paused() => {}
            Either::Second(Err(_)) => publish(Err(measurement.silence())),
            Either::First(settings) => {
                measurement.set(settings);
                // The frame starts again, so this counts as a result. Otherwise a user who changes settings
                // faster than frames end would make the watchdog take the lack of results for a fault.
                COUNTERS.results.add();
            }
        }
    }
}

fn paused() -> bool {
    // Relaxed: this orders nothing, and the task that sets it runs in the same executor.
    PAUSED.load(Ordering::Relaxed)
}

/// Computes a row: all the computation that a row takes.
///
/// It keeps its name and stays a function, so that a debugger finds it, and a test on the virtual board can
/// make it hang. Its cost can be counted from its first instruction to its last.
#[inline(never)]
#[unsafe(no_mangle)]
fn measure_row(
    measurement: &mut Measurement,
    words: &mut [u16; WORDS],
) -> Option<Result<Measured, Fault>> {
    measurement.row(words)
}

/// Never waits: a serial line that is behind must not keep rows from being measured.
fn publish(result: Result<Measured, Fault>) {
    COUNTERS
        .lines_dropped
        .add_if(RESULTS.try_send(result).is_err());
}
