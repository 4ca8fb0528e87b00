//! From points to a calibration.

pub mod curve;
pub mod eq1;
pub mod observed;
pub mod order;
pub mod outliers;
pub mod solve;
pub mod spline;
pub mod start;

use std::path::PathBuf;

use anyhow::bail;

/// Of `slitrange calibrate fit`.
#[derive(clap::Args)]
pub struct Options {
    /// The points: a CSV file with the columns x_px, d_mm and, if there, sigma_px
    points: PathBuf,
}

/// `slitrange calibrate fit`.
///
/// # Errors
/// It cannot be done yet.
pub fn run(options: &Options) -> anyhow::Result<()> {
    bail!("{}: fitting is not there yet", options.points.display())
}
