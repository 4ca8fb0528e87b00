//! `slitrange`: see `slitrange --help`.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use slitrange_cli::{fit, sensor};

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
    /// Take the points: centres from the sensor at distances that a person or a stage sets
    Run(sensor::RunOptions),
    /// Write a record to the sensor
    Write(sensor::WriteOptions),
    /// Read the sensor's record into a file
    Read(sensor::ReadOptions),
    /// Show what a sensor or a file holds, or how the two differ
    Show(sensor::ShowOptions),
}

fn main() -> ExitCode {
    let Command::Calibrate(command) = Command::parse();
    let outcome = match command {
        Calibrate::Fit(options) => fit::run(&options),
        Calibrate::Run(options) => sensor::run(&options),
        Calibrate::Write(options) => sensor::write(&options),
        Calibrate::Read(options) => sensor::read(&options),
        Calibrate::Show(options) => sensor::show(&options),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("slitrange: {error:#}");
            ExitCode::FAILURE
        }
    }
}
