//! The sensor head that the firmware is built for: its driver, and the numbers that the other modules need
//! of it.
//!
//! A driver is a module with the items that are re-exported here. docs/another-sensor.md says how to add one.

use crate::board::processor::CORE_HZ;

mod read_out;
mod tcd1304;

pub use read_out::{ReadOutError, SCLK_HZ};
pub use tcd1304::{
    LONGEST_EXPOSURE, MASTER_CLOCK_HZ, NAME, ROW_PERIOD, Tcd1304 as SensorHead, geometry,
};

/// Words in a row, all of which one DMA transfer brings.
pub const WORDS: usize = geometry().words;

/// Core cycles in a period of the sensor's master clock.
pub const CYCLES_A_MASTER_CLOCK: u32 = CORE_HZ / MASTER_CLOCK_HZ;
