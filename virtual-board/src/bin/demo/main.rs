//! `cargo demo`: the firmware as it is flashed, on the emulated board, measuring a target that moves.

#[cfg(unix)]
mod flash_file;
mod lines;
mod moving_target;
mod photograph;
#[cfg(unix)]
mod terminal;

use std::path::PathBuf;

use anyhow::{Context as _, Result};
use clap::Parser;
use virtual_board::Firmware;

/// Builds the firmware, boots it on an emulated NUCLEO-F429ZI with sensor, laser and target, and shows what it reports.
#[derive(Parser)]
#[command(name = "cargo demo", bin_name = "cargo demo")]
struct Options {
    /// Keep the target at this distance in metres, instead of moving it from 0.60 to 1.02.
    #[arg(long, value_name = "METRES")]
    distance: Option<f64>,
    /// Rows in a frame.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=64))]
    rows: u16,
    /// Distances to measure at, from 0.60 to 1.02 m [default: 43; with --scene only the scene's]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    steps: Option<u32>,
    /// Show the sensor this scene in place of white paper: a name that `cargo scene` lists, or the path of a .toml file.
    /// It is seen at the firmware's exposure, not at its own.
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Show the sensor the rows of a photograph (binary PGM, 8 or 16 bit), one after the other.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["distance", "steps", "scene", "pty"])]
    pgm: Option<PathBuf>,
    /// Open the serial line as a pseudo-terminal for tio or screen, and run on wall time until interrupted.
    #[arg(long, conflicts_with_all = ["json", "steps"])]
    pty: bool,
    /// Put the target where FILE says: a distance in millimetres, read again whenever it changes. To try calibrating without
    /// hardware: the command that moves such a stage is `echo {} > FILE`.
    #[arg(long, value_name = "FILE", requires = "pty")]
    stage: Option<PathBuf>,
    /// Give the sensor a geometry that only a calibration can find: millimetres to centimetres from the nominal one, 0.3 mm from any that
    /// eq. (1) describes, another one for each SEED. For white paper.
    #[arg(long, value_name = "SEED", requires = "pty", conflicts_with = "scene")]
    unknown_geometry: Option<u64>,
    /// Keep the sensor's flash in FILE, so that it has what it saved when the demo is started again, as after a power cycle.
    #[arg(long, value_name = "FILE", requires = "pty")]
    flash: Option<PathBuf>,
    /// Print the summary as one JSON object on standard output, and everything else on standard error.
    #[arg(long)]
    json: bool,
}

/// Where the table goes: standard error where standard output is for JSON.
fn say(json: bool, text: &str) {
    if json {
        eprintln!("{text}");
    } else {
        println!("{text}");
    }
}

fn main() -> Result<()> {
    let options = Options::parse();
    eprintln!("building the firmware ...");
    let firmware = Firmware::build()?;
    let summary = match &options.pgm {
        Some(path) => serde_json::to_value(photograph::show(&firmware, path, options.json)?),
        #[cfg(unix)]
        None if options.pty => return terminal::serve(&firmware, &options),
        #[cfg(not(unix))]
        None if options.pty => anyhow::bail!("--pty needs a system with pseudo-terminals"),
        None => serde_json::to_value(moving_target::measure(&firmware, &options)?),
    };
    if options.json {
        println!("{}", summary.context("writing the summary as JSON")?);
    }
    Ok(())
}
