//! From the centre of the spot to the distance of the target.

use crate::reading::Fault;
use crate::triangulation::{Eq1, NOMINAL};
use crate::units::{Micrometres, Pixels};

/// What a sensor's centres mean.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Calibration {
    /// Eq. (1).
    Eq1(Eq1),
}

impl Calibration {
    /// That of [`NOMINAL`], used until a sensor has its own.
    pub fn nominal() -> Option<Self> {
        NOMINAL.ok().map(Self::Eq1)
    }

    /// The distance at a centre, and the curve's slope there in micrometres a pixel.
    ///
    /// # Errors
    /// [`Fault::OutOfRange`] where the calibration is not valid.
    pub fn distance_at(&self, centre: Pixels) -> Result<(Micrometres, f32), Fault> {
        match self {
            Self::Eq1(curve) => curve.distance_at(centre),
        }
    }
}
