//! Whether the row looks as its centre says, and another rung where it does not.

use crate::estimator::{self, Estimator, RowCentre};
use crate::reading::Fault;
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// The centre of a spot that the coarse search found, as the measurement trusts it.
///
/// # Errors
/// See [`estimator::centre`].
pub fn centre(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    estimator::centre(estimator, row, spot, before, geometry)
}
