//! The ways to find a row's centre that are measured: the firmware's estimators, and the check's repair.

use slitrange::base::work_budget::WorkBudget;
use slitrange::centre;
use slitrange::measurement::robust_centre;
use slitrange::spot::Spot;
use slitrange::{Estimator, Fault, Geometry, Row, RowCentre};

/// A way to find a row's centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// An estimator of the firmware.
    Estimator(Estimator),
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
    pub const ALL: [Self; 6] = [
        Self::Estimator(Estimator::Centroid),
        Self::Estimator(Estimator::PhaseTable),
        Self::Estimator(Estimator::Adaptive),
        Self::Estimator(Estimator::GaussNewton),
        Self::Estimator(Estimator::Fraunhofer),
        Self::Repair,
    ];

    /// Its name in tables and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Estimator(estimator) => estimator.name(),
            Self::Repair => "repair",
        }
    }

    /// The estimator, if a user of the firmware can choose it.
    pub const fn estimator(self) -> Option<Estimator> {
        match self {
            Self::Estimator(estimator) => Some(estimator),
            Self::Repair => None,
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
        Method::Repair => {
            robust_centre(row, spot, before, geometry, None, &mut WorkBudget::of_row())
        }
    }
}
