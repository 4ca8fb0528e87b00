//! The catalogue's table, and the rates of confident errors, as text.

use crate::hard_cases::calibrations::{CalibrationCase, CalibrationDue, Found, calibrations};
use crate::hard_cases::frames::{FRAMES, FrameCase, frames};
use crate::hard_cases::judge::{Outcome, Said};
use crate::hard_cases::mixtures::Kind;
use crate::hard_cases::tally::Tally;
use crate::hard_cases::{Due, ROWS, RowCase, rows};
use rayon::prelude::*;
use slitrange::{Estimator, Fault};
use statistics::rms;
use std::fmt::Write as _;

/// The mark in docs/hard-cases.md before the catalogue's tables.
pub const CATALOGUE: &str = "cargo hard-cases, the catalogue";
/// The mark before the random rows' rates.
pub const RANDOM_ROWS: &str = "cargo hard-cases, random rows";

/// What came of the whole catalogue.
pub struct Catalogue {
    /// Rows, with each estimator's outcome in the order of [`Estimator::ALL`].
    pub rows: Vec<(RowCase, Vec<Outcome>)>,
    /// Frames, likewise.
    pub frames: Vec<(FrameCase, Vec<Outcome>)>,
    /// Calibrations, with which no estimator has to do.
    pub calibrations: Vec<(CalibrationCase, Found)>,
}

impl Catalogue {
    /// Runs it.
    pub fn run() -> Self {
        let (rows, frames) = (rows().into_par_iter(), frames().into_par_iter());
        Self {
            rows: rows.map(|case| (case.clone(), case.run())).collect(),
            frames: frames.map(|case| (case, case.run())).collect(),
            calibrations: (calibrations().into_iter())
                .map(|case| (case.clone(), case.run()))
                .collect(),
        }
    }

    /// Number of cases.
    pub fn count(&self) -> usize {
        self.rows.len() + self.frames.len() + self.calibrations.len()
    }

    /// The names of the cases of which something else came than was due with an estimator, each with what
    /// came. A calibration that fails does so with every estimator.
    pub fn failures(&self, estimator: Estimator) -> Vec<String> {
        let rows = self.rows.iter().map(|(case, all)| (&*case.name, all));
        let frames = self.frames.iter().map(|(case, all)| (case.name, all));
        let of_estimators = rows.chain(frames).flat_map(|(case, outcomes)| {
            let outcomes = outcomes.iter().filter(move |it| it.estimator == estimator);
            outcomes.filter_map(move |it| Some((case, it.failure.as_deref()?)))
        });
        let calibrations = (self.calibrations.iter())
            .filter(|(_, found)| !found.is_due)
            .map(|(case, found)| (case.name, &*found.answer));
        let failures = of_estimators.chain(calibrations);
        let failures = failures.map(|(case, what)| format!("{case}: {what}"));
        failures.collect()
    }

    /// The tables of docs/hard-cases.md.
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        let (total, rows, frames) = (self.count(), self.rows.len(), self.frames.len());
        let others = self.calibrations.len();
        text += &format!(
            "{total} cases: {rows} of rows ({ROWS} rows each), {frames} of frames ({FRAMES} frames each), \
             {others} of calibrations.\n\n"
        );
        text += "| estimator | letter | cases that failed |\n|---|---|---:|\n";
        for estimator in Estimator::ALL {
            let (name, letter) = (estimator.name(), estimator.letter());
            let failed = self.failures(estimator).len();
            _ = writeln!(text, "| {name} | {letter} | {failed} |");
        }
        for group in self.rows.chunk_by(|(a, _), (b, _)| a.group == b.group) {
            _ = writeln!(text, "\n### {}\n\n{}", group[0].0.group, head());
            for (case, outcomes) in group {
                let mut due = words(case.due);
                if let Some(within) = case.repair_within {
                    _ = write!(due, "; repair within {within:.2}");
                }
                text += &line(&case.name, case.why, &due, outcomes);
            }
        }
        _ = writeln!(text, "\n### Frames\n\n{}", head());
        for (case, outcomes) in &self.frames {
            text += &line(case.name, case.why, &words(case.due), outcomes);
        }
        text += "\n### Calibrations\n\n| case | why it is hard | expected | result |\n|---|---|---|---|\n";
        for (case, found) in &self.calibrations {
            let due = match case.due {
                CalibrationDue::Refused(_) => "refused".into(),
                CalibrationDue::Exact(within) => format!("within {within} um"),
            };
            let answer = emphasised(&found.answer, !found.is_due);
            _ = writeln!(text, "| {} | {} | {due} | {answer} |", case.name, case.why);
        }
        text
    }
}

