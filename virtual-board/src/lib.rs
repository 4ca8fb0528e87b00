//! A NUCLEO-F429ZI with its sensor head, emulated: it runs slitrange's firmware as it is flashed, in virtual time and
//! deterministically, so that what is tested is the ELF file that ships.
//!
//! ```no_run
//! use std::time::Duration;
//! use virtual_board::{Firmware, VirtualBoard};
//!
//! # fn main() -> anyhow::Result<()> {
//! let firmware = Firmware::build()?;
//! // A dark sensor with a black level of 200 counts.
//! let mut board = VirtualBoard::power_on(&firmware, Box::new(|_exposure| vec![200.0; virtual_board::PIXELS]))?;
//! board.send("help\r\n");
//! let line = board.run_until_line(|line| line.starts_with("help"), Duration::from_millis(100))?;
//! println!("{line}");
//! board.finish()?;
//! # Ok(())
//! # }
//! ```
//!
//! The processor and its peripherals are [rigless](https://docs.rs/rigless)'s STM32F427, which is the STM32F429's die
//! without the LCD controller. What hangs on its pins is ours: [`sensor_head`] and [`serial_line`]. The head does not
//! only deliver rows: it holds the firmware to the data sheets' limits and makes a violated one an error of the run.
//! [`flash`] is what the processor's model leaves out of flash memory, and what is kept over a power cycle.
//!
//! What this does not show: CPU and flash timing (every instruction takes one clock, so counts are exact and times are
//! not the silicon's), bus arbitration, SPI mode, and analogue effects.

pub mod board;
mod burst;
pub mod firmware;
pub mod flash;
pub mod hang;
pub mod light;
#[cfg(unix)]
pub mod pty;
pub mod rtt;
pub mod run;
pub mod sensor_head;
pub mod serial_line;
pub mod stage;
pub mod stm32f429;
pub mod trace;
mod watched_core;

pub use firmware::Firmware;
pub use flash::SharedFlash;

pub use run::{Statistics, VirtualBoard};
pub use sensor_head::{Exposure, FULL_SCALE, LightSource, PIXELS, Row, SensorHead, Violation};
pub use serial_line::Line;

/// Nanoseconds of virtual time, counted from power-on.
pub type Nanos = u64;
