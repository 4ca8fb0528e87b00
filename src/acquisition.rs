//! Reads rows on time: pulses the sensor at a fixed period, and reads a row whenever a buffer is free.

use embassy_time::{Duration, Ticker};
use static_cell::ConstStaticCell;

use super::shared::{BUFFERS, Buffer, COUNTERS, FREE, FULL, WORDS};
use super::tcd1304::Tcd1304;

/// Time from one row to the next, and so the exposure: a read-out (5.63 ms), the pulses and some slack. 175
/// rows a second.
pub const ROW_PERIOD: Duration = Duration::from_micros(5700);

/// Pulses before the first row. The pixels have gathered light since the power came on, and one pulse does
/// not clear all of it.
const CLEARING_PULSES: u32 = 4;

static ROWS: ConstStaticCell<[[u16; WORDS]; BUFFERS]> = ConstStaticCell::new([[0; WORDS]; BUFFERS]);

/// Takes rows for ever. Deadline: the pulses, within 60 us of the tick; then DMA works alone.
///
/// A row that finds no free buffer is lost. The sensor is pulsed all the same, because a skipped pulse would
/// expose the next row twice as long. A failed read-out makes the next exposure longer, so the sensor is
/// cleared anew. The rows of the clearing pulses are not read. If no rows come for long, measuring calls the
/// sensor silent.
#[embassy_executor::task]
pub async fn acquire(mut sensor: Tcd1304) {
    for row in ROWS.take() {
        FREE.send(row).await;
    }
    let mut due = Ticker::every(ROW_PERIOD);
    let mut clearing = CLEARING_PULSES;
    loop {
        due.next().await;
        COUNTERS.pulses.add();
        if clearing > 0 {
            clearing -= 1;
            sensor.pulse();
            continue;
        }
        let Ok(row) = FREE.try_receive() else {
            COUNTERS.rows_lost.add();
            sensor.pulse();
            continue;
        };
        if read(&mut sensor, row).await {
            continue;
        }
        clearing = CLEARING_PULSES;
        due.reset();
    }
}

/// Reads a row and hands it on. Returns whether it succeeded.
async fn read(sensor: &mut Tcd1304, row: Buffer) -> bool {
    match sensor.read_out(row).await {
        Ok(()) => {
            COUNTERS.rows.add();
            FULL.send(row).await;
            true
        }
        Err(error) => {
            COUNTERS.rows_failed.add();
            defmt::warn!("read-out failed: {}", error);
            FREE.send(row).await;
            false
        }
    }
}
