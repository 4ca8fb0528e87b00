//! The reference in docs/serial-line.md: commands, settings, estimators and faults, from the core's own
//! declarations.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use slitrange::centre::Estimator;
use slitrange::fault::Fault;
use slitrange::protocol::help::{AFTER_SETTINGS, BEFORE_SETTINGS, purpose};
use slitrange::settings::{Affects, Setting, Settings};
use slitrange::units::{Counts, Pixels};

use crate::docs;

/// The name of the program that writes the page.
const TOOL: &str = "cargo serial-line";

/// The page.
pub fn page() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/serial-line.md")
}

/// The page as it is, and as it should be.
///
/// # Errors
/// There is no such page, or it has no place for the reference.
pub fn found_and_expected() -> anyhow::Result<(String, String)> {
    let page = page();
    let found = std::fs::read_to_string(&page).with_context(|| page.display().to_string())?;
    let expected = docs::with_block(&found, TOOL, &reference())?;
    Ok((found, expected))
}

/// The reference as Markdown.
pub fn reference() -> String {
    let mut text = String::from("| command | |\n|---|---|\n");
    for (typed, help) in BEFORE_SETTINGS.iter().chain(&AFTER_SETTINGS) {
        row(&mut text, &[typed, help]);
    }
    text.push_str("\n| setting | values | default | | saved |\n|---|---|---|---|---|\n");
    for &setting in Setting::ALL {
        let default = Settings::default().get(setting).to_string();
        let default = default.split_once(' ').map_or("", |(_, value)| value);
        let saved = match setting.affects() {
            Affects::Measurement => "yes",
            Affects::Session => "no",
        };
        let form = setting.form().to_string();
        row(
            &mut text,
            &[setting.name(), &form, default, setting.help(), saved],
        );
    }
    text.push_str("\n| estimator | letter | |\n|---|---|---|\n");
    for estimator in Estimator::ALL {
        let letter = estimator.letter().to_string();
        row(&mut text, &[estimator.name(), &letter, purpose(estimator)]);
    }
    text.push_str("\n| fault, for instance | what to do |\n|---|---|\n");
    for fault in faults() {
        row(&mut text, &[&fault.to_string(), fault.advice()]);
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

/// One fault of each kind.
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
    fn the_page_is_up_to_date() {
        let (found, expected) = found_and_expected().expect("the page");
        assert!(
            found == expected,
            "run `{TOOL}`: docs/serial-line.md is not what the core declares"
        );
    }
}
