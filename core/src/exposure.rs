//! The exposure: for how long the laser is on in a row, and how it follows the target's brightness.
//!
//! The sensor gathers light from row to row, always for the same time. The laser is on for a part of that
//! time. So a shorter exposure takes less of the laser's light and as much of all other light.
//!
//! **Auto exposure.** Each row tells how bright the spot was, and how long the laser was on in this row. The
//! next exposure brings the spot to [`TARGET_PERCENT`] of its room: from the background to saturation. A row
//! arrives some rows after its exposure was chosen. This delay causes no swinging, because each row is
//! compared with its own exposure, and not with the latest one. The exposure stays while the spot is between
//! [`LEAST_PERCENT`] and [`MOST_PERCENT`], so noise and speckle do not change it from row to row.

use core::num::NonZeroU16;

use crate::fault::Fault;
use crate::units::Counts;

/// For how long the laser is on in a row: 10 to 5600 us, in steps of 1 us.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
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

/// The height at which auto exposure aims, in percent of the room. Of the range of a 12-bit converter this is
/// below 75 %, the least saturation of a TCD1304DG (0.45 V, where 0.6 V is typical; data sheet).
pub const TARGET_PERCENT: u32 = 70;

/// A spot that is lower than this, in percent of the room, gets a longer exposure.
pub const LEAST_PERCENT: u32 = 50;

/// A spot that is higher than this, in percent of the room, gets a shorter exposure.
pub const MOST_PERCENT: u32 = 85;

/// How much longer the exposure becomes after a row that shows no spot. A spot that is not found is below some
/// 25 counts in a dark room, so after this step the spot is below 2500 counts.
const AFTER_NOTHING: u32 = 100;

/// How much shorter the exposure becomes after a row that is saturated. Two steps go from the longest exposure
/// nearly to the shortest, and a spot that was only just saturated is still found after one step: it then has
/// a 32nd of the range, 120 counts.
const AFTER_SATURATED: u32 = 32;

/// The same where few pixels are saturated, because the spot is then not much too bright.
const AFTER_FEW_SATURATED: u32 = 4;

/// More saturated pixels than this are many. A spot with a sigma of 8.6 pixels has so many if its light is
/// six times what fits.
const FEW_PIXELS: u16 = 32;

/// What a row tells about its light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Brightness {
    /// The spot's height above the background, and its room: from the background to saturation. Both in whole
    /// counts.
    Height {
        /// The height.
        height: u16,
        /// The room.
        room: u16,
    },
    /// Pixels are saturated, so the spot's height is not known.
    Saturated {
        /// How many.
        pixels: u16,
    },
    /// There is no spot.
    Nothing,
    /// The row has a fault that does not depend on the exposure.
    Unknown,
}

impl Brightness {
    /// The brightness of a spot: its height above the background, and the room that the background leaves.
    pub fn of_spot(height: Counts, room: Counts) -> Self {
        Self::Height {
            height: whole(height),
            room: whole(room),
        }
    }

    /// The brightness of a row with a fault. `saturated` is the number of saturated pixels, wherever they are
    /// on the row.
    pub fn of_fault(fault: &Fault, saturated: u16, room: Counts) -> Self {
        match *fault {
            Fault::Saturated { pixels } => Self::Saturated {
                pixels: pixels.max(saturated),
            },
            _ if saturated > 0 => Self::Saturated { pixels: saturated },
            Fault::TooDim { amplitude, .. } => Self::of_spot(amplitude, room),
            Fault::NoSpot { .. } | Fault::FewSlits { .. } => Self::Nothing,
            _ => Self::Unknown,
        }
    }
}

/// Whole counts, limited to 0 to 65,535.
fn whole(counts: Counts) -> u16 {
    u16::try_from(counts.to_bits().max(0) >> Counts::FRACTION).unwrap_or(u16::MAX)
}

/// Auto exposure: rows in, the next exposure out.
#[derive(Clone, Copy, Debug)]
pub struct AutoExposure {
    next: Exposure,
}

impl AutoExposure {
    /// Begins with the longest exposure.
    pub const fn new() -> Self {
        Self {
            next: Exposure::LONGEST,
        }
    }

    /// The exposure to use from now on, of at most `limit`.
    pub fn next(&self, limit: Exposure) -> Exposure {
        self.next.min(limit)
    }

    /// Takes what a row with the exposure `row` tells, and chooses the next exposure, of at most `limit`.
    // All products are below 2^16 * 2^13 * 7 < 2^32.
    pub fn take(&mut self, row: Exposure, brightness: Brightness, limit: Exposure) {
        let (row, next) = (u32::from(row.us()), u32::from(self.next.us()));
        let wanted = match brightness {
            Brightness::Height { height, room } => {
                let (height, room) = (u32::from(height), u32::from(room));
                // The height in a row that has the next exposure.
                let expected = height.saturating_mul(next) / row.max(1);
                let percent = expected.saturating_mul(100) / room.max(1);
                if (LEAST_PERCENT..=MOST_PERCENT).contains(&percent) {
                    return;
                }
                let target = room.saturating_mul(TARGET_PERCENT) / 100;
                row.saturating_mul(target) / height.max(1)
            }
            // Rows that were exposed before the last change say nothing new.
            Brightness::Saturated { pixels } if pixels > FEW_PIXELS => {
                next.min(row / AFTER_SATURATED)
            }
            Brightness::Saturated { .. } => next.min(row / AFTER_FEW_SATURATED),
            Brightness::Nothing => next.max(row.saturating_mul(AFTER_NOTHING)),
            Brightness::Unknown => return,
        };
        self.next = Exposure::nearest_to_us(wanted).min(limit);
    }
}

impl Default for AutoExposure {
    fn default() -> Self {
        Self::new()
    }
}
