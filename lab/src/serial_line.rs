//! `cargo serial-line`: the reference in docs/serial-line.md: commands, settings, estimators and faults, from
//! the core's own declarations. And a session, for that page and README.md.

use anyhow::Context as _;
use clap::Args;
use slitrange::base::exposure::Exposure;
use slitrange::base::fault::Fault;
use slitrange::base::units::{Counts, Micrometres, Pixels};
use slitrange::centre::Estimator;
use slitrange_device::protocol::advice::advice;
use slitrange_device::protocol::help::{self, purpose};
use slitrange_device::protocol::line::FaultLine;
use slitrange_device::settings::{Affects, Setting, Settings};
use std::fmt::Write as _;

use crate::docs;

/// Prints the reference of commands, settings, estimators and faults, and a session.
#[derive(Args)]
pub struct Options {
    /// Rewrite the reference in docs/serial-line.md, and the session there and in README.md
    #[arg(long)]
    write: bool,
}

const PAGE: &str = "docs/serial-line.md";
const README: &str = "README.md";

/// The marks of the reference and of the session.
const REFERENCE_MARK: &str = "cargo serial-line";
const SESSION_MARK: &str = "cargo serial-line, a session";

/// A session on the virtual board. `> ` marks what a person types.
const SESSION: [&str; 31] = [
    "slitrange 0.1.0 NUCLEO-F429ZI TCD1304DG, started by power-on",
    "d 800.0009 mm u 17.13 r 0.0016 x 1770.9767 a 1992 n 16/16 g",
    "> stream off",
    "stream off",
    "> rows 64",
    "rows 64",
    "> distance",
    "d 800.0003 mm u 17.13 r 0.0008 x 1770.9782 a 1994 n 64/64 g",
    "> black fixed 5000",
    "E3 out of range, expected black fixed 0..4095|shielded|frame",
    "> uncertainty",
    "d 800.0003 mm u 17.13 r 0.0008 x 1770.9782 a 1994 n 64/64 g",
    "uncertainty noise 0.0008 mm",
    "uncertainty pixels 0.0161 mm",
    "uncertainty calibration 0.0000 mm",
    "uncertainty surface 0.3339 mm",
    "uncertainty geometry 17.1266 mm",
    "uncertainty motion 0.0000 mm",
    "> estimator adaptive",
    "estimator adaptive",
    "> distance",
    "d 799.9993 mm u 17.13 r 0.0008 x 1770.9808 a 1950 n 64/64 g",
    "> zero",
    "d 799.9996 mm u 17.13 r 0.0008 x 1770.9801 a 1950 n 64/64 g",
    "> distance",
    "z 0.0010 mm u 0.0017 r 0.0011 x 1770.9776 a 1950 n 64/64 g",
    "> calibration off",
    "calibration off",
    "> distance",
    "f not calibrated: x 1770.97815 u 0.00197",
    "(send `calibration on`; without a calibration, upload one, or send `defaults` (TCD1304DG only))",
];

/// The first lines of the session, which README.md shows.
const SHORT_SESSION: usize = 8;

pub fn main(options: &Options) -> anyhow::Result<()> {
    if !options.write {
        print!("{}", reference());
        docs::print_hint("cargo serial-line", "docs/serial-line.md and README.md");
        return Ok(());
    }
    for (name, _, expected) in found_and_expected()? {
        std::fs::write(docs::path(name), expected).context(name)?;
    }
    Ok(())
}

fn code(lines: &[&str]) -> String {
    lines.iter().map(|line| format!("    {line}\n")).collect()
}

