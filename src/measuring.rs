//! Measures rows: brings rows and settings to the pure core, and its results to the serial line.

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::Poll;

use embassy_futures::yield_now;
use embassy_sync::channel::TrySendError;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::frame::comb::Comb;
use slitrange::light::ambient::AmbientMode;
use slitrange::row::pixels::flat_field::{FlatField, Kind, TakeError, Taken};
use slitrange::row::pixels::map::PixelMap;
use slitrange::{Fault, Geometry, Measured, Measurement, Options};
use slitrange_device::protocol::packet::Window;
use static_cell::StaticCell;

use crate::board;
use crate::counters::COUNTERS;
use crate::heads::{self, LONGEST_EXPOSURE, WORDS};
use crate::laser_order::LASER;
use crate::requests::{Flat, MEASURING, Request, RowAlone, SETTINGS};
use crate::results::{FrameEnd, IDLE, RESULTS};
use crate::rows::ROWS;
use crate::trigger::FRAMES;

/// The sensor is silent if no row comes for so long, 17 row periods.
const LONGEST_WAIT: Duration = Duration::from_millis(100);

/// The pipeline. In core-coupled memory, which no DMA needs, so that the stack has the room.
#[unsafe(link_section = ".ccm.measurement")]
static MEASUREMENT: StaticCell<Measurement> = StaticCell::new();

/// Measures for ever. Deadline: a row within [`heads::ROW_PERIOD`] on average, or rows are lost.
/// A slow row may take longer by the periods of the rows that the buffers hold.
#[embassy_executor::task]
pub async fn measure() {
    let measurement =
        MEASUREMENT.init_with(|| Measurement::new(heads::geometry(), for_head(Options::default())));
    let mut flat: Option<Flat> = None;
    let mut is_corrected = false;
    let mut silence = Silence::new();
    loop {
        // Settings and requests first, so that they hold for every row that comes after them.
        if let Some(applied) = SETTINGS.try_take() {
            measurement.set_geometry(applied.geometry);
            measurement.set(for_head(applied.settings.options()), applied.profile);
            measurement.set_comb(applied.comb.unwrap_or_else(Comb::nominal));
            order_light(measurement);
            // The frame starts again, so this counts as a result. Otherwise a user who changes settings
            // faster than frames end would make the watchdog take the lack of results for a fault.
            COUNTERS.results.add();
        }
        match MEASURING.requests.try_receive() {
            Ok(Request::Use(given, on)) => {
                flat = Some(given);
                is_corrected = on;
                // All rows of a frame need the same map.
                measurement.start_frame();
                COUNTERS.results.add();
            }
            Ok(Request::Take(kind)) => {
                let taken = match &mut flat {
                    Some(flat) => take_rows(flat, kind, measurement.geometry()).await,
                    None => Err(TakeError::Silent),
                };
                MEASURING.taken.send(taken).await;
                silence = Silence::new();
            }
            Ok(Request::Give) => {
                if let Some(flat) = flat.take() {
                    MEASURING.map.send(flat).await;
                }
            }
            Ok(Request::MeasureAlone) => {
                let map = flat.as_deref().and_then(FlatField::map);
                MEASURING
                    .row
                    .send(next_row_alone(measurement, map.filter(|_| is_corrected)).await)
                    .await;
                silence = Silence::new();
            }
            Err(_) => {}
        }
        let Ok(row) = ROWS.full.try_receive() else {
            if silence.comes_before_event().await && !MEASURING.is_paused() {
                let fault = measurement.silence();
                if FRAMES.end_in_silence() {
                    publish(Err(fault), Instant::now());
                } else {
                    IDLE.signal(());
                }
            }
            continue;
        };
        silence.row_came();
        if MEASURING.is_paused() {
            ROWS.free.send(row.words).await;
            // The frame starts again after the pause.
            measurement.start_frame();
            continue;
        }
        if FRAMES.begins_with(row.pulses) {
            measurement.start_frame();
            IDLE.signal(());
        }
        let start = board::cycles();
        let map = flat.as_deref().and_then(FlatField::map);
        let map = map.filter(|_| is_corrected);
        let result = measure_row(measurement, row.words, row.exposure, map);
        order_light(measurement);
        let cycles = board::cycles().wrapping_sub(start);
        COUNTERS.row_cycles.set(cycles);
        COUNTERS.slowest_row_cycles.set_if_larger(cycles);
        let ended = result.is_some();
        // Between triggers frames are measured too, so that exposure and ambient light stay up to date.
        let result = result.filter(|_| FRAMES.end());
        if let Some(Ok(measured)) = &result {
            publish_window(measured, measurement.geometry(), row.words, row.at);
        }
        ROWS.free.send(row.words).await;
        if let Some(result) = result {
            publish(result, row.at);
            // If rows come faster than they are computed, one always waits here, and the serial line would
            // never have its turn.
            yield_now().await;
        } else if ended {
            IDLE.signal(());
            yield_now().await;
        }
    }
}

/// Finds out that no row came for [`LONGEST_WAIT`]. Its alarm rings once in that time, not once a row:
/// setting an alarm costs more than handing on a row.
struct Silence {
    begins: Instant,
    alarm: Option<Instant>,
}

