//! `slitrange calibrate fit`: from a file of points to a record, a report and a figure.

pub mod report;

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context as _, ensure};
use calibration::fit::comb;
use calibration::fit::solve::{Form, solve};
use calibration::points::{self, Points, Setup};
use calibration::record::{self, form};
use slitrange::{BlackLevel, Estimator};
use slitrange_device::record::date::Date;
use slitrange_device::record::encoded::EncodedRecord;

use crate::{record_file, whole_file};
use report::Report;

/// Of `slitrange calibrate fit`.
#[derive(clap::Args)]
pub struct Options {
    /// The points: a CSV file with the columns x_px, d_mm and, if there, sigma_px, height_counts, the spot's
    /// shape, and the images of a comb's slits
    points: PathBuf,
    /// What the calibration is made of
    #[arg(long, value_enum, default_value = "auto")]
    form: Wanted,
    /// Standard uncertainty of each distance: 0.02 of a good stage, 0.3 of a ruler
    #[arg(long, value_name = "MM", value_parser = positive)]
    position_uncertainty: Option<f64>,
    /// Write the record here [default: the points' name with .record]
    #[arg(short, long, value_name = "FILE", value_parser = whole_file::output)]
    output: Option<PathBuf>,
    /// Replace the record's file even if something else is in it
    #[arg(long)]
    force: bool,
    /// The sensor's serial number [default: that of the points, or 0]
    #[arg(long, value_name = "N")]
    serial: Option<u32>,
    /// The day of the calibration [default: today]
    #[arg(long, value_name = "YYYY-MM-DD", value_parser = date)]
    date: Option<Date>,
    /// How the centres were found [default: as the points say, or adaptive]
    #[arg(long, value_name = "NAME", value_parser = points::estimator)]
    estimator: Option<Estimator>,
    /// How the black level was found: shielded, frame, or "fixed N" [default: as the points say, or shielded]
    #[arg(long, value_name = "HOW", value_parser = black_level)]
    black: Option<BlackLevel>,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
    /// Draw points, fit and residuals as an SVG file
    #[arg(long, value_name = "FILE", value_parser = whole_file::output)]
    figure: Option<PathBuf>,
}

/// The form that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Wanted {
    /// Eq. (1), unless residuals show a departure that a correction clearly takes away
    Auto,
    /// Eq. (1) alone
    Eq1,
    /// Eq. (1) with a table of smoothed residuals
    Corrected,
    /// A table of smoothed distances, for a sensor that eq. (1) does not fit
    Table,
}

impl Wanted {
    fn form(self) -> Option<Form> {
        match self {
            Self::Auto => None,
            Self::Eq1 => Some(Form::Eq1),
            Self::Corrected => Some(Form::Corrected),
            Self::Table => Some(Form::Table),
        }
    }
}

/// `slitrange calibrate fit`.
///
/// # Errors
/// No calibration fits the points, or a file cannot be read or written. The error names the line of the file
/// and the reason.
pub fn run(options: &Options, output: &mut dyn Write) -> anyhow::Result<()> {
    let Points { points, setup } = Points::read(&options.points)?;
    let file = options.points.display().to_string();
    let position = options.position_uncertainty.map(|mm| 1e-3 * mm);
    let comb = comb::fit(&points).with_context(|| file.clone())?;
    let points = comb.as_ref().map_or(&points, |comb| &comb.points);
    let solved = solve(points, position).with_context(|| file.clone())?;
    let made = form::make(&solved, options.form.form()).with_context(|| file.clone())?;
    let mut report = Report::of(file, &solved, &made, comb.as_ref());
    // Options win over the points.
    let setup = Setup {
        serial_number: options.serial.or(setup.serial_number),
        estimator: options.estimator.or(setup.estimator),
        black_level: options.black.or(setup.black_level),
        ..setup
    };
    if setup.estimator.is_none() {
        report.assumes_estimator();
    }
    let date = options.date.map_or_else(today, Ok)?;
    let record = EncodedRecord::new(record::of(&setup, date, &solved, &made, comb.as_ref()))?;
    let beside = || options.points.with_extension("record");
    let path = options.output.clone().unwrap_or_else(beside);
    ensure!(
        path != options.points,
        "{}: the record would take the place of the points: name another file with --output",
        path.display()
    );
    record_file::write(&path, &record, options.force)?;
    report.add_record(&path, &record);
    if let Some(path) = &options.figure {
        figures::fit::draw(&solved, made.form, comb.as_ref(), path)
            .with_context(|| format!("{} cannot be drawn", path.display()))?;
    }
    let text = match options.json {
        true => serde_json::to_string_pretty(&report)? + "\n",
        false => report.to_string(),
    };
    output.write_all(text.as_bytes())?;
    Ok(())
}

/// By the computer's clock, in UTC.
fn today() -> anyhow::Result<Date> {
    let today = time::OffsetDateTime::now_utc().date();
    u16::try_from(today.year())
        .ok()
        .and_then(|year| Date::new(year, today.month().into(), today.day()))
        .context("the computer's clock has no date that a record can hold: give --date")
}

fn date(text: &str) -> Result<Date, String> {
    let day = || {
        let [year, month, day] = text.split('-').collect::<Vec<_>>().try_into().ok()?;
        Date::new(year.parse().ok()?, month.parse().ok()?, day.parse().ok()?)
    };
    day().ok_or_else(|| "there is no such day: write it as 2026-01-31".into())
}

fn black_level(words: &str) -> Result<BlackLevel, String> {
    let words: Vec<&str> = words.split_whitespace().collect();
    points::black_level(&words).map_err(|error| error.to_string())
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let number = number.filter(|number| (1e-6..1e6).contains(number));
    number.ok_or_else(|| "it must be a number of millimetres above 0".into())
}