/// Each file that has a block of the serial line: its name, its text, and the text that it should have.
fn found_and_expected() -> anyhow::Result<[(&'static str, String, String); 2]> {
    let page = std::fs::read_to_string(docs::path(PAGE)).context(PAGE)?;
    let expected_page = docs::with_block(&page, REFERENCE_MARK, &reference())?;
    let expected_page = docs::with_block(&expected_page, SESSION_MARK, &code(&SESSION))?;
    let readme = std::fs::read_to_string(docs::path(README)).context(README)?;
    let short = code(&SESSION[..SHORT_SESSION]);
    let expected_readme = docs::with_block(&readme, SESSION_MARK, &short)?;
    Ok([
        (PAGE, page, expected_page),
        (README, readme, expected_readme),
    ])
}

pub fn reference() -> String {
    let mut text = String::from("| command | what it does |\n|---|---|\n");
    for (typed, help) in help::commands() {
        row(&mut text, &[typed, help]);
    }
    text.push_str(
        "\n| setting | values | default | what it sets | saved |\n|---|---|---|---|---|\n",
    );
    for &setting in Setting::ALL {
        let default = Settings::default().get(setting).to_string();
        let default = default.strip_prefix(setting.name());
        let default = default.unwrap_or_default().trim();
        let saved = match setting.affects() {
            Affects::Session if setting == Setting::Format => "`modbus` only",
            Affects::Measurement | Affects::Lines | Affects::Connection => "yes",
            Affects::Session => "no",
        };
        let (name, form) = (setting.name(), setting.form().to_string());
        row(&mut text, &[name, &form, default, setting.help(), saved]);
    }
    text.push_str("\n| estimator | letter | what it is for |\n|---|---|---|\n");
    for estimator in Estimator::ALL {
        let letter = estimator.letter().to_string();
        row(&mut text, &[estimator.name(), &letter, purpose(estimator)]);
    }
    text.push_str("\n| fault, an example | what to do |\n|---|---|\n");
    for fault in faults() {
        row(&mut text, &[&FaultLine(&fault).to_string(), advice(&fault)]);
    }
    text
}

/// Adds a row of a table. The first cell is what a person types or reads.
fn row(text: &mut String, cells: &[&str]) {
    for (i, cell) in cells.iter().enumerate() {
        // A bar would end the cell.
        let cell = cell.replace('|', "\\|");
        // Writing to a String cannot fail.
        let _ = match i {
            0 => write!(text, "| `{cell}` "),
            _ => write!(text, "| {cell} "),
        };
    }
    text.push_str("|\n");
}

fn faults() -> [Fault; Fault::KINDS] {
    let (centre, other) = (Pixels::from_f32(1770.98), Pixels::from_f32(1203.5));
    [
        Fault::SensorSilent,
        Fault::NoSpot {
            amplitude: Counts::from_f32(9.5),
        },
        Fault::TooDim {
            amplitude: Counts::from_f32(35.2),
            needed: Counts::from_f32(60.1),
        },
        Fault::Saturated { pixels: 12 },
        Fault::SpotAtEdge { centre },
        Fault::TwoSpots { centre, other },
        Fault::Unsteady {
            scatter: Pixels::from_f32(4.25),
        },
        Fault::OutOfRange { centre },
        Fault::NotCalibrated {
            centre,
            uncertainty: Pixels::from_f32(0.002),
        },
        Fault::FewSlits {
            found: 3,
            needed: 4,
        },
        Fault::SlitsUnclear {
            images: 6,
            other: 5,
        },
        Fault::DimAtLongest {
            amplitude: Counts::from_f32(35.2),
            exposure: Exposure::LONGEST,
        },
        Fault::SaturatedAtShortest {
            pixels: 12,
            exposure: Exposure::SHORTEST,
        },
        Fault::LaserOff,
        Fault::Spike {
            step: Micrometres::from_int(1234),
        },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_one_fault_of_each_kind() {
        for (kind, fault) in faults().iter().enumerate() {
            assert_eq!(fault.kind(), kind);
        }
    }

    #[test]
    fn the_pages_are_up_to_date() {
        for (name, found, expected) in found_and_expected().expect("the pages") {
            assert!(
                found == expected,
                "{name} is not what the core declares: run `cargo serial-line --write`"
            );
        }
    }
}
