//! Whether a calibration is good enough, in one line.

use std::fmt;

use serde::Serialize;

use super::form::Made;
use crate::fit::observed::Weights;
use crate::fit::order::FEWEST_TO_REJECT;
use crate::fit::solve::Solved;

/// The largest uncertainty of a good curve, over its range of distances. Makers of triangulation sensors
/// state a linearity of 0.05 to 0.3 % of the range.
const GOOD: f64 = 1e-3;
/// The largest uncertainty of a usable curve, over its range of distances.
const USABLE: f64 = 1e-2;
/// Points that scatter by more than this factor over what was given of their errors have another error, too.
pub const SCATTERED: f64 = 1.5;
/// More rejected points than this share are no matter of a few slips.
const REJECTED: f64 = 0.1;

/// A verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The verdict in a word or two.
    pub calibration: Grade,
    /// The curve's largest standard uncertainty over its range. None if the points do not tell it.
    pub largest_uncertainty_um: Option<f64>,
    /// That, and what speaks against the calibration.
    pub because: String,
}

/// How good a calibration is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Grade {
    /// Nothing speaks against it.
    Good,
    /// A person can use it, with the uncertainty that the verdict states.
    Usable,
    /// The sensor would be wrong by more than a hundredth of its range, or nobody can tell.
    NotUsable,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = match self.calibration {
            Grade::Good => "good",
            Grade::Usable => "usable",
            Grade::NotUsable => "not usable",
        };
        write!(f, "Calibration {words}: {}", self.because)
    }
}

impl Verdict {
    /// The verdict on a calibration.
    pub fn of(solved: &Solved, made: &Made<'_>) -> Self {
        let (first, last) = made.curve.eq1.valid;
        let [first_mm, last_mm] = [first, last].map(|centre| 1e3 * made.curve.distance(centre));
        let largest_uncertainty = solved.quality(made.form).largest_uncertainty;
        let largest_uncertainty_um = largest_uncertainty.map(|metres| 1e6 * metres);
        let Some(um) = largest_uncertainty_um else {
            let because = "three points do not tell how uncertain the curve is; take more points";
            return Self {
                calibration: Grade::NotUsable,
                largest_uncertainty_um,
                because: because.into(),
            };
        };
        let share = um / (1e3 * (last_mm - first_mm).abs());
        let doubt = doubt(solved, made, share);
        // Not a number is not usable.
        let calibration = match &doubt {
            None if share <= GOOD => Grade::Good,
            _ if share <= USABLE => Grade::Usable,
            _ => Grade::NotUsable,
        };
        let (least, most) = (first_mm.min(last_mm), first_mm.max(last_mm));
        let figure = format!(
            "the curve is uncertain by {um:.1} um at most, from {least:.0} to {most:.0} mm"
        );
        let because = doubt.map_or(figure.clone(), |doubt| format!("{figure}; {doubt}"));
        Self {
            calibration,
            largest_uncertainty_um,
            because,
        }
    }
}

/// What speaks against a calibration, the worst first, and what to do.
fn doubt(solved: &Solved, made: &Made<'_>, share: f64) -> Option<String> {
    let points = solved.points.len();
    let rejected = solved.verdicts.iter().filter(|it| !it.kept).count();
    let more_than = |part: f64| {
        format!(
            "that is more than {} % of the range: take more points, or measure their distances better",
            100.0 * part
        )
    };
    if share > USABLE {
        return Some(more_than(USABLE));
    }
    if points < FEWEST_TO_REJECT {
        let doubt = format!("with fewer than {FEWEST_TO_REJECT} points, none could be rejected");
        return Some(doubt);
    }
    if rejected as f64 > REJECTED * points as f64 {
        let doubt = format!("{rejected} of {points} points are rejected: take them again");
        return Some(doubt);
    }
    if let Some(scatter) = solved.quality(made.form).scatter
        && scatter > SCATTERED
        && solved.weights == Weights::Known
    {
        return Some(format!(
            "points scatter {scatter:.1} times as much as was given: speckle, or --position-uncertainty is \
             too small"
        ));
    }
    (share > GOOD).then(|| more_than(GOOD))
}
