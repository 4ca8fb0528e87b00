//! What whole rows take, as tables to read, as JSON and as CSV.

use cost_on_chip::methods::Method;
use cost_on_chip::whole_rows::{COMB, FRAME, WIDTH};
use slitrange::centre::Estimator;

use super::{CYCLES, Measured, microseconds, ratio};
use crate::programs::cost::chip::steps::{self, Steps};
use crate::programs::cost::chip::whole_rows::{AtWidth, OnceAFrame, Slowest, WholeRows};
use crate::table;

/// The kinds of rows. Each kind has its own figures.
const KINDS: [&str; 3] = ["following", "first", "slowest"];

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

    pub fn once_a_frame(&self, estimator: Estimator) -> Option<&OnceAFrame> {
        (self.once_a_frame.iter()).find(|once| once.estimator == estimator)
    }

    fn slowest(&self, estimator: Estimator) -> Option<&Slowest> {
        (self.slowest.iter()).find(|slowest| slowest.estimator == estimator)
    }

    /// An estimator's rows in the order of [`KINDS`].
    pub fn kinds(&self, estimator: Estimator) -> [Option<&Steps>; 3] {
        let nominal = self.nominal(estimator);
        [
            nominal.map(|at| &at.following),
            nominal.map(|at| &at.first),
            self.slowest(estimator).map(|slowest| &slowest.row),
        ]
    }

    /// Instructions of the frame's mean: what the last row of a frame takes more than the others.
    pub fn mean(&self, estimator: Estimator) -> Option<u64> {
        let [last, following] = [
            &self.once_a_frame(estimator)?.last,
            &self.nominal(estimator)?.following,
        ];
        Some(last.frame().saturating_sub(following.frame()))
    }

    /// What the chip computes for a reading of so many rows, in milliseconds, typically.
    pub fn reading_milliseconds(&self, estimator: Estimator, rows: u64) -> Option<f64> {
        let (at, once) = (self.nominal(estimator)?, self.once_a_frame(estimator)?);
        Some(of_reading(
            [&at.first, &at.following, &once.last],
            once,
            rows,
        ))
    }

    /// The same for a comb, by the default estimator.
    pub fn comb_milliseconds(&self, rows: u64) -> Option<f64> {
        let (comb, once) = (self.comb?, self.once_a_frame(Estimator::default())?);
        Some(of_reading(
            [&comb.first, &comb.following, &comb.last],
            once,
            rows,
        ))
    }
}

/// The typical milliseconds of a reading. The mean was measured for a frame of the factory's settings. It
/// goes over all rows, so it grows with them.
fn of_reading(steps: [&Steps; 3], once: &OnceAFrame, rows: u64) -> f64 {
    let [first, following, last] = steps.map(Steps::total);
    let mean = last.saturating_sub(following) * rows / u64::from(FRAME);
    let all = first + (rows - 1) * following + mean + once.distance.total();
    microseconds(all)[1] / 1e3
}

impl Measured {
    fn estimators(&self) -> impl Iterator<Item = Estimator> {
        self.methods.iter().filter_map(|method| method.estimator())
    }

    /// Instructions of a following row by a method. The repair takes the place of the default estimator,
    /// among its conversion, search and check.
    pub fn row_instructions(&self, method: Method, width: f64) -> Option<u64> {
        let at = |estimator| self.chip.whole_rows.at_width(estimator, width);
        if let Some(estimator) = method.estimator() {
            return Some(at(estimator)?.following.total());
        }
        let alone = self.chip.on_chip(Method::default(), width)?.instructions;
        let rest = at(Estimator::default())?.following.total() - alone;
        Some(rest + self.chip.on_chip(method, width)?.instructions)
    }

    /// Each estimator's error beside what its rows take.
    pub(super) fn rows_table(&self) -> String {
        let rows = self.estimators().map(|estimator| {
            let worst = self.accuracy.worst(Method::Estimator(estimator));
            let mark = match estimator == Estimator::default() {
                true => " (default)",
                false => "",
            };
            let mut row = vec![
                format!("{}{mark}", estimator.name()),
                ratio(worst.white.max(worst.shot)),
            ];
            let kinds = self.chip.whole_rows.kinds(estimator);
            row.extend(kinds.map(|it| it.map_or("-".into(), |row| row.total().to_string())));
            row
        });
        let head = KINDS.map(|kind| format!("{kind} row")).join(" | ");
        table::of(&format!("estimator | error / bound | {head}"), rows)
    }

