//! What measuring sends to the serial line.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::Instant;
use slitrange::{Fault, Measured};
use slitrange_device::protocol::packet::Window;

/// Results for the serial line. All bytes are zero at first, as `.ccm` wants it: no DMA reaches them, and the
/// stack has the room.
#[unsafe(link_section = ".ccm.results")]
pub static RESULTS: Results = Results {
    frames: Channel::new(),
    windows: Channel::new(),
};

/// See [`RESULTS`].
pub struct Results {
    /// The results of frames. Holds 91 ms of them at the highest rate, a row a frame, so that the answer to
    /// `status` (about 45 ms) loses none.
    pub frames: Channel<CriticalSectionRawMutex, FrameEnd, 16>,
    /// The pixels around the spots, for the results of the same [`FrameEnd::at`]. Holds 46 ms of them, more
    /// than most answers take at the rate that carries them all.
    pub windows: Channel<CriticalSectionRawMutex, (Instant, Window), 8>,
}

/// The result of a frame.
pub struct FrameEnd {
    /// Its number since the start, from 1. Lost results have numbers, too.
    pub number: u32,
    /// The centre, or why there is none.
    pub result: Result<Measured, Fault>,
    /// When the words of the frame's last row were in memory. If no row came: when the firmware noticed it.
    pub at: Instant,
}

/// Set by measuring while it has no result to send, because no trigger came: its sign of life, and the serial
/// line's once that has taken it.
pub static IDLE: Signal<CriticalSectionRawMutex, ()> = Signal::new();