impl Silence {
    fn new() -> Self {
        Self {
            begins: Instant::now() + LONGEST_WAIT,
            alarm: None,
        }
    }

    fn row_came(&mut self) {
        self.begins = Instant::now() + LONGEST_WAIT;
    }

    /// Waits for a row or a request. Returns whether the sensor is silent instead. New settings alone wait
    /// for either, because they matter to rows only.
    async fn comes_before_event(&mut self) -> bool {
        poll_fn(|context| {
            if ROWS.full.poll_ready_to_receive(context).is_ready()
                || MEASURING.requests.poll_ready_to_receive(context).is_ready()
            {
                return Poll::Ready(false);
            }
            let now = Instant::now();
            if now >= self.begins {
                self.begins = now + LONGEST_WAIT;
                return Poll::Ready(true);
            }
            if self.alarm.is_none_or(|alarm| now >= alarm) {
                self.alarm = Some(self.begins);
                let _ = pin!(Timer::at(self.begins)).poll(context);
            }
            Poll::Pending
        })
        .await
    }
}

/// Measures the next row that arrives, by itself. Its exposure may have begun before the command, by up to
/// two rows. Rows without the laser's light do not count, unless the setting `laser` is off.
async fn next_row_alone(measurement: &mut Measurement, map: Option<&PixelMap>) -> RowAlone {
    free_waiting_rows().await;
    let row = loop {
        let Ok(row) = with_timeout(LONGEST_WAIT, ROWS.full.receive()).await else {
            return (None, Err(measurement.silence()));
        };
        if !is_left_out(measurement, row.words, row.exposure) {
            break row;
        }
        ROWS.free.send(row.words).await;
    };
    let measured = measurement.measure_alone(row.words, row.exposure, map);
    (Some(row), measured)
}

/// The settings with the longest exposure of this sensor head. Auto exposure has to know this limit.
fn for_head(options: Options) -> Options {
    Options {
        exposure_limit: options.exposure_limit.min(LONGEST_EXPOSURE),
        ..options
    }
}

/// Orders the laser's light for the rows to come.
fn order_light(measurement: &Measurement) {
    let options = measurement.options();
    let exposure = options.laser.then(|| measurement.next_exposure());
    LASER.set(exposure, options.ambient);
}

/// Returns whether a row must not be measured: it was exposed with the laser off although the setting `laser`
/// is on, or for another time than the setting `exposure` says. With `ambient subtract` a row without the
/// laser counts in the mean of the ambient light. Any other such row was exposed before the settings changed.
fn is_left_out(measurement: &mut Measurement, words: &[u16], exposure: Option<Exposure>) -> bool {
    let options = measurement.options();
    match (exposure, options.exposure) {
        _ if !options.laser => false,
        (Some(of_row), ExposureMode::Fixed(_)) => of_row != measurement.next_exposure(),
        (Some(_), ExposureMode::Auto) => false,
        (None, _) => {
            if options.ambient == AmbientMode::Subtract {
                measurement.ambient_row(words);
            }
            true
        }
    }
}

/// Frees the rows that wait: they may have been exposed before the command came.
async fn free_waiting_rows() {
    while let Ok(row) = ROWS.full.try_receive() {
        ROWS.free.send(row.words).await;
    }
}

/// Takes the rows of a map. Each row counts as a sign of life: no reading is due meanwhile.
async fn take_rows(
    flat: &mut FlatField,
    kind: Kind,
    geometry: &Geometry,
) -> Result<Taken, TakeError> {
    free_waiting_rows().await;
    flat.begin(kind, geometry)?;
    loop {
        let Ok(row) = with_timeout(LONGEST_WAIT, ROWS.full.receive()).await else {
            return Err(TakeError::Silent);
        };
        let taken = flat.add(row.words, geometry);
        ROWS.free.send(row.words).await;
        COUNTERS.results.add();
        if let Some(taken) = taken {
            return taken;
        }
    }
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
    exposure: Option<Exposure>,
    map: Option<&PixelMap>,
) -> Option<Result<Measured, Fault>> {
    if is_left_out(measurement, words, exposure) {
        return None;
    }
    measurement.row_with(words, exposure, map)
}

/// Publishes the pixels around the spot of a frame's last row, if they are to be sent.
fn publish_window(measured: &Measured, geometry: &Geometry, words: &[u16], at: Instant) {
    if !MEASURING.sends_windows() {
        return;
    }
    if let Some(window) = Window::new(measured, geometry, words)
        && let Err(TrySendError::Full(window)) = RESULTS.windows.try_send((at, window))
    {
        // The oldest one makes room: its result was not sent.
        let _ = RESULTS.windows.try_receive();
        COUNTERS
            .lines_dropped
            .add_if(RESULTS.windows.try_send(window).is_err());
    }
}

/// Never waits: a serial line that is behind must not keep rows from being measured.
fn publish(result: Result<Measured, Fault>, at: Instant) {
    COUNTERS.frames.add();
    COUNTERS.result_is_fault.set(result.is_err().into());
    let end = FrameEnd {
        number: COUNTERS.frames.get(),
        at,
        result,
    };
    COUNTERS
        .lines_dropped
        .add_if(RESULTS.frames.try_send(end).is_err());
}