    pub(super) fn steps_table(&self) -> String {
        let whole_rows = &self.chip.whole_rows;
        let mut rows = vec![];
        for (i, kind) in KINDS.iter().enumerate() {
            rows.extend(self.estimators().filter_map(|estimator| {
                let row = whole_rows.kinds(estimator)[i]?;
                Some((format!("{kind}, {}", estimator.name()), row))
            }));
        }
        if let Some(comb) = &whole_rows.comb {
            for (kind, row) in KINDS.iter().zip([&comb.following, &comb.first]) {
                rows.push((format!("{kind}, comb of 16 slits"), row));
            }
        }
        let head = "row | convert | search | estimate | check | frame | all";
        let rows = rows.into_iter().map(|(name, steps)| {
            let figures = steps.0[..5].iter().copied().chain([steps.total()]);
            let figures = figures.map(|instructions| instructions.to_string());
            [name].into_iter().chain(figures).collect()
        });
        table::of(head, rows)
    }

    pub(super) fn widths_table(&self) -> String {
        let widths = self.chip_widths();
        let kinds: [fn(&AtWidth) -> &Steps; 2] = [|at| &at.following, |at| &at.first];
        let mut rows = vec![];
        for (kind, row) in KINDS.iter().zip(kinds) {
            rows.extend(self.estimators().map(|estimator| {
                let total = |&width: &f64| {
                    let at = self.chip.whole_rows.at_width(estimator, width);
                    at.map_or("-".into(), |at| row(at).total().to_string())
                };
                let name = format!("{kind}, {}", estimator.name());
                [name].into_iter().chain(widths.iter().map(total)).collect()
            }));
        }
        let head: String = widths.iter().map(|width| format!(" | σ {width}")).collect();
        table::of(&format!("row{head}"), rows)
    }

    /// What time a following row takes; how much slower `adaptive` is; what the slowest row of the default
    /// estimator shows; what comes once a frame.
    pub(super) fn sentences(&self) -> Option<[String; 4]> {
        let rows = &self.chip.whole_rows;
        let default = Estimator::default();
        let total = |estimator| Some(rows.nominal(estimator)?.following.total());
        let [least, _, most] = microseconds(total(default)?);
        let [fewest, _, most_cycles] = CYCLES;
        let (adaptive, table) = (total(Estimator::Adaptive)?, total(Estimator::PhaseTable)?);
        let more = adaptive as i64 - table as i64;
        Some([
            format!(
                "An instruction takes {fewest} to {most_cycles} cycles at 168 MHz: a following row by `{}` \
                 takes {least:.0} to {most:.0} us.",
                default.name(),
            ),
            format!(
                "That is {:.1} % more than by `phase-table`.",
                100.0 * more as f64 / table as f64
            ),
            format!(
                "The slowest row of the default estimator: {}.",
                rows.slowest(default)?.name
            ),
            format!(
                "Once a frame of {FRAME} rows, the mean of its rows takes {} instructions more, and the \
                 distance with its uncertainty {}.",
                rows.mean(default)?,
                rows.once_a_frame(default)?.distance.total()
            ),
        ])
    }

    /// All rows: what each is, the estimator, the spot's width if it is known, and the instructions.
    pub(super) fn rows(&self) -> Vec<(&'static str, &'static str, Option<f64>, &Steps)> {
        let rows = &self.chip.whole_rows;
        let mut all = vec![];
        let nominal = Some(f64::from(WIDTH));
        for at in &rows.at_widths {
            let (name, width) = (at.estimator.name(), Some(at.width));
            all.push(("following", name, width, &at.following));
            all.push(("first", name, width, &at.first));
        }
        for slowest in &rows.slowest {
            all.push(("slowest", slowest.estimator.name(), None, &slowest.row));
        }
        for once in &rows.once_a_frame {
            let name = once.estimator.name();
            all.push(("last of a frame", name, nominal, &once.last));
            all.push(("reading", name, nominal, &once.distance));
        }
        if let Some(comb) = &rows.comb {
            all.push(("following", COMB, nominal, &comb.following));
            all.push(("first", COMB, nominal, &comb.first));
            all.push(("last of a frame", COMB, nominal, &comb.last));
        }
        all
    }

    /// What `--json` says of [`Self::rows`].
    pub(super) fn rows_json(&self) -> Vec<serde_json::Value> {
        let rows = self.rows().into_iter();
        let json = |(row, estimator, width, steps): (_, _, _, &Steps)| {
            let of_steps = steps::NAMES.into_iter().zip(steps.0);
            serde_json::json!({
                "row": row,
                "estimator": estimator,
                "width_px": width,
                "total": steps.total(),
                "microseconds_estimated": microseconds(steps.total()).map(super::round),
                "steps": of_steps.collect::<std::collections::BTreeMap<_, _>>(),
            })
        };
        rows.map(|row: (&str, &str, Option<f64>, &Steps)| json(row))
            .collect()
    }
}
