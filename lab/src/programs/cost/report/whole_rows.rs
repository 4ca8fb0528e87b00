//! What whole rows take, as JSON, as tables to read and as CSV.

use cost_on_chip::methods::Method;
use cost_on_chip::whole_rows::{COMB, FRAME, WIDTH};
use serde::Serialize;
use slitrange::centre::Estimator;

use super::{Measured, microseconds, ratio};
use crate::programs::cost::chip::steps::Steps;
use crate::programs::cost::chip::whole_rows::{AtWidth, OnceAFrame, Slowest, WholeRows};
use crate::table::cells;

/// What rows take by one estimator, from their words to their centre with its check.
#[derive(Clone, Debug, Serialize)]
pub struct RowInstructions {
    /// Words of a row.
    words: usize,
    /// The spot's sigma in pixels.
    width_px: f32,
    /// A row that follows another of its frame.
    following: Row,
    /// The first row of a frame.
    first: Row,
    /// The slowest row that is known.
    slowest: Option<SlowestRow>,
    /// What comes in addition once a frame.
    once_a_frame: Once,
    /// Spots of other widths.
    widths: Vec<Widths>,
}

/// What the rows of a comb of 16 slits take, by the default estimator.
#[derive(Clone, Debug, Serialize)]
pub struct CombInstructions {
    /// A row that follows another of its frame.
    following: Row,
    /// The first row of a frame.
    first: Row,
    /// The row that completes a frame of 16.
    last: Row,
}

/// Instructions of a row.
#[derive(Clone, Debug, Serialize)]
struct Row {
    total: u64,
    /// The least, typical ones, and the most.
    microseconds_estimated: [f64; 3],
    steps: Steps,
}

impl From<&Steps> for Row {
    fn from(steps: &Steps) -> Self {
        Self {
            total: steps.total(),
            microseconds_estimated: microseconds(steps.total()).map(super::round),
            steps: *steps,
        }
    }
}

#[derive(Clone, Debug, Serialize)]
struct SlowestRow {
    /// What the row shows.
    shows: String,
    #[serde(flatten)]
    row: Row,
}

/// Instructions once a frame.
#[derive(Clone, Debug, Serialize)]
struct Once {
    /// The mean of the frame's rows, and how certain it is.
    mean: u64,
    /// The distance with its uncertainty.
    distance: u64,
}

#[derive(Clone, Debug, Serialize)]
struct Widths {
    width_px: f64,
    following: Row,
    first: Row,
}

impl WholeRows {
    /// An estimator's rows with a spot of a width.
    pub fn at_width(&self, estimator: Estimator, width: f64) -> Option<&AtWidth> {
        self.at_widths
            .iter()
            .find(|at| at.estimator == estimator && (at.width - width).abs() < 1e-6)
    }

    /// An estimator's rows with the spot of the nominal sensor.
    pub fn nominal(&self, estimator: Estimator) -> Option<&AtWidth> {
        self.at_width(estimator, WIDTH.into())
    }

    /// What an estimator takes once a frame.
    pub fn once_a_frame(&self, estimator: Estimator) -> Option<&OnceAFrame> {
        (self.once_a_frame.iter()).find(|once| once.estimator == estimator)
    }

    /// The slowest row of an estimator.
    pub fn slowest(&self, estimator: Estimator) -> Option<&Slowest> {
        (self.slowest.iter()).find(|slowest| slowest.estimator == estimator)
    }

    /// Instructions of the frame's mean: what the last row of a frame takes more than the others.
    pub fn mean(&self, estimator: Estimator) -> Option<u64> {
        let last = self.once_a_frame(estimator)?.last.frame;
        Some(last.saturating_sub(self.nominal(estimator)?.following.frame))
    }

    /// What the chip computes for a reading of so many rows, in milliseconds, typically.
    pub fn reading_milliseconds(&self, estimator: Estimator, rows: u64) -> Option<f64> {
        let (nominal, once) = (self.nominal(estimator)?, self.once_a_frame(estimator)?);
        let AtWidth {
            first, following, ..
        } = nominal;
        Some(of_reading(first, following, &once.last, once, rows))
    }

    /// The same for a comb, by the default estimator.
    pub fn comb_milliseconds(&self, rows: u64) -> Option<f64> {
        let (comb, once) = (self.comb?, self.once_a_frame(Estimator::default())?);
        Some(of_reading(
            &comb.first,
            &comb.following,
            &comb.last,
            once,
            rows,
        ))
    }

    /// What `--json` says of a comb.
    pub fn comb_json(&self) -> Option<CombInstructions> {
        let comb = self.comb?;
        Some(CombInstructions {
            following: (&comb.following).into(),
            first: (&comb.first).into(),
            last: (&comb.last).into(),
        })
    }

