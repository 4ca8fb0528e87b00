//! The phase-table score on sums of pixels, as many as leave a good one a sigma: the coarse search's own samples.
//!
//! A spot of 10.5 pixels is weighed by 14 sums of 8 pixels, in a seventh of the inner product. In white noise that costs 3.6 %
//! of accuracy and in shot noise 2.4 %, and one set of weights serves all wide spots. Spots narrower than 2.3 pixels have no
//! pixels to spare; for them this is [`phase_table`].

use crate::centre::tables::{GAUSSIAN, Sampling};
use crate::centre::{RowCentre, phase_table};
use crate::fault::Fault;
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// The centre of a spot.
///
/// # Errors
/// See [`crate::centre::centre`].
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let sampling = Sampling::Coarse;
    phase_table::centre(row, spot, before, geometry, &GAUSSIAN, sampling)
}
