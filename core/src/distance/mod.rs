//! Converts the centre of the spot to the distance of the target.

pub mod eq1;
pub mod knots;
pub mod residuals;
pub mod table;

use core::ops::RangeInclusive;

use crate::base::{Fault, Micrometres, Pixels};
use crate::distance::eq1::{Eq1, NOMINAL};
use residuals::Corrected;
use table::Table;

/// The distance for each centre. The constructors refuse what cannot be used: so the distance of every
/// calibration rises or falls with the centre over its whole range, and fits into [`Micrometres`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Calibration {
    /// Eq. (1).
    Eq1(Eq1),
    /// A lookup table.
    Table(Table),
    /// Eq. (1) with a table of residuals.
    Corrected(Corrected),
}

// Decoding a record moves a calibration from function to function by value, so several copies lie on the
// chip's stack at once; its RAM has 192 KB.
const _: () = assert!(size_of::<Calibration>() <= 2200);

impl Calibration {
    /// The calibration of [`NOMINAL`], used until a sensor has its own.
    pub fn nominal() -> Option<Self> {
        NOMINAL.ok().map(Self::Eq1)
    }

    /// The distance at a centre, and the curve's slope there in micrometres a pixel.
    ///
    /// # Errors
    /// [`Fault::OutOfRange`] where the calibration is not valid.
    // One function, whose instructions `cargo cost` counts.
    #[inline(never)]
    pub fn distance_at(&self, centre: Pixels) -> Result<(Micrometres, f32), Fault> {
        match self {
            Self::Eq1(curve) => curve.distance_at(centre),
            Self::Table(table) => table.distance_at(centre),
            Self::Corrected(curve) => curve.distance_at(centre),
        }
    }

    /// The first and the last centre for which the calibration is valid.
    pub const fn valid(&self) -> (Pixels, Pixels) {
        match self {
            Self::Eq1(curve) => curve.valid(),
            Self::Table(table) => table.valid(),
            Self::Corrected(curve) => curve.valid(),
        }
    }

    /// The shortest and the longest distance: those at the two ends of the range of centres.
    ///
    /// # Errors
    /// None: both ends belong to the range.
    pub fn distances(&self) -> Result<RangeInclusive<Micrometres>, Fault> {
        let (first, last) = self.valid();
        let (a, b) = (self.distance_at(first)?.0, self.distance_at(last)?.0);
        Ok(a.min(b)..=a.max(b))
    }
}