    /// What `--json` says of an estimator.
    pub fn json(&self, estimator: Estimator) -> Option<RowInstructions> {
        let nominal = self.nominal(estimator)?;
        let of_estimator = self.at_widths.iter().filter(|at| at.estimator == estimator);
        Some(RowInstructions {
            words: cost_on_chip::rows::WORDS,
            width_px: WIDTH,
            following: (&nominal.following).into(),
            first: (&nominal.first).into(),
            slowest: self.slowest(estimator).map(|slowest| SlowestRow {
                shows: slowest.name.clone(),
                row: (&slowest.row).into(),
            }),
            once_a_frame: Once {
                mean: self.mean(estimator)?,
                distance: self.once_a_frame(estimator)?.distance.total(),
            },
            widths: of_estimator
                .map(|at| Widths {
                    width_px: at.width,
                    following: (&at.following).into(),
                    first: (&at.first).into(),
                })
                .collect(),
        })
    }
}

/// The typical milliseconds of a reading. The mean was measured for a frame of the factory's settings. It goes
/// over all rows, so it grows with them.
fn of_reading(first: &Steps, following: &Steps, last: &Steps, once: &OnceAFrame, rows: u64) -> f64 {
    let [first, following, last] = [first, following, last].map(Steps::total);
    let mean = last.saturating_sub(following) * rows / u64::from(FRAME);
    let [_, typical, _] =
        microseconds(first + (rows - 1) * following + mean + once.distance.total());
    typical / 1e3
}

/// The kinds of rows. Each kind has its own figures.
const KINDS: [&str; 3] = ["following", "first", "slowest"];

impl WholeRows {
    /// An estimator's rows in the order of [`KINDS`].
    pub fn kinds(&self, estimator: Estimator) -> [Option<&Steps>; 3] {
        let nominal = self.nominal(estimator);
        [
            nominal.map(|at| &at.following),
            nominal.map(|at| &at.first),
            self.slowest(estimator).map(|slowest| &slowest.row),
        ]
    }

    /// Instructions that `adaptive` takes more than `phase-table` in a following row, and their share of that
    /// row.
    pub fn adaptive_over_phase_table(&self) -> Option<(i64, f64)> {
        let total = |estimator| Some(self.nominal(estimator)?.following.total());
        let (more, less) = (total(Estimator::Adaptive)?, total(Estimator::PhaseTable)?);
        let difference = more as i64 - less as i64;
        Some((difference, difference as f64 / less as f64))
    }
}

impl Measured {
    fn estimators(&self) -> impl Iterator<Item = Estimator> {
        self.methods.iter().filter_map(|method| method.estimator())
    }

    /// Instructions of a following row by a method. The repair takes the place of the default estimator, among
    /// its conversion, search and check.
    pub fn row_instructions(&self, method: Method, width: f64) -> Option<u64> {
        let at = |estimator| self.chip.whole_rows.at_width(estimator, width);
        if let Some(estimator) = method.estimator() {
            return Some(at(estimator)?.following.total());
        }
        let alone = self.on_chip(Method::default(), width)?.instructions;
        let rest = at(Estimator::default())?.following.total() - alone;
        Some(rest + self.on_chip(method, width)?.instructions)
    }

    /// Each estimator's error beside what its rows take.
    pub(super) fn rows_table(&self) -> Vec<Vec<String>> {
        let mut head = cells(&["estimator", "error / bound"]);
        head.extend(KINDS.map(|kind| format!("{kind} row")));
        let mut rows = vec![head];
        rows.extend(self.estimators().map(|estimator| {
            let worst = self.accuracy.worst(Method::Estimator(estimator));
            let mut row = vec![named(estimator), ratio(worst.white.max(worst.shot))];
            row.extend(
                (self.chip.whole_rows.kinds(estimator))
                    .map(|of_kind| of_kind.map_or("-".into(), |row| row.total().to_string())),
            );
            row
        }));
        rows
    }

    /// The steps of each estimator's rows.
    pub(super) fn steps_table(&self) -> Vec<Vec<String>> {
        let mut rows = vec![cells(&[
            "row", "convert", "search", "estimate", "check", "frame", "all",
        ])];
        for (i, kind) in KINDS.iter().enumerate() {
            for estimator in self.estimators() {
                let Some(row) = self.chip.whole_rows.kinds(estimator)[i] else {
                    continue;
                };
                rows.push(steps_line(format!("{kind}, {}", estimator.name()), row));
            }
        }
        if let Some(comb) = &self.chip.whole_rows.comb {
            for (kind, row) in [("following", &comb.following), ("first", &comb.first)] {
                rows.push(steps_line(format!("{kind}, comb of 16 slits"), row));
            }
        }
        rows
    }

