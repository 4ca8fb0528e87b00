//! The ways to find a row's centre that are measured: the firmware's estimators, and others to compare them
//! with.

use slitrange::base::fault::Fault;
use slitrange::base::work_budget::WorkBudget;
use slitrange::centre::tables::{GAUSSIAN, Sampling};
use slitrange::centre::{self, Estimator, RowCentre, phase_table};
use slitrange::measurement::steps::robust_centre;
use slitrange::row::{Geometry, Row};
use slitrange::spot::Spot;

use crate::baselines::parabola::{self, Scale};
use crate::baselines::zero_crossing;

/// A way to find a row's centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// An estimator of the firmware.
    Estimator(Estimator),
    /// A baseline: the vertex of a parabola through the highest pixel and its neighbours.
    Parabola,
    /// A baseline: the same through the logarithms of the counts.
    LogParabola,
    /// A baseline: where as much light lies to the left as to the right, within a box.
    ZeroCrossing,
    /// A baseline: the phase-table score on sums of pixels, 1.15 to 2.3 of them a sigma.
    Blocks,
    /// The robust fit, which the check runs where a row does not look like its centre.
    Repair,
}

impl Default for Method {
    fn default() -> Self {
        Self::Estimator(Estimator::default())
    }
}

impl Method {
    /// All methods: the firmware's estimators first.
    pub const ALL: [Self; 10] = [
        Self::Estimator(Estimator::Centroid),
        Self::Estimator(Estimator::PhaseTable),
        Self::Estimator(Estimator::Adaptive),
        Self::Estimator(Estimator::GaussNewton),
        Self::Estimator(Estimator::Fraunhofer),
        Self::Parabola,
        Self::LogParabola,
        Self::ZeroCrossing,
        Self::Blocks,
        Self::Repair,
    ];

    /// Its name in tables and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Estimator(estimator) => estimator.name(),
            Self::Parabola => "parabola",
            Self::LogParabola => "log-parabola",
            Self::ZeroCrossing => "zero-crossing",
            Self::Blocks => "blocks",
            Self::Repair => "repair",
        }
    }

    /// The estimator, if a user of the firmware can choose it.
    pub const fn estimator(self) -> Option<Estimator> {
        match self {
            Self::Estimator(estimator) => Some(estimator),
            _ => None,
        }
    }
}

/// Finds the centre of a spot: [`centre::centre`] for any method.
///
/// # Errors
/// See [`centre::centre`].
// Inlined so that a method that is known at compile time brings no other method's code with it.
#[inline(always)]
pub fn centre(
    method: Method,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    match method {
        Method::Estimator(estimator) => centre::centre(estimator, row, spot, before, geometry),
        Method::Parabola => parabola::centre(row, spot, before, geometry, Scale::Counts),
        Method::LogParabola => parabola::centre(row, spot, before, geometry, Scale::Logarithms),
        Method::ZeroCrossing => zero_crossing::centre(row, spot, before, geometry),
        Method::Blocks => {
            phase_table::centre(row, spot, before, geometry, &GAUSSIAN, Sampling::Coarse)
        }
        Method::Repair => {
            let budget = &mut WorkBudget::of_row();
            robust_centre(row, spot, before, geometry, None, budget)
        }
    }
}
