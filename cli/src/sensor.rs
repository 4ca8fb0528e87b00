//! A sensor at a serial port.

use anyhow::bail;

/// Of `slitrange calibrate run`.
#[derive(clap::Args)]
pub struct RunOptions {}

/// Of `slitrange calibrate write`.
#[derive(clap::Args)]
pub struct WriteOptions {}

/// Of `slitrange calibrate read`.
#[derive(clap::Args)]
pub struct ReadOptions {}

/// Of `slitrange calibrate show`.
#[derive(clap::Args)]
pub struct ShowOptions {}

/// `slitrange calibrate run`.
///
/// # Errors
/// It cannot be done yet.
pub fn run(_: &RunOptions) -> anyhow::Result<()> {
    bail!("taking points is not there yet")
}

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