    /// Rows with spots of other widths.
    pub(super) fn widths_table(&self) -> Vec<Vec<String>> {
        let widths = self.chip_widths();
        let mut head = vec!["row".to_owned()];
        head.extend(widths.iter().map(|width| format!("σ {width}")));
        let mut rows = vec![head];
        let kinds: [fn(&AtWidth) -> &Steps; 2] = [|at| &at.following, |at| &at.first];
        for (kind, row) in KINDS.iter().zip(kinds) {
            for estimator in self.estimators() {
                let mut line = vec![format!("{kind}, {}", estimator.name())];
                line.extend(widths.iter().map(|&width| {
                    let at = self.chip.whole_rows.at_width(estimator, width);
                    at.map_or("-".into(), |at| row(at).total().to_string())
                }));
                rows.push(line);
            }
        }
        rows
    }

    /// What comes once a frame, in a sentence.
    pub(super) fn once_a_frame_text(&self) -> String {
        let rows = &self.chip.whole_rows;
        let default = Estimator::default();
        let Some((mean, once)) = rows.mean(default).zip(rows.once_a_frame(default)) else {
            return String::new();
        };
        format!(
            "Once a frame of {FRAME} rows, the mean of its rows takes {mean} instructions more, and the \
             distance with its uncertainty {}.",
            once.distance.total()
        )
    }

    /// What time a following row takes, in sentences.
    pub(super) fn range_text(&self) -> String {
        let default = Estimator::default();
        let Some(nominal) = self.chip.whole_rows.nominal(default) else {
            return String::new();
        };
        let [least, _, most] = microseconds(nominal.following.total());
        let [fewest, _, most_cycles] = super::CYCLES;
        format!(
            "An instruction takes {fewest} to {most_cycles} cycles at 168 MHz. So a following row of `{}` \
             takes {least:.0} to {most:.0} us.",
            default.name(),
        )
    }

    /// How much slower `adaptive` is, in a sentence.
    pub(super) fn share_text(&self) -> String {
        let Some((instructions, share)) = self.chip.whole_rows.adaptive_over_phase_table() else {
            return String::new();
        };
        format!(
            "`adaptive` takes {instructions} instructions more than `phase-table`: {:.1} % of a following \
             row.",
            100.0 * share
        )
    }

    /// What the slowest row of the default estimator shows, in a sentence.
    pub(super) fn slowest_text(&self) -> String {
        let slowest = self.chip.whole_rows.slowest(Estimator::default());
        slowest.map_or(String::new(), |slowest| {
            format!(
                "The slowest row of the default estimator: {}.",
                slowest.name
            )
        })
    }

    /// The lines of `whole-rows.csv`.
    pub(super) fn row_records(&self) -> Vec<RowRecord> {
        let rows = &self.chip.whole_rows;
        let mut records = vec![];
        let mut add = |row: &'static str, name: &'static str, width, steps: &Steps| {
            records.push(RowRecord {
                row,
                estimator: name,
                width_px: width,
                convert: steps.convert,
                search: steps.search,
                estimate: steps.estimate,
                check: steps.check,
                frame: steps.frame,
                distance: steps.distance,
                other: steps.other,
                total: steps.total(),
            });
        };
        let nominal = Some(f64::from(WIDTH));
        for at in &rows.at_widths {
            let (name, width) = (at.estimator.name(), Some(at.width));
            add("following", name, width, &at.following);
            add("first", name, width, &at.first);
        }
        for slowest in &rows.slowest {
            add("slowest", slowest.estimator.name(), None, &slowest.row);
        }
        for once in &rows.once_a_frame {
            let name = once.estimator.name();
            add("last of a frame", name, nominal, &once.last);
            add("reading", name, nominal, &once.distance);
        }
        if let Some(comb) = &rows.comb {
            add("following", COMB, nominal, &comb.following);
            add("first", COMB, nominal, &comb.first);
            add("last of a frame", COMB, nominal, &comb.last);
        }
        records
    }
}

/// A row's name and its instructions by step.
fn steps_line(name: String, steps: &Steps) -> Vec<String> {
    let figures = [
        steps.convert,
        steps.search,
        steps.estimate,
        steps.check,
        steps.frame,
        steps.total(),
    ];
    let mut line = vec![name];
    line.extend(figures.map(|instructions| instructions.to_string()));
    line
}

/// The estimator's name, marked if it is the default.
fn named(estimator: Estimator) -> String {
    match estimator == Estimator::default() {
        true => format!("{} (default)", estimator.name()),
        false => estimator.name().to_owned(),
    }
}

/// A line of `whole-rows.csv`: instructions by step.
#[derive(Serialize)]
pub struct RowRecord {
    row: &'static str,
    estimator: &'static str,
    width_px: Option<f64>,
    convert: u64,
    search: u64,
    estimate: u64,
    check: u64,
    frame: u64,
    distance: u64,
    other: u64,
    total: u64,
}
