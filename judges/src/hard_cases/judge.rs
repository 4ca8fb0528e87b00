//! Every estimator's answers to a case, and whether they are what is due.

pub use crate::accuracy::Answer;
use crate::hard_cases::frames::is_flagged;
use crate::hard_cases::truth::is_beyond_claim;
use crate::hard_cases::{Due, HardRow, ROWS, RowCase, Truth};
use slitrange::centre;
use slitrange::measurement::{centre_of_spot, robust_centre};
use slitrange::spot;
use slitrange::{Estimator, Fault, Micrometres, Reading, Row};

/// An estimator's answers to a row.
#[derive(Clone, Copy, Debug)]
pub struct Answers {
    /// Of the estimator alone ([`centre::centre`]).
    pub alone: Answer,
    /// As the measurement takes it ([`centre_of_spot`]).
    pub checked: Answer,
}

/// Every estimator's answers to a row, in the order of [`Estimator::ALL`].
///
/// # Panics
/// The row has a word of more than 12 bits.
pub fn answers(row: &HardRow) -> [Answers; Estimator::ALL.len()] {
    let parts = Row::new(&row.light, &[], row.geometry.saturated_from()).expect("12 bits");
    let found = spot::find(&parts);
    Estimator::ALL.map(|estimator| Answers {
        alone: found
            .and_then(|(spot, _)| centre::centre(estimator, &parts, &spot, None, &row.geometry)),
        checked: found.and_then(|(spot, budget)| {
            centre_of_spot(estimator, &parts, &spot, None, &row.geometry, None, budget)
        }),
    })
}

/// What a row or a frame says, as a judge hears it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Said {
    /// A centre.
    Centre {
        /// How far it is off, in pixels; infinitely, where there is none or no telling.
        error: f64,
        /// Its standard uncertainty in pixels.
        claim: f64,
        /// Whether it says that it is not to be trusted.
        flagged: bool,
    },
    /// No centre.
    Fault(Fault),
}

impl Said {
    /// By a row.
    pub fn of_row(truth: Truth, answer: &Answer) -> Self {
        match answer {
            Ok(found) => Self::Centre {
                error: truth.error(found.centre.to_f64()),
                claim: (found.uncertainty.to_f64()).hypot(found.shape.uncertainty(None).to_f64()),
                flagged: found.misfit,
            },
            Err(fault) => Self::Fault(*fault),
        }
    }

    /// By a frame. The claim is that of its rows: noise, shape and motion.
    pub fn of_reading(truth: Truth, answer: &Result<Reading, Fault>) -> Self {
        match answer {
            Ok(reading) => Self::Centre {
                error: truth.error(reading.centre.to_f64()),
                claim: {
                    let parts = &reading.parts;
                    let [noise, shape, motion] =
                        [parts.noise, parts.shape, parts.motion].map(Micrometres::to_f64);
                    reading.centre_uncertainty.to_f64() * noise.hypot(shape).hypot(motion) / noise
                },
                flagged: is_flagged(reading),
            },
            Err(fault) => Self::Fault(*fault),
        }
    }

    /// The error of a centre without a flag.
    pub fn unflagged(&self) -> Option<f64> {
        match self {
            Self::Centre {
                error,
                flagged: false,
                ..
            } => Some(*error),
            _ => None,
        }
    }

    /// Whether it is a centre with a flag.
    pub fn is_flagged(&self) -> bool {
        matches!(self, Self::Centre { flagged: true, .. })
    }

    /// Whether it is a centre no further off than it claims.
    pub fn is_as_claimed(&self) -> bool {
        matches!(self, Self::Centre { error, claim, .. } if !is_beyond_claim(*error, *claim))
    }

    /// Whether it is wrong, and does not say so.
    pub fn is_confident_error(&self) -> bool {
        self.unflagged().is_some() && !self.is_as_claimed()
    }
}

