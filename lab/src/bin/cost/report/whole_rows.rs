//! What whole rows take, as JSON, as tables to read and as CSV.

use cost_on_chip::whole_rows::WIDTH;
use serde::Serialize;
use slitrange::centre::Estimator;

use super::CLOCK_MHZ;
use crate::chip::steps::Steps;
use crate::chip::whole_rows::{AtWidth, OnceAFrame, Slowest, WholeRow, WholeRows};

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

/// Instructions of a row.
#[derive(Clone, Debug, Serialize)]
struct Row {
    total: u64,
    cycles_estimated: u64,
    microseconds_estimated: f64,
    steps: Steps,
}

impl From<&WholeRow> for Row {
    fn from(row: &WholeRow) -> Self {
        Self {
            total: row.steps.total(),
            cycles_estimated: row.cycles_estimated,
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
    row.cycles_estimated as f64 / CLOCK_MHZ
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
