//! A comb: several slits side by side before one line sensor. Each slit shows the laser spot once.
//!
//! Speckle moves the image of a spot, and no estimator sees this in one image. The images of a comb have
//! different speckle, because each slit sees the target from another direction. So their mean has a smaller
//! error than one image, and their scatter tells how large that error is, in each single reading.
//!
//! ```text
//! row -> peaks -> assignment -> images -> row's mean -> frame -> combination -> centre and its u
//!        blocks   of peaks      estimator  weights by            all rows of
//!        of 8     to slits      and check  light                 all slits
//! ```
//!
//! Slit and sensor are parallel, so the image of any slit lies on a straight line over the image that a slit
//! on the optical axis would show ([`SlitMap`]). All images are brought to that place, and what follows is
//! the same as for one slit: frames, eq. (1), residuals, records.

mod assignment;
mod background;
mod combination;
mod images;
mod mask;
mod maxima;
mod slit_map;

use core::fmt;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::base::{Micrometres, named};

pub use assignment::{Assignment, FEWEST, LEAD, TOLERANCE, assign};
pub(crate) use background::background;
pub use combination::{Combined, NEIGHBOURS, Scatter, SlitCentre, SlitCentres};
pub(crate) use images::CombMeasurement;
pub use mask::{MAX_SLITS, NOMINAL_GAPS_UM, NOMINAL_PLACES_UM, SLIT_WIDTH_UM};
pub use maxima::{MAX_MAXIMA, Maxima, Maximum};
pub use slit_map::{CORRECTIONS, LARGEST_CORRECTION, LARGEST_PLACE_UM, SlitMap, UNIT};

/// What is before the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Slits {
    /// One slit, or a lens.
    #[default]
    One,
    /// A comb.
    Comb,
}

named! { Slits { One: "one", Comb: "comb" } }

/// The slits of a comb, in the order of their places. They are kept for years: another encoding needs another
/// version.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Comb {
    slits: Vec<SlitMap, MAX_SLITS>,
}

impl Comb {
    /// The nominal mask before the nominal geometry.
    pub fn nominal() -> Self {
        let mut slits = Vec::new();
        for place in NOMINAL_PLACES_UM {
            // There is room for MAX_SLITS.
            let _ = slits.push(SlitMap::nominal(place));
        }
        Self { slits }
    }

    /// A comb of these slits. `None` if there are none, more than [`MAX_SLITS`], or one is not to the right
    /// of the one before.
    pub fn new(slits: &[SlitMap]) -> Option<Self> {
        let ascending = |pair: &[SlitMap]| match pair {
            [left, right] => left.place() < right.place(),
            _ => false,
        };
        if slits.is_empty() || !slits.windows(2).all(ascending) {
            return None;
        }
        Some(Self {
            slits: Vec::from_slice(slits).ok()?,
        })
    }

    /// The slits.
    pub fn slits(&self) -> &[SlitMap] {
        &self.slits
    }

    /// Checks that rows can be measured with these slits.
    ///
    /// # Errors
    /// [`CombError`] says which slit cannot be used, and why.
    pub fn check(&self) -> Result<(), CombError> {
        let slits = self.slits.len();
        if slits < FEWEST {
            return Err(CombError::Few { slits });
        }
        let mut before = None;
        for (slit, number) in self.slits.iter().zip(1..) {
            let place = slit.place();
            if before.is_some_and(|before| place <= before) {
                return Err(CombError::Order { number });
            }
            before = Some(place);
            if !slit.is_on_row() {
                return Err(CombError::Place { number, place });
            }
            if !slit.has_small_correction() {
                return Err(CombError::Correction { number });
            }
        }
        Ok(())
    }
}

/// Why a comb cannot be used. Slits count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CombError {
    /// There are fewer than [`FEWEST`] slits.
    Few {
        /// How many there are.
        slits: usize,
    },
    /// A slit is not to the right of the slit before.
    Order {
        /// The slit.
        number: usize,
    },
    /// A slit is beyond the ends of the longest row.
    Place {
        /// The slit.
        number: usize,
        /// Its place.
        place: Micrometres,
    },
    /// A coefficient of a slit's correction is beyond [`LARGEST_CORRECTION`].
    Correction {
        /// The slit.
        number: usize,
    },
}

impl fmt::Display for CombError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Few { slits } => write!(
                f,
                "the record's comb has {slits} slits and needs {FEWEST}: fit again with all slits"
            ),
            Self::Order { number } => write!(
                f,
                "slit {number} of the record's comb is not to the right of the slit before: put the slits in \
                the order of their places"
            ),
            Self::Place { number, place } => write!(
                f,
                "slit {number} of the record's comb is at {place:.0} um, and must be within \
                {LARGEST_PLACE_UM} um of the axis: correct its place"
            ),
            Self::Correction { number } => write!(
                f,
                "the correction of slit {number} of the record's comb is beyond {LARGEST_CORRECTION} px: \
                check the mask's drawing, and fit again"
            ),
        }
    }
}

impl core::error::Error for CombError {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::Pixels;

    #[test]
    fn combs_that_cannot_be_used_are_refused() {
        let nominal = Comb::nominal();
        assert_eq!(nominal.check(), Ok(()));
        let with = |number: usize, slit: SlitMap| {
            let mut comb = Comb::nominal();
            comb.slits[number - 1] = slit;
            comb.check()
        };
        let few = Comb::new(&nominal.slits()[..3]).expect("ascending");
        assert_eq!(few.check(), Err(CombError::Few { slits: 3 }));
        let twice = nominal.slits()[4];
        assert_eq!(with(6, twice), Err(CombError::Order { number: 6 }));
        let most = Pixels::from_int(LARGEST_CORRECTION);
        let beyond = Pixels::from_bits(most.to_bits() + 1);
        for place in 0..CORRECTIONS {
            let corrected = |value: Pixels| {
                let mut correction = [Pixels::default(); CORRECTIONS];
                correction[place] = value;
                with(5, twice.corrected(correction))
            };
            let error = Err(CombError::Correction { number: 5 });
            assert_eq!(corrected(most), Ok(()));
            assert_eq!(corrected(beyond), error);
            assert_eq!(corrected(Pixels::from_bits(-beyond.to_bits())), error);
            assert_eq!(corrected(Pixels::MIN), error);
        }
        // Only bytes can have such a place.
        let place = Micrometres::from_int(LARGEST_PLACE_UM + 1);
        let mut buffer = [0; 32];
        let parts = (place, [Pixels::default(); CORRECTIONS]);
        let bytes = postcard::to_slice(&parts, &mut buffer).expect("room");
        let slit: SlitMap = postcard::from_bytes(bytes).expect("a slit");
        assert_eq!(with(16, slit), Err(CombError::Place { number: 16, place }));
        for error in [
            CombError::Few { slits: 3 },
            CombError::Order { number: 2 },
            CombError::Place { number: 16, place },
            CombError::Correction { number: 5 },
        ] {
            println!("{error}");
            assert!(error.to_string().contains(": "));
        }
    }
}
