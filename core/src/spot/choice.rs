//! Which of several spots on a row is measured, by the option `peak`.
//!
//! The front surface of glass and its back, or a target and its mirror image, show two spots. If the laser's
//! own is always the first or the last on the row, its height does not matter.
//!
//! The choice narrows the row until the chosen spot is the strongest one in it. Search, estimator and check
//! then work on the narrowed row, so the other spots are neither a fault nor a flaw.

use core::ops::Range;

use crate::base::{Counts, Fault, Pixels, WorkBudget, named};
use crate::row::{Blocks, Geometry};
use crate::spot::{self, Coarse, Spot};

/// Which spot is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpotChoice {
    /// The highest. Two of similar height are a fault.
    #[default]
    Strongest,
    /// The one with the lowest place.
    First,
    /// The one with the highest place.
    Last,
}

named! { SpotChoice { Strongest: "strongest", First: "first", Last: "last" } }

/// The most searches for all spots of a frame's first row. Each takes as long as the search of a first row.
const SEARCHES: usize = 6;
/// How far a spot reaches from its centre, in blocks of the search: 4 to 16 widths. A gaussian has less than
/// a thousandth of its height left there.
const REACH: usize = 8;
/// Spots below a tenth of the first spot's height do not count: halos make them.
const LEAST_SHARE: i32 = 10;
/// The least response of a spot in standard deviations of its noise. A spot that is bright enough for a
/// centre has that much, and noise does not.
const LEAST_RESPONSE: u64 = 10;

impl SpotChoice {
    /// The part of `whole` in which the chosen spot is the strongest, and no other has a third of its height.
    /// `whole` is a part of the light range, in words. All of it if the spots are too close to be parted.
    /// `None` if no spot is found.
    pub(crate) fn part_with_spot(
        self,
        words: &[u16],
        geometry: &Geometry,
        whole: &Range<usize>,
        blocks: &mut Blocks,
        coarse: &mut Coarse,
    ) -> Option<Range<usize>> {
        let mut search = Search {
            words,
            geometry,
            blocks,
            coarse,
            level: None,
            left: SEARCHES,
        };
        // From the strongest spot to the next one on the wanted side, until there is none.
        let mut part = whole.clone();
        let mut chosen: Option<(Lump, Range<usize>)> = None;
        let mut least = 0;
        while let Some(found) = search.look(&part) {
            part = match found {
                Found::One(spot) if spot.height >= least && self.is_clear(&spot, &part, whole) => {
                    least = least.max(spot.height / LEAST_SHARE);
                    let outside = self.outside(&part, spot.centre, spot.reach);
                    chosen = Some((spot, part));
                    outside
                }
                Found::One(_) => break,
                Found::Two(one, other) => self.outside(&part, one.midpoint(other), 0),
            };
        }
        let (spot, mut part) = chosen?;
        // The others on the other side are left out one by one.
        let back = match self {
            Self::Last => Self::First,
            Self::Strongest | Self::First => Self::Last,
        };
        while let Some(found) = search.look(&back.outside(&part, spot.centre, spot.reach)) {
            let other = match found {
                Found::One(other) if other.height > spot.height / 3 => other.centre,
                Found::One(_) => break,
                Found::Two(one, other)
                    if one.abs_diff(spot.centre) < other.abs_diff(spot.centre) =>
                {
                    one
                }
                Found::Two(_, other) => other,
            };
            let narrower = self.outside(&part, spot.centre.midpoint(other), 0);
            if !self.is_clear(&spot, &narrower, whole) {
                break;
            }
            part = narrower;
        }
        Some(part)
    }

    /// The part beyond `reach` from a place, on the wanted side.
    fn outside(self, part: &Range<usize>, place: usize, reach: usize) -> Range<usize> {
        match self {
            Self::Last => place.saturating_add(reach).max(part.start).min(part.end)..part.end,
            Self::Strongest | Self::First => {
                part.start..place.saturating_sub(reach).min(part.end).max(part.start)
            }
        }
    }

    /// Whether a spot does not reach where the row was narrowed.
    fn is_clear(self, spot: &Lump, part: &Range<usize>, whole: &Range<usize>) -> bool {
        let end = match self {
            Self::Last => part.start,
            Self::Strongest | Self::First => part.end,
        };
        part == whole || spot.centre.abs_diff(end) >= spot.reach
    }
}

/// A spot as the search sees it.
struct Lump {
    /// Its middle, as a place of the words.
    centre: usize,
    height: i32,
    /// The pixels from its centre to where nothing is left of it.
    reach: usize,
}

enum Found {
    One(Lump),
    /// The places of two spots of similar height.
    Two(usize, usize),
}

struct Search<'a> {
    words: &'a [u16],
    geometry: &'a Geometry,
    blocks: &'a mut Blocks,
    coarse: &'a mut Coarse,
    /// The background's level where the first spot was found. That of a short part may be off.
    level: Option<Counts>,
    left: usize,
}

impl Search<'_> {
    /// Searches a part of the row. `None` if it has no spot, or if no search is left.
    fn look(&mut self, part: &Range<usize>) -> Option<Found> {
        self.left = self.left.checked_sub(1)?;
        let row = (self.geometry).part_and_blocks(self.words, part, self.blocks);
        let row = row.ok()?;
        let place = |pixel: usize| part.start.saturating_add(pixel);
        match spot::find_in(&row, row.blocks(), self.coarse, &mut WorkBudget::of_row()) {
            Ok(spot) => {
                let level = *self.level.get_or_insert(spot.background.level);
                let under = spot.background.level.to_bits();
                let top = spot.height.to_bits().saturating_add(under);
                let height = top.saturating_sub(level.to_bits()).max(0);
                stands_out(height, &spot).then(|| {
                    Found::One(Lump {
                        centre: place(spot.centre),
                        height,
                        reach: spot.block().saturating_mul(REACH),
                    })
                })
            }
            Err(Fault::TwoSpots { centre, other }) => {
                Some(Found::Two(place(pixel(centre)), place(pixel(other))))
            }
            _ => None,
        }
    }
}

/// Whether a spot of this height, in the bits of [`Counts`], is more than noise. The kernel [1 2 1] of the
/// search adds the counts of 4 blocks, and the variances of 1 + 4 + 1 blocks.
fn stands_out(height: i32, spot: &Spot) -> bool {
    // Below 2^62.
    let square =
        |bits: i32| u64::from(bits.unsigned_abs()).saturating_mul(bits.unsigned_abs().into());
    let response = (square(height).saturating_mul(16)).saturating_mul(spot.block() as u64);
    let noise = square(spot.background.noise.to_bits()).saturating_mul(6);
    response >= noise.saturating_mul(LEAST_RESPONSE * LEAST_RESPONSE)
}

/// The pixel below a place. Below zero it is zero.
fn pixel(place: Pixels) -> usize {
    usize::try_from(place.to_bits() >> Pixels::FRACTION).unwrap_or(0)
}
