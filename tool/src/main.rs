//! `slitrange`: see `slitrange --help`.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use slitrange_tool::{fit, sensor};

/// The exit code of whatever went wrong: 1 says that two records differ, as with `cmp`.
const FAILED: u8 = 2;

/// What the owner of a slitrange sensor does on a PC
#[derive(Parser)]
#[command(name = "slitrange", version)]
enum Command {
    /// From known distances to a calibration in the sensor's flash
    #[command(subcommand)]
    Calibrate(Calibrate),
}

#[derive(Subcommand)]
enum Calibrate {
    /// Fit a calibration to points that were taken, report on it and write it as a record
    Fit(fit::Options),
    Run(sensor::RunOptions),
    Write(sensor::WriteOptions),
    Read(sensor::ReadOptions),
    Show(sensor::ShowOptions),
}

fn main() -> ExitCode {
    let Command::Calibrate(command) = Command::parse();
    let outcome = match command {
        Calibrate::Fit(options) => fit::run(&options).map(|()| ExitCode::SUCCESS),
        Calibrate::Run(options) => sensor::run(&options).map(|()| ExitCode::SUCCESS),
        Calibrate::Write(options) => sensor::write(&options).map(|()| ExitCode::SUCCESS),
        Calibrate::Read(options) => sensor::read(&options).map(|()| ExitCode::SUCCESS),
        Calibrate::Show(options) => sensor::show(&options),
    };
    match outcome {
        Ok(code) => code,
        Err(error) => {
            eprintln!("slitrange: {error:#}");
            ExitCode::from(FAILED)
        }
    }
}
