//! An emulated NUCLEO-F429ZI with its sensor head. It runs the ELF file of slitrange's firmware that you
//! flash on a real board, in virtual time. Each run with the same inputs is the same.
//!
//! ```no_run
//! use std::time::Duration;
//! use virtual_board::{Firmware, VirtualBoard};
//!
//! # fn main() -> anyhow::Result<()> {
//! let firmware = Firmware::build()?;
//! // A dark sensor with a black level of 200 counts.
//! let light = |_: &virtual_board::Exposure| vec![200.0_f32; virtual_board::PIXELS];
//! let mut board = VirtualBoard::power_on(&firmware, Box::new(light))?;
//! board.send("help\r\n");
//! let line = board.run_until_line(|line| line.starts_with("help"), Duration::from_millis(100))?;
//! println!("{line}");
//! board.finish()?;
//! # Ok(())
//! # }
//! ```
//!
//! The processor and its peripherals are [rigless](https://docs.rs/rigless)'s STM32F427, which is the
//! STM32F429's die without the LCD controller. This crate adds what is connected to its pins: [`sensor_head`]
//! and [`serial_line`]. The sensor head delivers rows and checks the data sheets' limits: if the firmware
//! violates a limit, the run ends with an error. [`flash`] adds the contents of flash memory, which the
//! processor's model does not have and which survive a power cycle.
//!
//! What this does not show: CPU and flash timing (every instruction takes one clock, so counts are exact and
//! times are not the silicon's), bus arbitration, analogue effects, and the instant at which a word
//! of a read-out reaches memory (up to 0.2 ms late).

// A module uses those before it (host-tests/tests/floors.rs). rustfmt sorts each group.
mod base;
mod forward;
pub mod hang;
pub mod port_pin;
mod random;
pub mod rtt;
pub mod trace;
mod trigger;
pub mod violations;
mod warm_cores;

pub mod firmware;
pub mod flash;
mod flash_times;
pub mod sensor_head;
pub mod serial_line;
mod watched_core;

mod burst;
mod laser;
pub mod light;
pub mod stage;
pub mod stm32f429;

pub mod jumpers;
mod pins;

pub mod board;
pub mod run;
pub mod upload;

#[cfg(unix)]
pub mod pty;
pub mod row_rate;

pub use base::Nanos;
pub use firmware::Firmware;
pub use flash::SharedFlash;
pub use run::{Statistics, VirtualBoard};
pub use sensor_head::{Exposure, FULL_SCALE, LightSource, OpenLine, PIXELS, Row, SensorHead};
pub use serial_line::{Arrival, Line};
pub use violations::Violation;
