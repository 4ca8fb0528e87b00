//! The exposure: for how long the laser is on in a row.
//!
//! Each row gathers light for the same time, the row period. The laser is on for a part of the row period.
//! So a shorter exposure takes less of the laser's light and as much of all other light.

use core::num::NonZeroU16;

use serde::{Deserialize, Serialize};

/// For how long the laser is on in a row: 10 to 5600 us, in steps of 1 us.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "u16", into = "u16")]
pub struct Exposure(NonZeroU16);

impl Exposure {
    /// The shortest.
    pub const SHORTEST: Self = Self(NonZeroU16::new(10).unwrap());
    /// The longest. A row takes 5.7 ms, of which the sensor's pulses need a part.
    pub const LONGEST: Self = Self(NonZeroU16::new(5600).unwrap());

    /// An exposure in microseconds. `None` outside its range.
    pub const fn from_us(us: u16) -> Option<Self> {
        match NonZeroU16::new(us) {
            Some(it) if us >= Self::SHORTEST.us() && us <= Self::LONGEST.us() => Some(Self(it)),
            _ => None,
        }
    }

    /// The exposure nearest to this time in microseconds.
    pub fn nearest_to_us(us: u32) -> Self {
        let limited = us.clamp(Self::SHORTEST.us().into(), Self::LONGEST.us().into());
        // Within the range, so neither fails.
        let found = u16::try_from(limited).ok().and_then(Self::from_us);
        found.unwrap_or(Self::LONGEST)
    }

    /// The exposure in microseconds.
    pub const fn us(self) -> u16 {
        self.0.get()
    }
}

/// How the exposure is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExposureMode {
    /// It follows the spot's brightness.
    #[default]
    Auto,
    /// It is set by hand.
    Fixed(Exposure),
}

impl TryFrom<u16> for Exposure {
    type Error = &'static str;

    fn try_from(us: u16) -> Result<Self, Self::Error> {
        Self::from_us(us).ok_or("an exposure is 10 to 5600 us")
    }
}

impl From<Exposure> for u16 {
    fn from(exposure: Exposure) -> Self {
        exposure.us()
    }
}
