//! A sensor at a serial port.
//!
//! ```text
//! bytes -> lines -> questions and answers -> points taken, records moved
//!          (line)   (session, answers)       (run)         (transfer)
//! ```

use anyhow::bail;

pub mod answers;
pub mod line;
pub mod positions;
pub mod run;
pub mod session;
pub mod taken;

pub use run::{RunOptions, run};

/// Of `slitrange calibrate write`.
#[derive(clap::Args)]
pub struct WriteOptions {}

/// Of `slitrange calibrate read`.
#[derive(clap::Args)]
pub struct ReadOptions {}

/// Of `slitrange calibrate show`.
#[derive(clap::Args)]
pub struct ShowOptions {}

/// `slitrange calibrate write`.
///
/// # Errors
/// It cannot be done yet.
pub fn write(_: &WriteOptions) -> anyhow::Result<()> {
    bail!("writing a record is not there yet")
}

/// `slitrange calibrate read`.
///
/// # Errors
/// It cannot be done yet.
pub fn read(_: &ReadOptions) -> anyhow::Result<()> {
    bail!("reading a record is not there yet")
}

/// `slitrange calibrate show`.
///
/// # Errors
/// It cannot be done yet.
pub fn show(_: &ShowOptions) -> anyhow::Result<()> {
    bail!("showing a record is not there yet")
}
