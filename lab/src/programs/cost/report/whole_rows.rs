//! What whole rows take, as JSON, as tables to read and as CSV.

use cost_on_chip::methods::Method;
use cost_on_chip::whole_rows::{COMB, FRAME, WIDTH};
use serde::Serialize;
use slitrange::centre::Estimator;

use super::{CLOCK_MHZ, Measured, ratio};
use crate::programs::cost::chip::cycles::Range;
use crate::programs::cost::chip::steps::Steps;
use crate::programs::cost::chip::whole_rows::{AtWidth, OnceAFrame, Slowest, WholeRow, WholeRows};
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
    /// The likely ones of `cycles`.
    cycles_estimated: u64,
    microseconds_estimated: f64,
    cycles: Range,
    steps: Steps,
}

impl From<&WholeRow> for Row {
    fn from(row: &WholeRow) -> Self {
        Self {
            total: row.steps.total(),
            cycles_estimated: row.cycles.likely,
            cycles: row.cycles,
            microseconds_estimated: super::round(microseconds(row)),
            steps: row.steps,
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

/// Estimated microseconds of a row.
pub fn microseconds(row: &WholeRow) -> f64 {
    row.cycles.likely as f64 / CLOCK_MHZ
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
        let last = self.once_a_frame(estimator)?.last.steps.frame;
        Some(last.saturating_sub(self.nominal(estimator)?.following.steps.frame))
    }

    /// What the chip computes for a reading of so many rows, in milliseconds.
    pub fn reading_milliseconds(&self, estimator: Estimator, rows: u64) -> Option<f64> {
        let (nominal, once) = (self.nominal(estimator)?, self.once_a_frame(estimator)?);
        // Measured for a frame of the factory's settings. It goes over all rows, so it grows with them.
        let mean = microseconds(&once.last) - microseconds(&nominal.following);
        let mean = mean * rows as f64 / f64::from(FRAME);
        let rows =
            microseconds(&nominal.first) + (rows - 1) as f64 * microseconds(&nominal.following);
        Some((rows + mean + microseconds(&once.distance)) / 1e3)
    }

    /// The same for a comb, by the default estimator.
    pub fn comb_milliseconds(&self, rows: u64) -> Option<f64> {
        let (comb, once) = (self.comb?, self.once_a_frame(Estimator::default())?);
        let mean = microseconds(&comb.last) - microseconds(&comb.following);
        let rows = microseconds(&comb.first)
            + (rows - 1) as f64 * microseconds(&comb.following)
            + mean * rows as f64 / f64::from(FRAME);
        Some((rows + microseconds(&once.distance)) / 1e3)
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
                distance: self.once_a_frame(estimator)?.distance.steps.total(),
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

/// The kinds of rows. Each kind has its own figures.
const KINDS: [&str; 3] = ["following", "first", "slowest"];

impl WholeRows {
    /// An estimator's rows in the order of [`KINDS`].
    pub fn kinds(&self, estimator: Estimator) -> [Option<&WholeRow>; 3] {
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
        let total = |estimator| Some(self.nominal(estimator)?.following.steps.total());
        let (more, less) = (total(Estimator::Adaptive)?, total(Estimator::PhaseTable)?);
        let difference = more as i64 - less as i64;
        Some((difference, difference as f64 / less as f64))
    }
}

impl Measured {
    fn estimators(&self) -> impl Iterator<Item = Estimator> {
        self.methods.iter().filter_map(|method| method.estimator())
    }

    /// Estimated microseconds of a following row by a method. A method that is not in the firmware takes the
    /// place of the default estimator, among its conversion, search and check.
    pub fn row_microseconds(&self, method: Method, width: f64) -> Option<f64> {
        if let Some(estimator) = method.estimator() {
            let at = self.chip.whole_rows.at_width(estimator, width)?;
            return Some(microseconds(&at.following));
        }
        let default = self.chip.whole_rows.at_width(Estimator::default(), width)?;
        let alone = self.microseconds(Method::default(), width)?;
        Some(microseconds(&default.following) - alone + self.microseconds(method, width)?)
    }

    /// Each estimator's error beside what its rows take.
    pub(super) fn rows_table(&self) -> Vec<Vec<String>> {
        let mut head = cells(&["estimator", "error / bound"]);
        for kind in KINDS {
            head.extend([format!("{kind} row"), "us".into()]);
        }
        let mut rows = vec![head];
        rows.extend(self.estimators().map(|estimator| {
            let worst = self.accuracy.worst(Method::Estimator(estimator));
            let mut row = vec![named(estimator), ratio(worst.white.max(worst.shot))];
            for of_kind in self.chip.whole_rows.kinds(estimator) {
                row.push(of_kind.map_or("-".into(), |row| row.steps.total().to_string()));
                row.push(of_kind.map_or("-".into(), |row| format!("{:.0}", microseconds(row))));
            }
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
        let kinds: [fn(&AtWidth) -> &WholeRow; 2] = [|at| &at.following, |at| &at.first];
        for (kind, row) in KINDS.iter().zip(kinds) {
            for estimator in self.estimators() {
                let mut line = vec![format!("{kind}, {}", estimator.name())];
                line.extend(widths.iter().map(|&width| {
                    let at = self.chip.whole_rows.at_width(estimator, width);
                    at.map_or("-".into(), |at| row(at).steps.total().to_string())
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
            once.distance.steps.total()
        )
    }

    /// How well the time of a following row is known, in a sentence.
    pub(super) fn range_text(&self) -> String {
        let default = Estimator::default();
        let Some(nominal) = self.chip.whole_rows.nominal(default) else {
            return String::new();
        };
        let microseconds = |cycles: u64| cycles as f64 / CLOCK_MHZ;
        let Range { low, likely, high } = nominal.following.cycles;
        format!(
            "The microseconds are estimates: a following row of `{}` takes {:.0} us, at least {:.0} and at \
             most {:.0} us.",
            default.name(),
            microseconds(likely),
            microseconds(low),
            microseconds(high),
        )
    }

    /// The time of a following row, and how much slower `adaptive` is, in one sentence.
    pub(super) fn readme_text(&self) -> String {
        let rows = &self.chip.whole_rows;
        let nominal = rows.nominal(Estimator::Adaptive);
        let Some((nominal, (_, share))) = nominal.zip(rows.adaptive_over_phase_table()) else {
            return String::new();
        };
        let Range { low, high, .. } = nominal.following.cycles;
        format!(
            "A following row by `adaptive` takes {:.0} to {:.0} us, and {:.1} % more instructions than by \
             `phase-table`.",
            low as f64 / CLOCK_MHZ,
            high as f64 / CLOCK_MHZ,
            100.0 * share
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
        let mut add = |row: &'static str, name: &'static str, width, whole: &WholeRow| {
            let steps = whole.steps;
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
                cycles_low: whole.cycles.low,
                cycles_likely: whole.cycles.likely,
                cycles_high: whole.cycles.high,
                microseconds: super::round(microseconds(whole)),
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
fn steps_line(name: String, row: &WholeRow) -> Vec<String> {
    let steps = row.steps;
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
    cycles_low: u64,
    cycles_likely: u64,
    cycles_high: u64,
    microseconds: f64,
}
