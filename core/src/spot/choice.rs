//! Which of several spots on a row is measured, by the option `peak`.
//!
//! The front surface of glass and its back, or a target and its mirror image, show two spots. If the laser's
//! own is always the first or the last on the row, its height does not matter.
//!
//! The choice narrows the row until the chosen spot is the strongest one in it. Search, estimator and check
//! then work on the narrowed row, so the other spots are neither a fault nor a flaw.

use core::ops::Range;

use crate::base::named;
use crate::row::Row;
use crate::spot;
use crate::spot::candidates::{Candidate, Candidates};

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

/// How far a spot reaches from its centre, in blocks of the search: 6 to 12 widths.
const REACH: usize = 8;
/// Spots below a tenth of the highest one do not count: halos make them.
const LEAST_SHARE: u32 = 10;

impl SpotChoice {
    /// The part of `whole` in which the chosen spot is the strongest, and no other has a third of its height.
    /// `whole` is a part of the light range, in words, and `row` its row. All of it if the spots are too
    /// close to be parted. `None` if no spot is found.
    pub(crate) fn part_with_spot(
        self,
        row: &Row<'_>,
        whole: &Range<usize>,
    ) -> Option<Range<usize>> {
        let mut spots = Candidates::new();
        spot::list_all(row, &mut spots)?;
        let highest = spots.iter().map(|it| it.height).max()?;
        let is_high = |it: &&Candidate| u32::from(it.height) * LEAST_SHARE >= highest.into();
        let high = spots.iter().filter(is_high);
        let chosen = match self {
            Self::Last => high.max_by_key(|it| it.peak.middle),
            Self::Strongest | Self::First => high.min_by_key(|it| it.peak.middle),
        }?;
        let matters = |it: &&Candidate| {
            it.is_apart(chosen) && u32::from(it.height) * 3 > chosen.height.into()
        };
        let here = chosen.peak.middle;
        let beside = || spots.iter().filter(matters).map(|it| it.peak.middle);
        let left = beside().filter(|&it| it < here).max();
        let right = beside().filter(|&it| it > here).min();
        let reach = chosen.peak.pixels().saturating_mul(REACH);
        let middle = |other: usize| {
            let middle = other.midpoint(here);
            (middle.abs_diff(here) >= reach).then_some(middle)
        };
        let start = left.map_or(Some(0), middle);
        let end = right.map_or(Some(whole.len()), middle);
        let (Some(start), Some(end)) = (start, end) else {
            return Some(whole.clone());
        };
        Some(whole.start.saturating_add(start)..whole.start.saturating_add(end))
    }
}
