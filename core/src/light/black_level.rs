//! The black level: the counts of an unlit pixel, found in one of the paper's three ways (section 3).
//!
//! The centroid subtracts the black level, and its height counts from there. The other estimators fit the
//! level under the spot or cancel it exactly: the black level does not change one bit of their results. Full
//! scale less the black level is the largest height that can be measured:
//! [`Geometry::height_limit`](crate::row::Geometry::height_limit). The black level also shows stray light and
//! drift to a person.

use core::ops::Range;

use crate::base::{Counts, MAX_ROWS, numeric};
use crate::row::{Background, LARGEST_COUNT, Light, MAX_PIXELS, Row};

/// How the black level is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlackLevel {
    /// A number, measured once at calibration.
    Fixed(Counts),
    /// The mean of each row's shielded pixels. Ambient light is then light above the black level.
    Shielded,
    /// The mean of each row's pixels outside a window around the centroid. Ambient light is then part of the
    /// black level.
    Frame,
}

/// Half of the window around the centroid that [`BlackLevel::Frame`] leaves out, in pixels. The paper leaves
/// out 128 pixels in all.
pub const HALF_WINDOW: usize = 64;

/// The sum and the number of the black pixels of a row, or of a frame's rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlackPixels {
    sum: u32,
    pixels: u32,
}

impl BlackPixels {
    /// Adds the row's black pixels, found in the given way. `background` is the row's own, from the search
    /// for a spot. A row without a background or without a centroid adds nothing to [`BlackLevel::Frame`].
    pub fn add(&mut self, how: BlackLevel, row: &Row<'_>, background: Option<Background>) {
        match (how, background) {
            (BlackLevel::Fixed(_), _) | (BlackLevel::Frame, None) => {}
            (BlackLevel::Shielded, _) => self.add_pixels(row.shielded()),
            (BlackLevel::Frame, Some(background)) => {
                if let Some(centroid) = centroid(row.light(), background) {
                    let end = centroid.saturating_add(HALF_WINDOW);
                    self.add_outside(row, centroid.saturating_sub(HALF_WINDOW)..end);
                }
            }
        }
    }

    /// Adds the pixels outside of a part of the row that may be lit, for [`BlackLevel::Frame`].
    pub(crate) fn add_outside(&mut self, row: &Row<'_>, lit: Range<usize>) {
        let (left, rest) = row.light().split(lit.start);
        let (_, right) = rest.split(lit.end.saturating_sub(lit.start));
        self.add_pixels(left);
        self.add_pixels(right);
    }

    /// Adds the sum and the number of other black pixels to these.
    pub fn merge(&mut self, other: Self) {
        self.sum = self.sum.saturating_add(other.sum);
        self.pixels = self.pixels.saturating_add(other.pixels);
    }

    fn add_pixels(&mut self, pixels: Light<'_>) {
        let counts = pixels.iter().map(u32::from);
        self.sum = self.sum.saturating_add(counts.fold(0, numeric::add_u32));
        self.pixels = self.pixels.saturating_add(numeric::to_u32(pixels.len()));
    }

    /// The black level. `None` if it is not fixed and no pixel was added.
    pub fn level(&self, how: BlackLevel) -> Option<Counts> {
        match how {
            BlackLevel::Fixed(level) => Some(level),
            BlackLevel::Shielded | BlackLevel::Frame => {
                // The fraction apart from the whole counts: a division of 64 bits takes the chip 45
                // instructions. There are at most 2^18 pixels.
                let whole = self.sum.checked_div(self.pixels)?;
                let rest = self.sum.checked_rem(self.pixels)?;
                let part = rest
                    .saturating_mul(1 << Counts::FRACTION)
                    .checked_div(self.pixels)?;
                let bits = whole
                    .saturating_mul(1 << Counts::FRACTION)
                    .saturating_add(part);
                Some(Counts::from_bits(i32::try_from(bits).unwrap_or(i32::MAX)))
            }
        }
    }
}

/// The mean of a row's shielded pixels, if there are any.
#[inline(never)]
pub fn of_shielded(row: &Row<'_>) -> Option<Counts> {
    let mut black = BlackPixels::default();
    black.add(BlackLevel::Shielded, row, None);
    black.level(BlackLevel::Shielded)
}

// A frame's rows of the largest counts fit the sum of black pixels.
const _: () =
    assert!(LARGEST_COUNT as u64 * MAX_PIXELS as u64 * MAX_ROWS as u64 <= u32::MAX as u64);

/// Finds the centroid of a row, eq. (2), to a pixel. Black pixels would outweigh a spot by their number, so
/// only counts more than four standard deviations above the background are summed. `None` if no count is that
/// high.
pub fn centroid(light: Light<'_>, background: Background) -> Option<usize> {
    let four_deviations = background.noise.to_bits().saturating_mul(4);
    let threshold = four_deviations.saturating_add(background.level.to_bits()) >> Counts::FRACTION;
    let (mut weight, mut moment) = (0u64, 0u64);
    for (place, count) in (0..numeric::to_u32(MAX_PIXELS)).zip(light.iter()) {
        // At most MOST_ABOVE each, for which the sums are proven.
        let above = i32::from(count).saturating_sub(threshold).max(0);
        let above = u64::from(above.unsigned_abs());
        weight = numeric::add_u64(weight, above);
        moment = numeric::add_u64(moment, above * u64::from(place));
    }
    usize::try_from(moment.checked_div(weight)?).ok()
}

/// The most that a count can be above a threshold: both are the whole part of a Q24.8 number.
const MOST_ABOVE: u64 = 1 << (32 - Counts::FRACTION);

// Weight and moment fit, because places are below MAX_PIXELS.
const _: () =
    assert!(MOST_ABOVE as u128 * MAX_PIXELS as u128 * MAX_PIXELS as u128 <= u64::MAX as u128);

#[cfg(test)]
mod tests {
    use super::*;

    fn background(level: f32, noise: f32) -> Background {
        let [level, noise] = [level, noise].map(Counts::from_f32);
        Background { level, noise }
    }

    #[test]
    fn the_level_is_fixed_or_the_mean_of_shielded_or_of_unlit_pixels() {
        // Black of 100 and 101 in turn, mean 100.5; a triangle of light around pixel 300.
        let light: [u16; 1000] = core::array::from_fn(|i| {
            100 + (i % 2) as u16 + 60u16.saturating_sub(i.abs_diff(300) as u16) * 20
        });
        let row = Row::new(&light, &[90, 92, 94], 4095).expect("a row");
        let background = background(100.5, 1.0);
        assert_eq!(centroid((&light).into(), background), Some(300));
        for (how, level) in [
            (BlackLevel::Fixed(Counts::from_int(77)), 77.0),
            (BlackLevel::Shielded, 92.0),
            (BlackLevel::Frame, 100.5),
        ] {
            let mut black = BlackPixels::default();
            black.add(how, &row, Some(background));
            assert_eq!(black.level(how), Some(Counts::from_f32(level)));
        }
    }

    #[test]
    fn without_black_pixels_there_is_no_level() {
        for how in [BlackLevel::Shielded, BlackLevel::Frame] {
            assert_eq!(BlackPixels::default().level(how), None);
        }
        let found = centroid((&[4095; 20]).into(), background(4000.0, 100.0));
        assert_eq!(found, None);
    }
}
