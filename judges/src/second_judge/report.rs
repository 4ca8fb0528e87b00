//! What the second judge found, as text.

use crate::second_judge::Kind;
use crate::second_judge::tally::{JUDGED, KindReport, Report, Tally};
use std::fmt::Write as _;

/// The mark in docs/hard-cases.md before the table.
pub const SECOND_JUDGE: &str = "cargo hard-cases, the second judge";

/// Per cent, with as many digits as matter.
fn per_cent(share: f64) -> String {
    match 100.0 * share {
        0.0 => "0".into(),
        share if share < 9.95 => format!("{share:.2}"),
        share => format!("{share:.0}"),
    }
}

fn pixels(error: f64) -> String {
    match error {
        0.0 => "-".into(),
        error if error.is_infinite() => "false".into(),
        error => format!("{error:.2}"),
    }
}

impl Report {
    /// The share of confident errors in all frames, with one of [`JUDGED`].
    pub fn frames_in_error(&self, judged: usize) -> f64 {
        let tallies = self.kinds.iter().map(|kind| &kind.frames[judged]);
        let errors: u64 = tallies.clone().map(|tally| tally.errors).sum();
        errors as f64 / tallies.map(|tally| tally.count).sum::<u64>().max(1) as f64
    }

    /// A table of all kinds.
    pub fn markdown(&self) -> String {
        let (rows, frames) =
            (self.kinds.first()).map_or((0, 0), |kind| (kind.rows[0].count, kind.frames[0].count));
        let mut text = format!(
            "{rows} rows and {frames} frames of each kind. Per cent of rows or frames; *largest* in pixels. \
             *errors*: confident errors with the default estimator; *t*: with `phase-table`; *n*: with the \
             default estimator on a sensor that was never calibrated. *good flagged*: flagged although the \
             error is as claimed.\n\n\
             | fault | rows: fault | flagged | good flagged | errors | t | n | largest | \
             frames: fault | flagged | good flagged | errors | t | n | largest |\n\
             |---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n"
        );
        for report in &self.kinds {
            let cells = [cells(&report.rows), cells(&report.frames)].concat();
            _ = writeln!(text, "| {} | {} |", report.kind.name, cells.join(" | "));
        }
        let [all, never] = [0, 2].map(|judged| per_cent(self.frames_in_error(judged)));
        let of_never = format!("of a sensor that was never calibrated: {never} %.");
        _ = writeln!(
            text,
            "\nConfident errors in all frames: {all} %; {of_never}"
        );
        text
    }
}

/// A table of what the kinds are.
pub fn kinds_markdown() -> String {
    let mut text = String::from("| fault | what it is |\n|---|---|\n");
    for kind in Kind::all() {
        _ = writeln!(text, "| {} | {} |", kind.name, kind.what);
    }
    text
}

fn cells(tallies: &[Tally; JUDGED.len()]) -> Vec<String> {
    let [default, phase_table, never_calibrated] = tallies;
    vec![
        per_cent(default.share(default.faults)),
        per_cent(default.share(default.flagged)),
        per_cent(default.share(default.flagged_good)),
        per_cent(default.share(default.errors)),
        per_cent(phase_table.share(phase_table.errors)),
        per_cent(never_calibrated.share(never_calibrated.errors)),
        pixels(default.largest),
    ]
}

impl KindReport {
    /// Errors over claims in a line, to check the generator.
    pub fn claims(&self) -> String {
        let [rows, frames] = [&self.rows[0], &self.frames[0]].map(Tally::error_over_claim);
        format!("{}: rows {rows:.3}, frames {frames:.3}", self.kind.name)
    }
}
