//! Auto exposure: rows go in, and the next exposure comes out.
//!
//! Each row tells how bright the spot was, and how long the laser was on in this row. The next exposure
//! brings the spot to [`TARGET_PERCENT`] of its room: from the background to saturation. A row arrives some
//! rows after its exposure was chosen. This delay causes no swinging, because each row is compared with its
//! own exposure, and not with the latest one. The exposure stays while the spot is between [`LEAST_PERCENT`]
//! and [`MOST_PERCENT`], so noise and speckle do not change it from row to row.
//!
//! A flat top tells where the sensor saturates, if that is below the level that its geometry states. From
//! then on the room ends there.

use crate::base::{Counts, Exposure, Fault};

/// The height at which auto exposure aims, in percent of the room. A TCD1304DG may saturate at 75 % of the
/// converter's range (0.45 V of 0.6 V, data sheet). The target is below that.
pub const TARGET_PERCENT: u32 = 70;
/// A spot that is lower than this, in percent of the room, gets a longer exposure.
pub const LEAST_PERCENT: u32 = 50;
/// A spot that is higher than this, in percent of the room, gets a shorter exposure.
pub const MOST_PERCENT: u32 = 85;
/// How much longer the exposure becomes after a row that shows no spot. A spot that is not found is below
/// some 25 counts in a dark room, so after this step the spot is below 2500 counts.
const AFTER_NO_SPOT: u32 = 100;
/// How much shorter the exposure becomes after a row that is saturated. Two steps go from the longest
/// exposure nearly to the shortest, and a spot that was only just saturated is still found after one step: it
/// then has a 32nd of the range, 120 counts.
const AFTER_SATURATED: u32 = 32;
/// How much shorter the exposure becomes if at most [`FEW_PIXELS`] pixels are saturated. The spot is then not
/// much too bright.
const AFTER_FEW_SATURATED: u32 = 4;
/// A spot with a sigma of 8.6 pixels has so many saturated pixels if its light is six times what fits.
const FEW_PIXELS: u16 = 32;
/// After so many rows without a spot, one row gets the longest exposure: whatever hides the spot in a shorter
/// one, as a lamp that saturates the sensor, may leave it visible there.
const LOST_ROWS: u16 = 32;
/// A flat top of so many pixels fills a block, whose mean is then the saturation.
const WHOLE_TOP: u16 = 8;
/// The room that saturation leaves grows again by a count after so many rows with a spot: a top may have
/// looked flat by chance.
const ROWS_A_COUNT: u16 = 64;

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
        /// The room, as far as the highest pixels reach. In whole counts.
        room: u16,
    },
    /// There is no spot.
    NoSpot,
    /// The row has a fault that does not depend on the exposure.
    NotTheLight,
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
    /// on the row. `highest` is the height of the row's highest pixels above the background.
    pub fn of_fault(fault: &Fault, saturated: u16, highest: Counts, room: Counts) -> Self {
        let cut = |pixels| Self::Saturated {
            pixels,
            room: whole(if pixels < WHOLE_TOP {
                room
            } else {
                highest.min(room)
            }),
        };
        match *fault {
            Fault::Saturated { pixels } => cut(pixels.max(saturated)),
            _ if saturated > 0 => cut(saturated),
            Fault::TooDim { amplitude, .. } => Self::of_spot(amplitude, room),
            Fault::NoSpot { .. } | Fault::FewSlits { found: 0, .. } => Self::NoSpot,
            Fault::FewSlits { .. } => Self::of_spot(highest, room),
            _ => Self::NotTheLight,
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
    /// The next row has the longest exposure instead.
    probes: bool,
    /// Rows since the last one with a spot.
    lost: u16,
    /// The room that a saturated row left, in counts: a sensor may saturate below the level that is stated.
    ceiling: u16,
    /// Rows with a spot since the room grew.
    seen: u16,
}

impl AutoExposure {
    /// Begins with the longest exposure.
    pub const fn new() -> Self {
        Self {
            next: Exposure::LONGEST,
            probes: false,
            lost: 0,
            ceiling: u16::MAX,
            seen: 0,
        }
    }

    /// The exposure to use from now on, of at most `limit`.
    pub fn next(&self, limit: Exposure) -> Exposure {
        if self.probes {
            return limit;
        }
        self.next.min(limit)
    }

    /// Takes what a row with the exposure `row` tells, and chooses the next exposure, of at most `limit`.
    pub fn follow_row(&mut self, row: Exposure, brightness: Brightness, limit: Exposure) {
        self.count(&brightness);
        self.choose(row, brightness, limit);
    }

    /// Counts rows with and without a spot, and learns where the sensor saturates.
    fn count(&mut self, brightness: &Brightness) {
        self.probes = false;
        if let Brightness::Height { .. } = brightness {
            self.lost = 0;
            self.seen = self.seen.saturating_add(1);
            if self.seen >= ROWS_A_COUNT {
                self.seen = 0;
                self.ceiling = self.ceiling.saturating_add(1);
            }
            return;
        }
        if let Brightness::Saturated { room, .. } = *brightness {
            self.ceiling = self.ceiling.min(room);
        }
        self.lost = self.lost.saturating_add(1);
        if self.lost >= LOST_ROWS {
            self.lost = 0;
            self.probes = true;
        }
    }

    /// Chooses the next exposure.
    // A height is below 2^16, an exposure at most 5600, and the next exposure at most 560 times the row's. So
    // height * next and row * target are below 2^29, and expected * 100 is below 2^32.
    fn choose(&mut self, row: Exposure, brightness: Brightness, limit: Exposure) {
        let (row, next) = (u32::from(row.us()), u32::from(self.next.us()));
        let wanted = match brightness {
            Brightness::Height { height, room } => {
                let (height, room) = (u32::from(height), u32::from(room.min(self.ceiling)));
                // The height in a row that has the next exposure.
                let expected = height.saturating_mul(next) / row.max(1);
                let percent = expected.saturating_mul(100) / room.max(1);
                if (LEAST_PERCENT..=MOST_PERCENT).contains(&percent) {
                    return;
                }
                let target = room.saturating_mul(TARGET_PERCENT) / 100;
                row.saturating_mul(target) / height.max(1)
            }
            // No exposure is shorter. A row with the longest one may show more: see [`LOST_ROWS`].
            Brightness::Saturated { .. } if row <= Exposure::SHORTEST.us().into() => return,
            // Rows that were exposed before the last change say nothing new.
            Brightness::Saturated { pixels, .. } if pixels > FEW_PIXELS => {
                next.min(row / AFTER_SATURATED)
            }
            Brightness::Saturated { .. } => next.min(row / AFTER_FEW_SATURATED),
            Brightness::NoSpot => next.max(row.saturating_mul(AFTER_NO_SPOT)),
            Brightness::NotTheLight => return,
        };
        self.next = Exposure::nearest_to_us(wanted).min(limit);
    }
}

impl Default for AutoExposure {
    fn default() -> Self {
        Self::new()
    }
}
