//! The serial line's words: commands in, lines out. Pure text; the firmware brings the bytes.

pub mod advice;
pub mod calibration;
pub mod command;
pub mod csv;
pub mod flat;
pub mod help;
pub mod info;
pub mod input;
pub mod line;
pub mod modbus;
mod nearest;
pub mod packet;
pub mod piece;
pub mod refusal;
pub mod row_lines;
pub mod selftest;
pub mod status;
pub mod upload;

/// The longest answer, in bytes with its line ends: `help`, with room for one setting more.
pub const MAX_ANSWER: usize = 4608;
