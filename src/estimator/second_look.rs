//! Whether the row looks as its centre says, and another rung where it does not.

use crate::estimator::mirror::{self, LeftOut};
use crate::estimator::{self, Estimator, RowCentre, gauss_newton, robust};
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
    let found = match (
        estimator,
        estimator::centre(estimator, row, spot, before, geometry),
    ) {
        (Estimator::Robust, looked_at) => return looked_at,
        (Estimator::GaussNewton, found) => flagged(row, spot, found?, geometry),
        (_, Err(Fault::SpotAtEdge { .. })) => {
            let found = gauss_newton::centre(row, spot, before, geometry)?;
            flagged(row, spot, found, geometry)
        }
        (_, found) => {
            let found = flagged(row, spot, found?, geometry);
            if found.misfit
                && let Ok(other) = robust::centre(row, spot, before, geometry)
                && !other.misfit
            {
                return Ok(RowCentre {
                    class: found.class,
                    ..other
                });
            }
            found
        }
    };
    Ok(found)
}

/// The centre, flagged where the row does not look like it.
fn flagged(row: &Row<'_>, spot: &Spot, found: RowCentre, geometry: &Geometry) -> RowCentre {
    let fits = mirror::fits(row, spot, &found, geometry, &LeftOut::default());
    RowCentre {
        misfit: found.misfit || !fits,
        ..found
    }
}
