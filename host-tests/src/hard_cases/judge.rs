//! Every rung's answers to a case, and whether they are what is due.

use slitrange::estimator::{self, Estimator, RowCentre, second_look};
use slitrange::reading::Fault;
use slitrange::row::Row;
use slitrange::spot;

use crate::hard_cases::truth::is_confident_error;
use crate::hard_cases::{Due, HardRow, ROWS, RowCase, Truth};

/// What comes of a row.
pub type Answer = Result<RowCentre, Fault>;

/// A rung's answers to a row.
#[derive(Clone, Copy, Debug)]
pub struct Answers {
    /// Of the rung alone ([`estimator::centre`]).
    pub alone: Answer,
    /// As the measurement takes it ([`second_look::centre`]).
    pub looked_at: Answer,
}

/// Every rung's answers to a row, in the order of [`Estimator::ALL`].
///
/// # Panics
/// The row has a word of more than 12 bits.
pub fn answers(row: &HardRow) -> [Answers; Estimator::ALL.len()] {
    let parts = Row::new(&row.light, &[], row.geometry.full_scale()).expect("12 bits");
    let spot = spot::find(&parts);
    Estimator::ALL.map(|rung| Answers {
        alone: spot.and_then(|spot| estimator::centre(rung, &parts, &spot, None, &row.geometry)),
        looked_at: spot
            .and_then(|spot| second_look::centre(rung, &parts, &spot, None, &row.geometry)),
    })
}

/// The rungs that follow the spot's shape. The others (centroid, parabolas, box) make errors of their own, which they claim.
pub const CAREFUL: [Estimator; 5] = [
    Estimator::PhaseTable,
    Estimator::Adaptive,
    Estimator::Robust,
    Estimator::GaussNewton,
    Estimator::Fraunhofer,
];

/// What came of a case for a rung.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The rung.
    pub rung: Estimator,
    /// The measurement's answers, and the truths.
    pub answers: Vec<(Truth, Answer)>,
    /// The rung's own.
    pub alone: Vec<(Truth, Answer)>,
    /// What is not as it must be, in words.
    pub failure: Option<String>,
}

impl RowCase {
    /// Runs every rung over its rows.
    pub fn run(&self) -> Vec<Outcome> {
        let rows: Vec<HardRow> = (0..ROWS).map(|number| self.row(number)).collect();
        let answers: Vec<_> = rows.iter().map(answers).collect();
        Estimator::ALL
            .into_iter()
            .enumerate()
            .map(|(i, rung)| {
                let of = |which: fn(&Answers) -> Answer| -> Vec<(Truth, Answer)> {
                    rows.iter()
                        .zip(&answers)
                        .map(|(row, answers)| (row.truth, which(&answers[i])))
                        .collect()
                };
                let (looked_at, alone) = (of(|it| it.looked_at), of(|it| it.alone));
                let nonsense = rows.iter().zip(&answers).find_map(|(row, answers)| {
                    nonsense(row, &answers[i].alone)
                        .or_else(|| nonsense(row, &answers[i].looked_at))
                });
                Outcome {
                    rung,
                    failure: nonsense.or_else(|| self.failure(rung, &looked_at)),
                    answers: looked_at,
                    alone,
                }
            })
            .collect()
    }

    fn failure(&self, rung: Estimator, answers: &[(Truth, Answer)]) -> Option<String> {
        let off = answers
            .iter()
            .find(|(truth, answer)| is_confident_error(*truth, answer));
        if let Some((truth, Ok(found))) = off {
            return Some(format!(
                "off by {:.3} px, claims {:.3} px, without a flag",
                truth.error(found.centre.to_f64()),
                found.uncertainty.to_f64()
            ));
        }
        if rung == Estimator::Robust
            && let Some(within) = self.robust_within
            && let Some(failure) = centre_failure(within, answers)
        {
            return Some(failure);
        }
        match self.due {
            Due::Honest => None,
            Due::Centre(within) if CAREFUL.contains(&rung) => centre_failure(within, answers),
            Due::Centre(_) => None,
            Due::NoCentre => answers.iter().find_map(|(_, answer)| {
                let found = answer.ok().filter(|found| !found.misfit)?;
                Some(format!("a centre without a flag at {:.1}", found.centre))
            }),
            Due::Fault(names) => answers.iter().find_map(|(_, answer)| match answer {
                Ok(found) => Some(format!("a centre at {:.1}", found.centre)),
                Err(fault) if names.contains(&fault.name()) => None,
                Err(fault) => Some(fault.name().into()),
            }),
        }
    }
}

/// Fewer than three in four rows with a centre without a flag, or one that is further off.
fn centre_failure(within: f64, answers: &[(Truth, Answer)]) -> Option<String> {
    let sure = answers
        .iter()
        .filter(|(_, answer)| answer.is_ok_and(|found| !found.misfit))
        .count();
    if 4 * sure < 3 * answers.len() {
        return Some(format!(
            "{sure} of {} rows without flag or fault",
            answers.len()
        ));
    }
    answers.iter().find_map(|(truth, answer)| {
        let found = answer.ok().filter(|found| !found.misfit)?;
        let error = truth.error(found.centre.to_f64());
        (error.abs() > within).then(|| format!("off by {error:.3} px, due {within:.3} px"))
    })
}

/// What no answer may be: a centre off the row, or an uncertainty, width or height that is none.
fn nonsense(row: &HardRow, answer: &Answer) -> Option<String> {
    let found = answer.ok()?;
    let centre = found.centre.to_f64();
    let on_the_row = (-0.5..=row.light.len() as f64 - 0.5).contains(&centre);
    let positive = found.uncertainty.to_bits() > 0 && found.width.to_bits() > 0;
    (!on_the_row || !positive).then(|| format!("nonsense: {found:?}"))
}
