//! Reads rows on time: pulses the sensor at a fixed period, and reads a row whenever a buffer is free.

use embassy_time::Instant;
use slitrange::base::exposure::Exposure;
use static_cell::ConstStaticCell;

use crate::alarm::{set_alarm, wait_for_alarm};
use crate::counters::COUNTERS;
use crate::heads::{ROW_PERIOD, ReadOutError, SensorHead, WORDS};
use crate::laser_order::LASER;
use crate::rows::{BUFFERS, Buffer, ExposedRow, ROWS};

/// Pulses before the first row. The pixels have gathered light since the power came on, and one pulse does
/// not clear all of it.
const CLEARING_PULSES: u32 = 4;

/// The rows' memory. Each row begins at a multiple of 4. At other addresses it would take 10,000 instructions
/// more, because `dual_mac::sum_blocks` would then add the pixels one by one.
#[repr(align(4))]
struct Memory([[u16; WORDS]; BUFFERS]);

const _: () = assert!(size_of::<[u16; WORDS]>().is_multiple_of(4));

static MEMORY: ConstStaticCell<Memory> = ConstStaticCell::new(Memory([[0; WORDS]; BUFFERS]));

/// Takes rows for ever. Deadline: the pulses, within 60 us of the tick; then DMA works alone.
///
/// A row that finds no free buffer is lost. The sensor is pulsed all the same, because a skipped pulse would
/// expose the next row twice as long. A failed read-out makes the next exposure longer, so the sensor is
/// cleared anew. The rows of the clearing pulses are not read. If no rows come for long, measuring calls the
/// sensor silent.
#[embassy_executor::task]
pub async fn acquire(mut sensor: SensorHead) {
    for row in &mut MEMORY.take().0 {
        ROWS.free.send(row).await;
    }
    let mut clearing = CLEARING_PULSES;
    let mut due = Instant::now() + ROW_PERIOD;
    set_alarm(due).await;
    loop {
        wait_for_alarm(due).await;
        if due.elapsed() >= ROW_PERIOD {
            // The exposure was longer than a period, and so would be the next if it ended now.
            clearing = CLEARING_PULSES;
            due = Instant::now();
        }
        due += ROW_PERIOD;
        COUNTERS.pulses.add();
        if clearing > 0 {
            clearing -= 1;
            sensor.pulse(next_exposure(&sensor)).await;
            set_alarm(due).await;
            continue;
        }
        let Ok(row) = ROWS.free.try_receive() else {
            COUNTERS.rows_lost.add();
            sensor.pulse(next_exposure(&sensor)).await;
            set_alarm(due).await;
            continue;
        };
        if read(&mut sensor, row, due).await {
            continue;
        }
        clearing = CLEARING_PULSES;
        due = Instant::now() + ROW_PERIOD;
        set_alarm(due).await;
    }
}

/// For how long the laser is to be on in the row that begins now; `None` if it is to be off.
fn next_exposure(sensor: &SensorHead) -> Option<Exposure> {
    LASER.exposure_after(sensor.exposing())
}

/// Reads a row and hands it on. Sets the alarm at `next`. Returns whether the next row can be good.
async fn read(sensor: &mut SensorHead, row: Buffer, next: Instant) -> bool {
    let exposure = next_exposure(sensor);
    match sensor.read_out(row, next, exposure).await {
        Ok(exposure) => {
            COUNTERS.rows.add();
            ROWS.full
                .send(ExposedRow {
                    words: row,
                    exposure,
                    at: Instant::now(),
                    number: COUNTERS.rows.get(),
                    // This task alone gives pulses, and has given none since.
                    pulses: COUNTERS.pulses.get(),
                })
                .await;
            true
        }
        // After these and a lost word the sensor was pulsed in time, so the next row is good.
        Err(ReadOutError::Late) => {
            COUNTERS.rows_late.add();
            ROWS.free.send(row).await;
            true
        }
        Err(error) => {
            COUNTERS.rows_failed.add();
            defmt::warn!("read-out failed: {}", error);
            ROWS.free.send(row).await;
            matches!(error, ReadOutError::WordLost)
        }
    }
}
