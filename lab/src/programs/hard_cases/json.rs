//! What `--json` prints.

use judges::hard_cases::report::Catalogue;
use judges::hard_cases::tally::Tally;
use judges::second_judge::tally::{self, JUDGED};
use judges::second_judge::{KindReport, Report};
use serde::Serialize;
use slitrange::centre::Estimator;

#[derive(Serialize)]
pub struct Json {
    cases: usize,
    estimators: Vec<JsonEstimator>,
    /// What the second judge found, whose rows have no part in the figures above.
    second_judge: JsonReport,
}

#[derive(Serialize)]
struct JsonEstimator {
    name: &'static str,
    /// Cases of which something else came than was due. A calibration that fails does so with every
    /// estimator.
    failed_cases: usize,
    /// In the random rows with flaws, as the measurement takes the estimator.
    confident_errors: u64,
    random_rows: u64,
    /// The same of the estimator alone.
    confident_errors_alone: u64,
    clean_confident_errors: u64,
    clean_flagged: u64,
    clean_rows: u64,
}

#[derive(Serialize)]
struct JsonReport {
    /// Confident errors in all frames with the default estimator, as a share.
    frames_in_error: f64,
    kinds: Vec<JsonKind>,
}

#[derive(Serialize)]
struct JsonKind {
    name: &'static str,
    sensors: Vec<JsonSensor>,
}

#[derive(Serialize)]
struct JsonSensor {
    estimator: &'static str,
    is_calibrated: bool,
    rows: JsonTally,
    frames: JsonTally,
}

#[derive(Serialize)]
struct JsonTally {
    count: u64,
    faults: u64,
    flagged: u64,
    flagged_good: u64,
    confident_errors: u64,
    /// In pixels. None where there is no confident error, or where a centre came without a spot.
    largest_error: Option<f64>,
}

impl Json {
    pub fn of(catalogue: &Catalogue, clean: &Tally, mixtures: &Tally, second: &Report) -> Self {
        let json = |(i, estimator): (usize, Estimator)| JsonEstimator {
            name: estimator.name(),
            failed_cases: catalogue.failures(estimator).len(),
            confident_errors: mixtures.checked[i].confident_errors,
            random_rows: mixtures.rows,
            confident_errors_alone: mixtures.alone[i].confident_errors,
            clean_confident_errors: clean.checked[i].confident_errors,
            clean_flagged: clean.checked[i].flagged,
            clean_rows: clean.rows,
        };
        Self {
            cases: catalogue.len(),
            estimators: Estimator::ALL.into_iter().enumerate().map(json).collect(),
            second_judge: JsonReport {
                frames_in_error: second.frames_in_error(0),
                kinds: second.kinds.iter().map(JsonKind::of).collect(),
            },
        }
    }
}

impl JsonKind {
    fn of(report: &KindReport) -> Self {
        let sensors = JUDGED.into_iter().enumerate();
        let sensors = sensors.map(|(i, judged)| JsonSensor {
            estimator: judged.estimator.name(),
            is_calibrated: judged.is_calibrated,
            rows: JsonTally::of(&report.rows[i]),
            frames: JsonTally::of(&report.frames[i]),
        });
        Self {
            name: report.kind.name,
            sensors: sensors.collect(),
        }
    }
}

impl JsonTally {
    fn of(tally: &tally::Tally) -> Self {
        Self {
            count: tally.count,
            faults: tally.faults,
            flagged: tally.flagged,
            flagged_good: tally.flagged_good,
            confident_errors: tally.errors,
            largest_error: (tally.errors > 0 && tally.largest.is_finite()).then_some(tally.largest),
        }
    }
}
