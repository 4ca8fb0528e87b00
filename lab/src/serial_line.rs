//! `cargo serial-line`: the reference in docs/serial-line.md: commands, settings, estimators and faults, from
//! the core's own declarations. And a session, for that page and README.md.

use slitrange::base::exposure::Exposure;
use slitrange_device::protocol::advice::advice;
use slitrange_device::protocol::help::{self, purpose};
use slitrange_device::protocol::line::ResultLine;
use slitrange_device::settings::{Affects, Setting, Settings};
use std::fmt::Write as _;
use virtual_board::light::{Target, of_scene};

use crate::docs;
use crate::prelude::*;

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

/// What a person types in the session, and for how long she then waits, ms.
const TYPED: [(&str, u64); 11] = [
    ("stream off", 50),
    ("rows 64", 50),
    ("distance", 800),
    ("black fixed 5000", 50),
    ("uncertainty", 800),
    ("estimator centroid", 50),
    ("distance", 800),
    ("zero", 800),
    ("distance", 800),
    ("calibration off", 50),
    ("distance", 800),
];

/// The distance of its white paper, m.
const DISTANCE: f64 = 0.8;

/// Records the session on the virtual board. `> ` marks what the person types.
fn record_session() -> anyhow::Result<Vec<String>> {
    let light = of_scene(Scene::white_paper(), Target::at(DISTANCE));
    let mut board = VirtualBoard::power_on(&Firmware::build()?, light)?;
    let mut session = vec![];
    for first in ["slitrange ", "d "] {
        let line = board.run_until_line(|it| it.starts_with(first), Duration::from_secs(2))?;
        session.push(line.text);
    }
    board.take_lines();
    for (typed, wait_ms) in TYPED {
        session.push(format!("> {typed}"));
        board.send(&format!("{typed}\r\n"));
        board.run_for(Duration::from_millis(wait_ms))?;
        session.extend(board.take_lines().into_iter().map(|line| line.text));
    }
    board.finish()?;
    Ok(session)
}

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

fn code(lines: &[String]) -> String {
    lines.iter().map(|line| format!("    {line}\n")).collect()
}

/// Each file that has a block of the serial line: its name, its text, and the text that it should have.
fn found_and_expected() -> anyhow::Result<[(&'static str, String, String); 2]> {
    let session = record_session()?;
    let page = std::fs::read_to_string(docs::path(PAGE)).context(PAGE)?;
    let expected_page = docs::with_block(&page, REFERENCE_MARK, &reference())?;
    let expected_page = docs::with_block(&expected_page, SESSION_MARK, &code(&session))?;
    let readme = std::fs::read_to_string(docs::path(README)).context(README)?;
    let short = code(&session[..SHORT_SESSION]);
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
        let line = ResultLine {
            number: 0,
            us: 0,
            result: &Err(fault),
            is_difference: false,
            held: 0,
            settings: &Settings::default(),
        };
        row(&mut text, &[&line.to_string(), advice(&fault)]);
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
        // A row more or less before a command gives other digits.
        let without_numbers = |text: &str| text.replace(|it: char| it.is_ascii_digit(), "");
        for (name, found, expected) in found_and_expected().expect("the pages") {
            let [reference, due] =
                [&found, &expected].map(|text| text.split(SESSION_MARK).next().map(str::to_owned));
            assert!(
                reference == due && without_numbers(&found) == without_numbers(&expected),
                "{name} is not what the core declares: run `cargo serial-line --write`"
            );
        }
    }
}
