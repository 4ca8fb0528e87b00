//! A comb: several slits side by side before one line sensor. Each slit shows the laser spot once.
//!
//! Speckle moves the image of a spot, and no estimator can tell. The images of a comb have different speckle,
//! because each slit sees the target from another direction. So their mean has a smaller error than one
//! image, and their scatter tells how large that error is, in each single reading.
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
mod peaks;
mod slit_map;

use heapless::Vec;

pub use assignment::{Assignment, FEWEST, LEAD, TOLERANCE, assign};
pub(crate) use background::background;
pub use combination::{Combined, Scatter, SlitCentre, SlitCentres};
pub(crate) use images::CombMeasurement;
pub use mask::{MAX_SLITS, NOMINAL_GAPS_UM, NOMINAL_PLACES_UM, SLIT_WIDTH_UM};
pub use peaks::{MAX_PEAKS, Peak, Peaks};
pub use slit_map::{CORRECTIONS, SlitMap};

/// What is before the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Slits {
    /// One slit, or a lens.
    #[default]
    One,
    /// A comb.
    Comb,
}

impl Slits {
    /// Both.
    pub const ALL: [Self; 2] = [Self::One, Self::Comb];

    /// The name on the serial line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::One => "one",
            Self::Comb => "comb",
        }
    }

    /// Finds what is before the sensor by its [`name`](Self::name).
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|it| it.name() == name)
    }
}

/// The slits of a comb, in the order of their places.
#[derive(Clone, Debug, PartialEq, Eq)]
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

    /// A comb of these slits. `None` if there are none, more than [`MAX_SLITS`], or one is not to the right of
    /// the one before.
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
}
