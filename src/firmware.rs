//! All that knows hardware.
//!
//! Four tasks, and what passes between them ([`shared`]):
//!
//! ```text
//! acquisition --full rows--> measuring --centres, faults---> serial line --saved--> flash
//!             <--free rows--           <-settings, pauses---
//! ```
//!
//! and the watchdog, which looks on. Acquisition and watchdog run on an executor of their own in an interrupt, above
//! the other two, so that the time that a row's computation takes does not shift the sensor's pulses.

pub mod acquisition;
pub mod board;
pub mod flash;
pub mod in_use;
pub mod measuring;
pub mod serial_line;
pub mod session;
pub mod shared;
pub mod tcd1304;
pub mod transmitter;
pub mod watchdog;

// Linked for what they define: where defmt's log goes, and what a panic does (it is logged, then everything stops, and
// the watchdog starts the board again).
use {defmt_rtt as _, panic_probe as _};
