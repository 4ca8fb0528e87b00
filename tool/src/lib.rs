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

// A module uses those before it (host-tests/tests/floors.rs). rustfmt sorts each group.
pub mod design;
pub mod keyboard;
pub mod photon_transfer;
pub mod recording;
pub mod screen;
mod whole_file;

pub mod pc;
pub mod record_file;
pub mod replay;
pub mod sensor;

pub mod demo;
pub mod fit;
pub mod plot;

use std::ffi::OsString;
use std::io::{BufRead, Write};
use std::process::ExitCode;

use clap::Parser as _;
use clap::error::{ContextKind, ContextValue};

/// What the owner of a slitrange sensor does on a PC
// The help of a command is that of its options.
#[expect(missing_docs)]
#[derive(clap::Parser)]
#[command(name = "slitrange", version)]
pub enum Command {
    /// From known distances to a calibration in the sensor's flash
    #[command(subcommand)]
    Calibrate(Calibrate),
    /// What belongs to the sensor head
    #[command(subcommand)]
    Head(Head),
    Demo(demo::DemoOptions),
    Design(design::DesignOptions),
    Doctor(sensor::DoctorOptions),
    Monitor(sensor::MonitorOptions),
    Settings(sensor::SettingsOptions),
    Plot(plot::PlotOptions),
    Scope(sensor::ScopeOptions),
    Row(sensor::RowOptions),
    Record(sensor::RecordOptions),
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
    /// Reads the arguments of the program, its name first.
    ///
    /// # Errors
    /// What clap says. To a number with a decimal comma it adds how to write it.
    pub fn read<S: Into<OsString> + Clone>(
        arguments: impl IntoIterator<Item = S>,
    ) -> Result<Self, clap::Error> {
        Self::try_parse_from(arguments).map_err(|mut error| {
            if let Some(ContextValue::String(value)) = error.get(ContextKind::InvalidValue) {
                let number = value.replacen(',', ".", 1);
                if number != *value && number.parse::<f64>().is_ok() {
                    let tip = format!("decimals follow a point: {number}");
                    let tip = ContextValue::StyledStrs(vec![tip.into()]);
                    error.insert(ContextKind::Suggested, tip);
                }
            }
            error
        })
    }

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
        match self {
            Self::Calibrate(Calibrate::Show(options)) => return sensor::show(options, pc, output),
            Self::Settings(options) => return sensor::settings(options, pc, output),
            Self::Doctor(options) => return sensor::doctor(options, pc, output),
            Self::Replay(options) => return replay::replay(options, output),
            Self::Calibrate(Calibrate::Fit(options)) => fit::run(options, output)?,
            Self::Calibrate(Calibrate::Run(options)) => sensor::run(options, pc, input, output)?,
            Self::Calibrate(Calibrate::Write(options)) => sensor::write(options, pc, output)?,
            Self::Calibrate(Calibrate::Read(options)) => sensor::read(options, pc, output)?,
            Self::Demo(options) => demo::demo(options, pc, output)?,
            Self::Design(options) => design::design(options, output)?,
            Self::Monitor(options) => sensor::monitor(options, pc, output)?,
            Self::Plot(options) => plot::plot(options, output)?,
            Self::Scope(options) => sensor::scope(options, pc, output)?,
            Self::Row(options) => sensor::row(options, pc, output)?,
            Self::Record(options) => sensor::record(options, pc, output)?,
            Self::Head(Head::Flat(options)) => sensor::flat(options, pc, input, output)?,
            Self::Head(Head::Measure(options)) => sensor::measure(options, pc, output)?,
        }
        Ok(ExitCode::SUCCESS)
    }
}
