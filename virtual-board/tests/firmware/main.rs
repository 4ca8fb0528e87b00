//! The firmware as it is flashed, on the virtual board: it is shown light, told commands and done harm, and what it
//! says is held against what it should.
//!
//! All topics are one program: the firmware is built and loaded once, and the tests share the processor's cores.

mod calibration;
mod commands;
mod common;
mod faults;
mod flash;
mod identical;
mod kept;
#[cfg(unix)]
mod pseudo_terminal;
mod records;
mod saving;
mod scenes;
mod sensor_head;
mod serial_line;
mod stack;
mod watchdog;
