//! The answer to `help estimator`.

use core::fmt;

use crate::centre::Estimator;

/// The estimators, each with what it is for. How accurate each is and what it costs is in docs/accuracy.md.
#[derive(Clone, Copy, Debug)]
pub struct Ladder;

impl fmt::Display for Ladder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, estimator) in Estimator::ALL.into_iter().enumerate() {
            let end = if i == 0 { "" } else { "\r\n" };
            write!(
                f,
                "{end}help estimator {} ({})",
                estimator.name(),
                purpose(estimator)
            )?;
        }
        Ok(())
    }
}

const fn purpose(estimator: Estimator) -> &'static str {
    match estimator {
        Estimator::Centroid => "eq. (2), for comparison",
        Estimator::PhaseTable => "the default",
        Estimator::Adaptive => "at the bound, follows noise and tilt",
        Estimator::GaussNewton => "the paper's fit, eq. (5)",
        Estimator::Fraunhofer => "for the slit's diffraction pattern, eq. (6)",
    }
}
