//! The spot's centre on its row, to a fraction of a pixel: five estimators, from the cheapest to the most
//! careful.
//!
//! All take the same arguments and return the same result: see [`centre`].
//!
//! To add an estimator, write its file here and add a variant to [`Estimator`]. The compiler names most
//! places that need a case of it. It does not name these, where a new estimator is treated as `phase-table`
//! is: [`Estimator::by_shape`], `above_black`, the [`estimate`] of a cut or flat spot, and the repair in
//! [`steps`](crate::measurement::steps).

pub(crate) mod adaptive;
mod centroid;
pub mod estimate;
mod flat_top;
mod fraunhofer;
pub mod gauss_newton;
pub mod half_width;
pub mod phase_table;
pub mod plausible;
pub mod spot_shape;
pub mod tables;
mod window;

use serde::{Deserialize, Serialize};

use crate::base::{Counts, Fault, Pixels, named};
use crate::centre::spot_shape::{OwnSpot, SpotShape};
use crate::centre::tables::Sampling;
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// A way to find a row's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Estimator {
    /// The centroid of the counts above the black level, eq. (2).
    Centroid,
    /// The phase-table score with one set of weights for every row.
    PhaseTable,
    /// The phase-table score with weights that follow the spot's width, its noise and the background's tilt.
    #[default]
    Adaptive,
    /// A weighted least-squares fit of eq. (5), by the Gauss-Newton method: the paper's fit.
    GaussNewton,
    /// The phase-table score for the diffraction pattern of a slit, eq. (6).
    Fraunhofer,
}

named! {
    Estimator {
        Centroid: "centroid",
        PhaseTable: "phase-table",
        Adaptive: "adaptive",
        GaussNewton: "gauss-newton",
        Fraunhofer: "fraunhofer"
    }
}

impl Estimator {
    /// The standard uncertainty of a calibrated centre by the spot's shape. `own` is the sensor's own spot.
    pub fn by_shape(self, shape: &SpotShape, own: Option<&OwnSpot>) -> Pixels {
        match self {
            Self::Adaptive => shape.uncertainty_by_sets(own),
            _ => shape.uncertainty(own),
        }
    }

    /// The letter in the line of a reading, which has no room for a name.
    pub const fn letter(self) -> char {
        match self {
            Self::Centroid => 'c',
            Self::PhaseTable => 't',
            Self::Adaptive => 'a',
            Self::GaussNewton => 'g',
            Self::Fraunhofer => 'f',
        }
    }
}

/// What an estimator finds in a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RowCentre {
    /// The spot's centre.
    pub centre: Pixels,
    /// The standard uncertainty of the centre that follows from the row's noise and the spot's shot noise.
    pub uncertainty: Pixels,
    /// The spot's height above the background.
    pub amplitude: Counts,
    /// The spot's width (a gaussian's sigma).
    pub width: Pixels,
    /// The phase table that was used, if any.
    pub class: WidthClass,
    /// The spot's antisymmetric light and its width. The [`check`](crate::check) measures it;
    /// the estimators leave it at zero.
    pub shape: SpotShape,
    /// The row does not have the shape of a spot, or its asymmetry is too large for `shape` to express: the
    /// centre may be off by more than its uncertainty. Of the estimators only [`Estimator::GaussNewton`]
    /// sets this flag; the [`check`](crate::check) sets it for all.
    pub misfit: bool,
}

/// Which phase table was used, and the pixels in a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WidthClass {
    /// Number of the table set.
    pub set: u8,
    /// Index of the table in its set.
    pub table: u8,
    /// Pixels in a sample.
    pub block: u8,
}

/// Finds the centre of a spot that the coarse search found.
///
/// `before` is the result of the same estimator for the row before, if there is one. As far as its width and
/// its place still fit, they need not be found again.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where the pixels that the estimator needs reach over the sensor's edge.
/// [`Fault::Saturated`] where a pixel within two widths of the centre is saturated. [`Fault::TooDim`]
/// where the noise leaves the centre uncertain by more than an eighth of the width. [`Fault::NoSpot`] where
/// the light there does not have the shape of a spot.
// Inlined, so that a program whose estimator is fixed at compile time does not contain the others.
#[inline(always)]
pub fn centre(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    match estimator {
        Estimator::Centroid => centroid::centre(row, spot, before, geometry),
        Estimator::GaussNewton => gauss_newton::centre(row, spot, before, geometry),
        Estimator::Adaptive => adaptive::centre(row, spot, before, geometry),
        Estimator::Fraunhofer => fraunhofer::centre(row, spot, before, geometry),
        Estimator::PhaseTable => phase_table::centre(
            row,
            spot,
            before,
            geometry,
            &tables::GAUSSIAN,
            Sampling::Fine,
        ),
    }
}

/// A centre with its height above the black level, if that is what the centroid sums. The other estimators
/// fit or cancel the level under the spot, and measure the height above it.
///
/// # Errors
/// [`Fault::NoSpot`] if the centroid's height is not above zero.
#[inline(always)]
pub(crate) fn above_black(
    estimator: Estimator,
    spot: &Spot,
    found: RowCentre,
) -> Result<RowCentre, Fault> {
    if estimator != Estimator::Centroid {
        return Ok(found);
    }
    let amplitude = spot.above_black(found.amplitude);
    if amplitude <= Counts::default() {
        return Err(spot.no_spot());
    }
    Ok(RowCentre { amplitude, ..found })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_letters_tell_estimators_apart() {
        for it in Estimator::ALL {
            assert_eq!(Estimator::named(it.name()), Some(it));
            let same = Estimator::ALL
                .into_iter()
                .filter(|other| other.letter() == it.letter());
            assert_eq!(same.count(), 1, "{}", it.letter());
        }
        for name in ["", "Adaptive", "adaptive ", "t"] {
            assert_eq!(Estimator::named(name), None, "{name}");
        }
    }
}