/// The head of a table of estimators, without the end of its last line.
fn head() -> String {
    let letters = Estimator::ALL.map(|estimator| format!(" {} |", estimator.letter()));
    let rules = Estimator::ALL.map(|_| "---|");
    let (letters, rules) = (letters.concat(), rules.concat());
    format!("| case | why it is hard | expected |{letters}\n|---|---|---|{rules}")
}

fn line(name: &str, why: &str, due: &str, outcomes: &[Outcome]) -> String {
    let cells: Vec<String> = outcomes.iter().map(cell).collect();
    format!("| {name} | {why} | {due} | {} |\n", cells.join(" | "))
}

/// What is due, in a word or two.
fn words(due: Due) -> String {
    match due {
        Due::Centre(within) => format!("within {within:.2}"),
        Due::Honest => "honest".into(),
        Due::Unknowable => "shown".into(),
        Due::NoCentre => "no centre".into(),
        Due::Fault(names) => names.join(" or "),
    }
}

/// What an estimator says of a case: the RMS error of centres without a flag, how many have one, and faults.
fn cell(Outcome { said, failure, .. }: &Outcome) -> String {
    let mut parts = vec![];
    let errors: Vec<f64> = said.iter().filter_map(Said::unflagged).collect();
    if !errors.is_empty() {
        parts.push(match rms(&errors) {
            error if error.is_infinite() => "wrong".into(),
            error if error < 1.0 => format!("{error:.3}"),
            error => format!("{error:.1}"),
        });
    }
    let count = |name: &str, count: usize| match count {
        0 => None,
        count if count == said.len() => Some(name.to_owned()),
        count => Some(format!("{name} {count}")),
    };
    let flagged = said.iter().filter(|said| said.is_flagged());
    parts.extend(count("flag", flagged.count()));
    for (kind, name) in FAULTS.into_iter().enumerate() {
        let of_kind = |said: &&Said| matches!(said, Said::Fault(fault) if fault.kind() == kind);
        parts.extend(count(name, said.iter().filter(of_kind).count()));
    }
    emphasised(&parts.join(", "), failure.is_some())
}

fn emphasised(text: &str, is: bool) -> String {
    let stars = if is { "**" } else { "" };
    format!("{stars}{text}{stars}")
}

/// Short names of the kinds of fault, in their order.
const FAULTS: [&str; Fault::KINDS] = [
    "silent", "none", "dim", "sat", "edge", "two", "unst", "range", "uncal", "few", "mixed",
    "long", "short", "off", "spike",
];

/// The random rows' rates, as docs/hard-cases.md shows them.
pub fn random_rows_markdown(clean: &Tally, mixtures: &Tally) -> String {
    let mut text = format!(
        "On a PC: {} clean rows, and {} rows with one to three flaws. *errors*: confident errors in a \
         million rows. *unchecked*: confident errors in a million rows if the check is left out. *flagged*, \
         *flagged though good* and *fault*: per cent of the rows.\n\n\
         | estimator | clean: errors | clean: unchecked | clean: flagged | clean: fault | flawed: errors | \
         flawed: unchecked | flawed: flagged | flawed: flagged though good | flawed: fault |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        clean.rows, mixtures.rows
    );
    for (i, estimator) in Estimator::ALL.iter().enumerate() {
        let of = |all: f64, tally: &Tally, count: u64| all * count as f64 / tally.rows as f64;
        let errors = |tally, count| format!("{:.1}", of(1e6, tally, count));
        let share = |tally, count| format!("{:.2}", of(1e2, tally, count));
        let (c, m) = (&clean.checked[i], &mixtures.checked[i]);
        let cells = [
            estimator.name().into(),
            errors(clean, c.confident_errors),
            errors(clean, clean.alone[i].confident_errors),
            share(clean, c.flagged),
            share(clean, c.faults),
            errors(mixtures, m.confident_errors),
            errors(mixtures, mixtures.alone[i].confident_errors),
            share(mixtures, m.flagged),
            share(mixtures, m.flagged_good),
            share(mixtures, m.faults),
        ];
        _ = writeln!(text, "| {} |", cells.join(" | "));
    }
    text += "\nConfident errors of the default estimator in a million rows that have this flaw. A row with \
             two flaws counts for both.\n\n\
             | flaw | rows | errors | unchecked |\n|---|---:|---:|---:|\n";
    let mut kinds = Kind::ALL.to_vec();
    kinds.sort_by_key(|(kind, _)| std::cmp::Reverse(mixtures.kinds[*kind as usize].checked));
    for (kind, name) in kinds {
        let of_kind = &mixtures.kinds[kind as usize];
        let rate = |errors: u64| 1e6 * errors as f64 / of_kind.rows.max(1) as f64;
        let (rows, checked, alone) = (of_kind.rows, rate(of_kind.checked), rate(of_kind.alone));
        _ = writeln!(text, "| {name} | {rows} | {checked:.0} | {alone:.0} |");
    }
    text
}
