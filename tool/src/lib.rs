//! What the owner of a sensor does on a PC: look at its rows, prepare its sensor head, and calibrate it.
//!
//! ```text
//! stage, sensor -> points -> fit -> record -> sensor
//!  (sensor::run)        (fit)  (record_file)  (sensor::transfer)
//! ```
//!
//! The fits themselves are the crate [`calibration`], and how figures look is the crate [`figures`].
//!
//! Distances are in millimetres where a person reads or writes them, in metres in computations.
#![forbid(unsafe_code)]

pub mod demo;
pub mod design;
pub mod fit;
pub mod keyboard;
pub mod pc;
pub mod photon_transfer;
pub mod plot;
pub mod record_file;
pub mod recording;
pub mod replay;
pub mod screen;
pub mod sensor;
mod whole_file;

use std::io::{BufRead, Write};
use std::process::ExitCode;

/// What the owner of a slitrange sensor does on a PC
#[derive(clap::Parser)]
#[command(name = "slitrange", version)]
pub enum Command {
    /// From known distances to a calibration in the sensor's flash
    #[command(subcommand)]
    Calibrate(Calibrate),
    /// What belongs to the sensor head
    #[command(subcommand)]
    Head(Head),
    // The help of each is that of its options.
    #[expect(missing_docs)]
    Demo(demo::DemoOptions),
    #[expect(missing_docs)]
    Design(design::DesignOptions),
    #[expect(missing_docs)]
    Monitor(sensor::MonitorOptions),
    #[expect(missing_docs)]
    Settings(sensor::SettingsOptions),
    #[expect(missing_docs)]
    Plot(plot::PlotOptions),
    #[expect(missing_docs)]
    Scope(sensor::ScopeOptions),
    #[expect(missing_docs)]
    Row(sensor::RowOptions),
    #[expect(missing_docs)]
    Record(sensor::RecordOptions),
    #[expect(missing_docs)]
    Replay(replay::ReplayOptions),
}

/// The commands of `slitrange head`.
// Each command's help is that of its options.
#[expect(missing_docs)]
#[derive(clap::Subcommand)]
pub enum Head {
    Flat(sensor::FlatOptions),
    Measure(sensor::MeasureOptions),
}

/// The commands of `slitrange calibrate`.
// Each command's help is that of its options.
#[expect(missing_docs)]
#[derive(clap::Subcommand)]
pub enum Calibrate {
    /// Fit a calibration to points that were taken, report on it and write it as a record
    Fit(fit::Options),
    Run(sensor::RunOptions),
    Write(sensor::WriteOptions),
    Read(sensor::ReadOptions),
    Show(sensor::ShowOptions),
}

impl Command {
    /// Does what the command says. `input` is what a person types.
    ///
    /// # Errors
    /// In sentences, for a person.
    pub fn run(
        &self,
        pc: &dyn pc::Pc,
        input: &mut dyn BufRead,
        output: &mut dyn Write,
    ) -> anyhow::Result<ExitCode> {
        let command = match self {
            Self::Calibrate(command) => command,
            Self::Demo(options) => {
                demo::demo(options, pc, output)?;
                return Ok(ExitCode::SUCCESS);
            }
            Self::Design(options) => {
                design::design(options, output)?;
                return Ok(ExitCode::SUCCESS);
            }
            Self::Monitor(options) => {
                sensor::monitor(options, pc, output)?;
                return Ok(ExitCode::SUCCESS);
            }
            Self::Settings(options) => return sensor::settings(options, pc, output),
            Self::Plot(options) => {
                plot::plot(options, output)?;
                return Ok(ExitCode::SUCCESS);
            }
            Self::Scope(options) => {
                sensor::scope(options, pc, output)?;
                return Ok(ExitCode::SUCCESS);
            }
            Self::Row(options) => {
                sensor::row(options, pc, output)?;
                return Ok(ExitCode::SUCCESS);
            }
            Self::Record(options) => {
                sensor::record(options, pc, output)?;
                return Ok(ExitCode::SUCCESS);
            }
            Self::Replay(options) => return replay::replay(options, output),
            Self::Head(Head::Flat(options)) => {
                sensor::flat(options, pc, input, output)?;
                return Ok(ExitCode::SUCCESS);
            }
            Self::Head(Head::Measure(options)) => {
                sensor::measure(options, pc, output)?;
                return Ok(ExitCode::SUCCESS);
            }
        };
        match command {
            Calibrate::Fit(options) => fit::run(options, output)?,
            Calibrate::Run(options) => sensor::run(options, pc, input, output)?,
            Calibrate::Write(options) => sensor::write(options, pc, output)?,
            Calibrate::Read(options) => sensor::read(options, pc, output)?,
            Calibrate::Show(options) => return sensor::show(options, pc, output),
        }
        Ok(ExitCode::SUCCESS)
    }
}
