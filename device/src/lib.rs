//! The parts of a slitrange sensor around its measurement, without hardware: settings, the session on the
//! serial line, the protocols, filters and limits of readings, calibration records and their store in flash.
//!
//! ```text
//! line -> command -> Session -> actions: text, settings for the measurement, what flash is to hold
//! result of a frame -> spike filter -> average -> hold -> limits -> columns -> line, packet or registers
//! ```
//!
//! The core, [`slitrange`], makes the results. The owner of the serial line brings events to
//! [`session::Session`] and carries out its actions: the firmware, or a test on a PC.
//!
//! # Memory
//!
//! | static RAM on a 32-bit chip | bytes |
//! |---|---|
//! | [`session::Session`], with settings, record, an upload, and the readings of `average` | 8184 |
//! | [`record::Record`], a calibration with the sensor that it belongs to | 2912 |
//! | [`Settings`] | 92 |
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::cast_possible_truncation))]
#![cfg_attr(not(test), warn(clippy::cast_sign_loss, clippy::unwrap_used))]

// A module uses those before it (host-tests/tests/floors.rs). The blank lines keep rustfmt from sorting them.

pub mod text;

pub mod filters;

pub mod settings;

pub mod record;

pub mod store;

pub mod protocol;

pub mod session;

pub use settings::Settings;
