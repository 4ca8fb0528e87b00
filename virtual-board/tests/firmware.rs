//! Tests of the firmware on the virtual board, as it is flashed. They give it light, commands and faults, and
//! compare its lines with the expected ones.
//!
//! All topics are one test program, so that the firmware is built and loaded only once.

mod address;
mod ambient;
mod binary;
mod calibration;
mod comb;
mod commands;
mod common;
mod debugger;
mod faults;
mod flash;
mod flat;
mod identical;
mod kept;
mod laser;
mod modbus;
#[cfg(unix)]
mod pseudo_terminal;
mod readings;
mod records;
mod row;
mod row_rate;
mod saving;
mod scenes;
mod selftest;
mod sensor_head;
mod serial_line;
mod stack;
mod streams;
mod trigger;
mod warm_cores;
mod watchdog;
