//! What the session wants of measuring, and measuring's answers.

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use slitrange::row::pixels::flat_field::{FlatField, Kind, TakeError, Taken};
use slitrange::{Fault, Measured};
use slitrange_device::session::Applied;

use crate::rows::ExposedRow;

/// The map of the pixels, with the sums of rows for another one. The task that has the reference owns them.
pub type Flat = &'static mut FlatField;

/// What measuring does between two rows.
pub enum Request {
    /// Use this map, or only hold it.
    Use(Flat, bool),
    /// Take rows for a map. The answer is [`Requests::taken`].
    Take(Kind),
    /// Give the map away: [`Requests::map`].
    Give,
    /// Measure the next row by itself, and give it away: [`Requests::row`].
    MeasureAlone,
}

/// A row, and what measuring makes of it. No row if the sensor is silent.
pub type RowAlone = (Option<ExposedRow>, Result<Measured, Fault>);

/// Changed settings, with what the calibration knows of the sensor. Only the last change matters.
///
/// No part of [`MEASURING`]: a signal of this size is not zero at first, so flash would hold them both.
pub static SETTINGS: Signal<CriticalSectionRawMutex, Applied> = Signal::new();

/// The measuring task, as the session sees it.
pub static MEASURING: Requests = Requests {
    runs: AtomicBool::new(false),
    sends_windows: AtomicBool::new(false),
    requests: Channel::new(),
    taken: Channel::new(),
    map: Channel::new(),
    row: Channel::new(),
};

/// See [`MEASURING`]. The channels hold one, because the session waits for the answer to each request.
pub struct Requests {
    runs: AtomicBool,
    sends_windows: AtomicBool,
    /// Requests to measuring.
    pub requests: Channel<CriticalSectionRawMutex, Request, 1>,
    /// How the rows of a map were taken.
    pub taken: Channel<CriticalSectionRawMutex, Result<Taken, TakeError>, 1>,
    /// The map that measuring gives away.
    pub map: Channel<CriticalSectionRawMutex, Flat, 1>,
    /// The row that was measured by itself.
    pub row: Channel<CriticalSectionRawMutex, RowAlone, 1>,
}

// Relaxed: the flags order nothing, and both tasks run in the same executor.
impl Requests {
    /// No reading is due from now on: rows are taken and dropped. So it is from the start until the flash has
    /// been read, during each save and each job with the map of the pixels, and while a row is sent.
    pub fn pause(&self) {
        self.runs.store(false, Ordering::Relaxed);
    }

    /// Readings are due again.
    pub fn resume(&self) {
        self.runs.store(true, Ordering::Relaxed);
    }

    /// Whether no reading is due.
    pub fn is_paused(&self) -> bool {
        !self.runs.load(Ordering::Relaxed)
    }

    /// From now on, the pixels around the spot are to be sent, or are not.
    pub fn send_windows(&self, sends: bool) {
        self.sends_windows.store(sends, Ordering::Relaxed);
    }

    /// Whether the pixels around the spot are to be sent.
    pub fn sends_windows(&self) -> bool {
        self.sends_windows.load(Ordering::Relaxed)
    }

    /// Uses this map, or only holds it.
    pub async fn use_map(&self, map: Flat, is_used: bool) {
        self.requests.send(Request::Use(map, is_used)).await;
    }

    /// Takes the map from measuring, which holds it between two jobs.
    pub async fn take_map(&self) -> Flat {
        self.requests.send(Request::Give).await;
        self.map.receive().await
    }

    /// Takes the rows of a map.
    pub async fn take_rows(&self, kind: Kind) -> Result<Taken, TakeError> {
        self.requests.send(Request::Take(kind)).await;
        self.taken.receive().await
    }

    /// Measures the next row by itself. Its buffer goes back to [`ROWS`](crate::rows::ROWS).
    pub async fn measure_alone(&self) -> RowAlone {
        self.requests.send(Request::MeasureAlone).await;
        self.row.receive().await
    }
}
