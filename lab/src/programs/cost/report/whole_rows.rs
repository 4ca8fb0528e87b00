//! What whole rows take, as tables to read and as JSON.

use cost_on_chip::methods::Method;
use cost_on_chip::whole_rows::{COMB, FRAME, WIDTH};
use slitrange::centre::Estimator;

use super::{CYCLES, Measured, microseconds, ratio};
use crate::programs::cost::chip::steps::{self, Steps};
use crate::programs::cost::chip::whole_rows::{
    FIRST, FOLLOWING, LAST, READING, SLOWEST, WholeRow, WholeRows,
};
use crate::table;

const KINDS: [&str; 3] = [FOLLOWING, FIRST, SLOWEST];

impl WholeRows {
    pub fn at_width(&self, kind: &str, name: &str, width: f64) -> Option<&Steps> {
        let is_it = |row: &&WholeRow| {
            let is_near = |of_row: f64| (of_row - width).abs() < 1e-6;
            row.kind == kind && row.name == name && row.width.is_none_or(is_near)
        };
        Some(&self.0.iter().find(is_it)?.steps)
    }

    /// The same with the spot of the nominal sensor.
    pub fn nominal(&self, kind: &str, name: &str) -> Option<&Steps> {
        self.at_width(kind, name, WIDTH.into())
    }

    pub fn kinds(&self, estimator: Estimator) -> [Option<&Steps>; 3] {
        KINDS.map(|kind| self.nominal(kind, estimator.name()))
    }

    /// Instructions of the default estimator once a frame: of the mean, which the last row takes more than
    /// the others, and of the reading.
    pub fn once_a_frame(&self) -> Option<[u64; 2]> {
        let [following, last, reading] =
            [FOLLOWING, LAST, READING].map(|kind| self.nominal(kind, Estimator::default().name()));
        let mean = last?.frame().saturating_sub(following?.frame());
        Some([mean, reading?.total()])
    }

    /// What the chip computes for a reading of so many rows by the estimator of a name, in milliseconds,
    /// typically. The mean was measured for a frame of the factory's settings. It goes over all rows, so it
    /// grows with them.
    pub fn reading_milliseconds(&self, name: &str, rows: u64) -> Option<f64> {
        let total = |kind, name| Some(self.nominal(kind, name)?.total());
        let estimator = match name {
            COMB => Estimator::default().name(),
            name => name,
        };
        let following = total(FOLLOWING, name)?;
        let mean = total(LAST, name)?.saturating_sub(following) * rows / u64::from(FRAME);
        let rows = total(FIRST, name)? + (rows - 1) * following;
        Some(microseconds(rows + mean + total(READING, estimator)?)[1] / 1e3)
    }
}

impl Measured {
    fn estimators(&self) -> impl Iterator<Item = Estimator> {
        self.methods.iter().filter_map(|method| method.estimator())
    }

    /// Instructions of a following row by a method. The repair takes the place of the default estimator,
    /// among its conversion, search and check.
    pub fn row_instructions(&self, method: Method, width: f64) -> Option<u64> {
        let rows = &self.chip.whole_rows;
        let following = |name| Some(rows.at_width(FOLLOWING, name, width)?.total());
        if let Some(estimator) = method.estimator() {
            return following(estimator.name());
        }
        let alone = self.chip.on_chip(Method::default(), width)?.instructions;
        let rest = following(Estimator::default().name())? - alone;
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
        rows.extend(KINDS.iter().filter_map(|kind| {
            let row = whole_rows.nominal(kind, COMB)?;
            Some((format!("{kind}, comb of 16 slits"), row))
        }));
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
        let mut rows = vec![];
        for kind in [FOLLOWING, FIRST] {
            rows.extend(self.estimators().map(|estimator| {
                let total = |&width: &f64| {
                    let row = self.chip.whole_rows.at_width(kind, estimator.name(), width);
                    row.map_or("-".into(), |row| row.total().to_string())
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
        let total = |of: Estimator| Some(rows.nominal(FOLLOWING, of.name())?.total());
        let [mean, reading] = rows.once_a_frame()?;
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
            "The slowest row of the default estimator: found by cargo slowest.".to_owned(),
            format!(
                "Once a frame of {FRAME} rows, the mean of its rows takes {mean} instructions more, and the \
                 distance with its uncertainty {reading}."
            ),
        ])
    }

    pub(super) fn rows_json(&self) -> Vec<serde_json::Value> {
        let json = |row: &WholeRow| {
            let (steps, total) = (steps::NAMES.into_iter().zip(row.steps.0), row.steps.total());
            serde_json::json!({
                "row": row.kind,
                "estimator": row.name,
                "width_px": row.width,
                "total": total,
                "microseconds_estimated": microseconds(total).map(super::round),
                "steps": steps.collect::<std::collections::BTreeMap<_, _>>(),
            })
        };
        self.chip.whole_rows.0.iter().map(json).collect()
    }
}
