//! The pixels in which the spot is searched, by the option `region`.
//!
//! A lamp, a window or a reflection that always stands at the same place is left out of the search. A spot
//! that the region's end cuts is treated as one that the sensor's edge cuts.

use core::ops::Range;

use crate::row::MAX_PIXELS;

/// Some neighbouring pixels of the light range, from the first to the last, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    first: u16,
    last: u16,
}

impl Default for Region {
    fn default() -> Self {
        Self::ALL
    }
}

impl Region {
    /// All pixels, of any sensor.
    pub const ALL: Self = Self {
        first: 0,
        last: crate::base::numeric::to_u16(MAX_PIXELS - 1),
    };

    /// The fewest pixels: twice what the search needs, so that the spot has a background beside it.
    pub const FEWEST: usize = 2 * crate::spot::MIN_PIXELS;

    /// The pixels from `first` to `last`. `None` with fewer than [`Region::FEWEST`] pixels, or beyond the
    /// longest row.
    pub const fn new(first: u16, last: u16) -> Option<Self> {
        let region = Self { first, last };
        let is_long_enough = first as usize + Self::FEWEST <= last as usize + 1;
        if is_long_enough && last <= Self::ALL.last {
            Some(region)
        } else {
            None
        }
    }

    /// The first pixel.
    pub const fn first(self) -> u16 {
        self.first
    }

    /// The last pixel.
    pub const fn last(self) -> u16 {
        self.last
    }

    /// The region's part of a range of words, whose first word is pixel 0.
    pub fn part_of(self, light: &Range<usize>) -> Range<usize> {
        let place = |pixel: usize| light.start.saturating_add(pixel).min(light.end);
        place(self.first.into())..place(usize::from(self.last).saturating_add(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_is_a_part_of_the_row() {
        let part = |first, last| Region::new(first, last).map(|it| it.part_of(&(36..3684)));
        assert_eq!(part(0, 63), Some(36..100));
        assert_eq!(part(100, 3647), Some(136..3684));
        assert_eq!(part(3600, 4095), Some(3636..3684));
        assert_eq!(part(4000, 4095), Some(3684..3684));
        assert_eq!(Region::ALL.part_of(&(36..3684)), 36..3684);
        for (first, last) in [(0, 62), (5, 4), (4095, 0), (0, 4096), (u16::MAX, u16::MAX)] {
            assert_eq!(Region::new(first, last), None, "{first} {last}");
        }
    }
}
