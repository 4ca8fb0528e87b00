//! The cycles of a real board beside their estimates.

use std::fmt::{self, Write as _};

use anyhow::Result;

use super::cycles::{Model, Range};
use super::lines::{Kind, Line};
use super::program::Program;
use super::run::Run;
use super::whole_rows::with_calls;
use super::{forms, methods, steps};

/// What the emulated chip says about a line of the program.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The line of the emulated chip, whose cycles are instructions.
    line: Line,
    range: Range,
}

/// An estimate for each method at each width, for each form of a calibration, for whole rows and for
/// readings.
pub fn estimates(run: &Run) -> Result<Vec<Estimate>> {
    let program = Program::of(&run.firmware)?;
    let model = Model::of(&program);
    let mut estimates = vec![];
    let (methods, forms) = (
        methods(run, &program, &model)?,
        forms(run, &program, &model)?,
    );
    for line in &run.lines {
        let range = match line.kind {
            Kind::Method => methods
                .iter()
                .find(|method| {
                    method.name == line.name && line.number("width").ok() == Some(method.width)
                })
                .map(|method| method.cycles),
            Kind::Form => forms
                .iter()
                .find(|form| form.name == line.name)
                .map(|form| form.cycles),
            _ => None,
        };
        if let Some(range) = range {
            estimates.push(Estimate {
                line: line.clone(),
                range,
            });
        }
    }
    for (kind, function) in [
        (Kind::WholeRow, steps::ROW),
        (Kind::Reading, steps::READING),
    ] {
        for (line, call) in with_calls(run, &program, kind, function)? {
            // Rows of one kind take about the same: one of each is enough.
            if line
                .values
                .get("number")
                .is_none_or(|&number| number == 0.0)
            {
                estimates.push(Estimate {
                    line: line.clone(),
                    range: model.range(&call.path),
                });
            }
        }
    }
    Ok(estimates)
}

/// The board's figures beside their estimates.
pub struct Table {
    estimates: Vec<Estimate>,
    /// A line of the board, and its estimate.
    rows: Vec<(Line, Estimate)>,
}

impl Table {
    /// No figure yet.
    pub fn new(estimates: Vec<Estimate>) -> Self {
        Self {
            estimates,
            rows: vec![],
        }
    }

    /// Takes a line of the log. `probe-rs` may put a time or a level before the program's line, and prints
    /// lines of its own.
    pub fn take(&mut self, line: &str) {
        let Some(line) = parse(line) else {
            return;
        };
        let estimate = self.estimates.iter().find(|estimate| {
            let of = &estimate.line;
            (of.kind, &of.name) == (line.kind, &line.name)
                && ["width", "number", "place"]
                    .iter()
                    .all(|&key| of.values.get(key) == line.values.get(key))
        });
        if let Some(estimate) = estimate {
            let estimate = estimate.clone();
            self.rows.push((line, estimate));
        }
    }
}

/// The program's line, from the word on that names its kind.
fn parse(line: &str) -> Option<Line> {
    ["method ", "form ", "whole-row ", "reading "]
        .into_iter()
        .find_map(|kind| {
            let from = line.find(kind)?;
            Line::parse(line[from..].trim_end()).ok()
        })
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "\n{:<36} {:>8} {:>13} {:>8} {:>8} {:>8}  within",
            "on the board", "cycles", "instructions", "low", "likely", "high"
        )?;
        for (line, Estimate { line: of, range }) in &self.rows {
            let cycles = line.number("cycles").unwrap_or(f64::NAN);
            let mut name = match line.kind {
                Kind::WholeRow => format!("row, {}", line.name),
                Kind::Reading => format!("reading, {}", line.name),
                _ => line.name.clone(),
            };
            for (key, said) in [("width", "sigma"), ("place", "row")] {
                if let Some(value) = line.values.get(key) {
                    let _ = write!(name, ", {said} {value}");
                }
            }
            let Range { low, likely, high } = range;
            let is_within = (*low as f64..=*high as f64).contains(&cycles);
            writeln!(
                f,
                "{name:<36} {cycles:>8} {:>13} {low:>8} {likely:>8} {high:>8}  {}",
                of.number("cycles").unwrap_or(f64::NAN),
                if is_within { "yes" } else { "NO" }
            )?;
        }
        writeln!(
            f,
            "\n{} figures of the board have an estimate. low, likely and high are estimated cycles with the \
             waits for flash.",
            self.rows.len()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(line: &str, low: u64, likely: u64, high: u64) -> Estimate {
        Estimate {
            line: Line::parse(line).expect("a line"),
            range: Range { low, likely, high },
        }
    }

    /// A log as probe-rs prints it: lines of its own, lines with a level, and lines without an estimate.
    #[test]
    fn the_board_s_cycles_are_beside_their_estimates() {
        let method = "method phase-table width 10.5 cycles 378 most 381 stack 184";
        let mut table = Table::new(vec![
            estimate(method, 500, 640, 1200),
            estimate(
                "method phase-table width 25 cycles 1063 most 1063 stack 184",
                1,
                2,
                3,
            ),
            estimate("form eq1 cycles 60 most 61 stack 64", 80, 100, 190),
            estimate(
                "whole-row adaptive width 10.5 number 0 place 2 cycles 14000",
                1,
                2,
                3,
            ),
            estimate("reading adaptive cycles 350", 300, 500, 900),
        ]);
        for line in [
            "      Erasing 100% [####################]  96.00 KiB @  48.00 KiB/s (took 2s)",
            "0.012345 INFO  method phase-table width 10.5 cycles 655 most 701 stack 184",
            "\u{2514}\u{2500} cost_on_chip::chip::methods::measure @ on-chip/cost/src/chip/methods.rs:36",
            "step geometry-row items 3694 cycles 30000 most 30001 stack 40",
            "form eq1 cycles 191 most 200 stack 64\r",
            "form unknown cycles 191 most 200 stack 64",
            "whole-row adaptive width 10.5 number 0 place 1 cycles 60000",
            "whole-row adaptive width 10.5 number 0 place 2 cycles 20000",
            "whole-row adaptive width 10.5 number 1 place 2 cycles 20000",
            "reading adaptive cycles 400",
            "end",
        ] {
            table.take(line);
        }
        let text = table.to_string();
        println!("{text}");
        let rows: Vec<Vec<&str>> = text
            .lines()
            .map(|line| line.split_whitespace().collect())
            .collect();
        assert_eq!(
            rows[2],
            [
                "phase-table,",
                "sigma",
                "10.5",
                "655",
                "378",
                "500",
                "640",
                "1200",
                "yes"
            ]
        );
        assert_eq!(rows[3], ["eq1", "191", "60", "80", "100", "190", "NO"]);
        let name = "row, adaptive, sigma 10.5, row 2";
        assert!(
            text.contains(&format!("\n{name:<36}    20000         14000")),
            "{text}"
        );
        assert!(text.contains("\nreading, adaptive "), "{text}");
        assert!(text.contains("\n4 figures of the board"), "{text}");
    }
}
