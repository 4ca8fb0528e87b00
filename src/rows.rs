//! Rows on their way from acquisition to measuring, and their memory on its way back.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::Instant;
use slitrange::base::exposure::Exposure;

use crate::heads::WORDS;

/// A row's memory. While one is read into, another is computed on, and the others wait. The task that has the
/// reference owns the row.
pub type Buffer = &'static mut [u16; WORDS];

/// Rows in use at a time. With two, a row may take twice the row's period before a row is lost. The first row
/// of a frame takes several times as long as the others, so a fast sensor needs more: four are enough for
/// 6,500 rows a second.
pub const BUFFERS: usize = 4;

/// A row that was read.
pub struct ExposedRow {
    /// Its words.
    pub words: Buffer,
    /// For how long the laser was on; `None` if it was off.
    pub exposure: Option<Exposure>,
    /// When its words were in memory.
    pub at: Instant,
    /// The rows read since the start, with this one.
    pub number: u32,
    /// The pulses since the start, with the one that ended this row's exposure.
    pub pulses: u32,
}

/// Rows and buffers.
pub static ROWS: Rows = Rows {
    free: Channel::new(),
    full: Channel::new(),
};

/// See [`ROWS`]. Both channels hold all buffers that there are, so that sending never waits.
pub struct Rows {
    /// Buffers to read into.
    pub free: Channel<CriticalSectionRawMutex, Buffer, BUFFERS>,
    /// Rows to compute on.
    pub full: Channel<CriticalSectionRawMutex, ExposedRow, BUFFERS>,
}