impl Due {
    /// What is not as it must be in what an estimator says, in words.
    pub fn failure(self, estimator: Estimator, said: &[Said]) -> Option<String> {
        if self == Self::Unknowable {
            return None;
        }
        if let Some(Said::Centre { error, claim, .. }) =
            said.iter().find(|said| said.is_confident_error())
        {
            return Some(if error.is_finite() {
                format!("off by {error:.3} px, claims {claim:.3} px, without a flag")
            } else {
                "a centre without a flag".into()
            });
        }
        match self {
            Self::Honest | Self::Unknowable => None,
            // The centroid makes errors of its own, which it claims.
            Self::Centre(_) if estimator == Estimator::Centroid => None,
            Self::Centre(within) => is_missed(within, said),
            Self::NoCentre => (said.iter().any(|said| said.unflagged().is_some()))
                .then(|| "a centre without a flag".into()),
            Self::Fault(names) => said.iter().find_map(|said| match said {
                Said::Fault(fault) if names.contains(&fault.name()) => None,
                Said::Fault(fault) => Some(fault.name().into()),
                Said::Centre { .. } => Some("a centre".into()),
            }),
        }
    }
}

/// Fewer than three in four with a centre without a flag, or one that is further off than so many pixels.
fn is_missed(within: f64, said: &[Said]) -> Option<String> {
    let errors: Vec<f64> = said.iter().filter_map(Said::unflagged).collect();
    if 4 * errors.len() < 3 * said.len() {
        let (sure, all) = (errors.len(), said.len());
        return Some(format!("{sure} of {all} without flag or fault"));
    }
    let off = errors.into_iter().find(|error| error.abs() > within);
    off.map(|error| format!("off by {error:.3} px, due {within:.3} px"))
}

/// What came of a case for an estimator.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The estimator.
    pub estimator: Estimator,
    /// What its answers say, as the measurement takes it.
    pub said: Vec<Said>,
    /// What is not as it must be, in words.
    pub failure: Option<String>,
}

impl Outcome {
    /// Judges an answer: `said` beside what is `due`. An impossible answer is `nonsense`, and fails.
    pub fn of(due: Due, estimator: Estimator, said: Vec<Said>, nonsense: Option<String>) -> Self {
        Self {
            estimator,
            failure: nonsense.or_else(|| due.failure(estimator, &said)),
            said,
        }
    }
}

impl RowCase {
    /// Runs every estimator over its rows.
    pub fn run(&self) -> Vec<Outcome> {
        let rows: Vec<HardRow> = (0..ROWS).map(|number| self.row(number)).collect();
        let answers: Vec<_> = rows.iter().map(answers).collect();
        let outcome = |(i, estimator): (usize, Estimator)| {
            let answers = || rows.iter().zip(answers.iter().map(|of_all| of_all[i]));
            let nonsense = answers().find_map(|(row, it)| {
                nonsense(row, &it.alone).or_else(|| nonsense(row, &it.checked))
            });
            let said = answers().map(|(row, it)| Said::of_row(row.truth, &it.checked));
            Outcome::of(self.due, estimator, said.collect(), nonsense)
        };
        Estimator::ALL
            .into_iter()
            .enumerate()
            .map(outcome)
            .collect()
    }

    /// What the repair's own answers ([`robust_centre`]) lack of [`RowCase::repair_within`], in words.
    ///
    /// # Panics
    /// A row has a word of more than 12 bits.
    pub fn repair_failure(&self) -> Option<String> {
        let within = self.repair_within?;
        let repaired = |number| {
            let row = self.row(number);
            let parts = Row::new(&row.light, &[], row.geometry.saturated_from()).expect("12 bits");
            let found = spot::find(&parts).and_then(|(spot, mut budget)| {
                robust_centre(&parts, &spot, None, &row.geometry, None, &mut budget)
            });
            Said::of_row(row.truth, &found)
        };
        is_missed(within, &(0..ROWS).map(repaired).collect::<Vec<_>>())
    }
}

/// What no answer may be: a centre off the row, or an uncertainty, width or height that is none.
fn nonsense(row: &HardRow, answer: &Answer) -> Option<String> {
    let found = answer.ok()?;
    let on_the_row = (-0.5..=row.light.len() as f64 - 0.5).contains(&found.centre.to_f64());
    let positive = found.uncertainty.to_bits() > 0 && found.width.to_bits() > 0;
    (!on_the_row || !positive).then(|| format!("nonsense: {found:?}"))
}
