//! What a method is given: a row whose spot is known, and what it found in the row before.

use slitrange::row::LARGEST_COUNT;
use slitrange::spot::{self, Spot};
use slitrange::{Fault, Geometry, Row, RowCentre};

use crate::methods::{self, Method};

/// A row, searched.
#[derive(Clone, Copy, Debug)]
pub struct Searched<'a> {
    /// The row.
    pub row: Row<'a>,
    /// What the coarse search found in it.
    pub spot: Spot,
}

/// The arguments of [`methods::centre`].
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// The row and its spot.
    pub searched: Searched<'a>,
    /// What the same method found in the row before.
    pub before: Option<RowCentre>,
    /// What the row's counts are.
    pub geometry: &'a Geometry,
}

/// Searches a row.
///
/// # Errors
/// As [`spot::find`]; counts beyond 12 bits are [`Fault::SensorSilent`].
pub fn searched(light: &[u16]) -> Result<Searched<'_>, Fault> {
    let row = Row::new(light, &[], LARGEST_COUNT).map_err(|_| Fault::SensorSilent)?;
    Ok(Searched {
        row,
        spot: spot::find(&row)?.0,
    })
}

/// The arguments for a method: the row now, and what the method found in the row before, which it saw as the
/// first.
pub fn input<'a>(
    method: Method,
    before: &Searched<'_>,
    now: Searched<'a>,
    geometry: &'a Geometry,
) -> Input<'a> {
    Input {
        searched: now,
        before: methods::centre(method, &before.row, &before.spot, None, geometry).ok(),
        geometry,
    }
}
