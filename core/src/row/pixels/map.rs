//! The map of a sensor's pixels: an offset and a gain for each, by which rows are corrected.
//!
//! A correction changes only the pixels near the spot that estimator and check read. It costs about 14
//! instructions a pixel, so 1700 for a spot of 9 pixels' width.

use core::ops::Range;

use crate::base::{Counts, Pixels, numeric};
use crate::row::pixels::PixelErrors;
use crate::row::{Background, Geometry, LARGEST_COUNT};

/// The most pixels of a map. With a header and a checksum it then fits 16 KB.
pub const MAX_MAP_PIXELS: usize = 3648;
/// Bits after the binary point of an offset: steps of 1/16 count.
pub(super) const OFFSET_FRACTION: u32 = 4;
/// Bits after the binary point of a gain.
pub(super) const GAIN_FRACTION: u32 = 15;
/// The largest offset that an entry holds, either sign: 1024 counts.
pub(super) const LARGEST_OFFSET: i16 = 1 << 14;
/// The largest gain that an entry holds, either sign: one half. Responses from 0.67 to 2 of the mean fit.
pub(super) const LARGEST_GAIN: i16 = 1 << 14;
/// How far estimator and check read from a centre, in widths. The check reads furthest: its `REACH`.
const REACH: i32 = 6;
/// Pixels beyond [`REACH`] widths: the check reads four more, and the spot may have moved since the row
/// before.
const MARGIN: usize = 6;
/// The least noise of a row, in the bits of [`Counts`]: that of rounding to a count, as the search says it.
const ROUNDING: f32 = 74.0;

/// How one pixel differs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Entry {
    /// The pixel's unlit count less the mean of all pixels, Q11.4, at most 1024 counts either way.
    offset_q4: i16,
    /// The pixel's light is multiplied by one plus this number, Q0.15, at most one half either way.
    gain_q15: i16,
}

impl Entry {
    /// An entry. `None` if a value is beyond what an entry may hold.
    pub fn new(offset_q4: i16, gain_q15: i16) -> Option<Self> {
        let is_within = offset_q4.unsigned_abs() <= LARGEST_OFFSET.unsigned_abs()
            && gain_q15.unsigned_abs() <= LARGEST_GAIN.unsigned_abs();
        is_within.then_some(Self {
            offset_q4,
            gain_q15,
        })
    }

    /// The offset in sixteenths of a count.
    pub const fn offset_q4(self) -> i16 {
        self.offset_q4
    }

    /// The gain less one, Q0.15.
    pub const fn gain_q15(self) -> i16 {
        self.gain_q15
    }
}

/// What a map corrects in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Correction {
    /// The offset and the gain of each pixel.
    OffsetAndGain,
    /// The gain alone: the offsets were subtracted from the row with the ambient light.
    Gain,
}

/// A map of a sensor's light pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelMap {
    pub(super) entries: [Entry; MAX_MAP_PIXELS],
    /// The number of entries in use. Zero: there is no map.
    pub(super) pixels: u16,
    pub(super) summary: MapSummary,
}

/// What a map says of the sensor, apart from its entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapSummary {
    /// How far pixels still differ after the correction.
    pub errors: PixelErrors,
    /// Standard deviation of the offsets, as the search's estimate of noise sees them.
    pub pattern: Counts,
    /// Pixels that differ by more than an entry holds. They have the nearest entry.
    pub outside: u16,
}

impl MapSummary {
    pub(super) const NONE: Self = Self {
        errors: PixelErrors {
            response_q16: 0,
            offset: Counts::from_bits(0),
        },
        pattern: Counts::from_bits(0),
        outside: 0,
    };
}

impl PixelMap {
    /// The place for a map, without one. All bytes are zero.
    pub const EMPTY: Self = Self {
        entries: [Entry {
            offset_q4: 0,
            gain_q15: 0,
        }; MAX_MAP_PIXELS],
        pixels: 0,
        summary: MapSummary::NONE,
    };

    /// Whether there is a map.
    pub const fn is_whole(&self) -> bool {
        self.pixels > 0
    }

    /// Removes the map.
    pub fn clear(&mut self) {
        self.pixels = 0;
    }

    /// Sets the entry of a pixel. The map is not whole from then on.
    pub fn set_entry(&mut self, pixel: usize, entry: Entry) {
        self.clear();
        if let Some(place) = self.entries.get_mut(pixel) {
            *place = entry;
        }
    }

    /// Makes the map whole: all entries of `pixels` pixels are set.
    pub fn complete(&mut self, pixels: u16, summary: MapSummary) {
        self.pixels = pixels;
        self.summary = summary;
    }

    /// The number of pixels. Zero: there is no map.
    pub const fn pixels(&self) -> u16 {
        self.pixels
    }

    /// Whether this is the map of a sensor with that many light pixels.
    pub fn fits(&self, geometry: &Geometry) -> bool {
        self.is_whole() && geometry.light.len() == usize::from(self.pixels)
    }

    /// How far pixels still differ after the correction.
    pub const fn errors(&self) -> PixelErrors {
        self.summary.errors
    }

    /// What the map says of the sensor, apart from its entries.
    pub const fn summary(&self) -> &MapSummary {
        &self.summary
    }

    /// The entries of the light pixels.
    pub fn entries(&self) -> &[Entry] {
        (self.entries.get(..usize::from(self.pixels))).unwrap_or_default()
    }

    /// Corrects the light pixels of `window` in place: subtracts the offset, and multiplies the light above
    /// `black` by the gain. Rounds to whole counts. `words` are those of the light pixels.
    ///
    /// A saturated pixel stays as it is, and no other pixel becomes one. Results below zero become zero. Does
    /// nothing if the map is of another number of pixels.
    pub fn correct(
        &self,
        words: &mut [u16],
        window: Range<usize>,
        black: Counts,
        geometry: &Geometry,
        correction: Correction,
    ) {
        if words.len() != usize::from(self.pixels) {
            return;
        }
        let (saturation, inverted) = (geometry.saturated_from(), geometry.inverted());
        let highest = i32::from(saturation.saturating_sub(1));
        const LARGEST: i32 = (LARGEST_COUNT as i32) << OFFSET_FRACTION;
        const HALF: i32 = 1 << (OFFSET_FRACTION - 1);
        let offsets = match correction {
            Correction::OffsetAndGain => 1,
            Correction::Gain => 0,
        };
        let black = (black.to_bits() >> (Counts::FRACTION - OFFSET_FRACTION)).clamp(0, LARGEST);
        // A spot near the sensor's edge has a window that reaches beyond the row.
        let window = window.start..window.end.min(words.len());
        let (Some(words), Some(entries)) =
            (words.get_mut(window.clone()), self.entries.get(window))
        else {
            return;
        };
        for (word, entry) in words.iter_mut().zip(entries) {
            let count = *word ^ inverted;
            if count >= saturation {
                continue;
            }
            // A count is below 2^12, the black level at most 2^12, an offset at most 2^10: together below
            // 2^17 in Q4. Times a gain of at most 2^14 that is below 2^31, because 65520 + 16384 = 81904.
            let offset = i32::from(entry.offset_q4) * offsets;
            let above = i32::from(count) * (1 << OFFSET_FRACTION) - black - offset;
            let change = numeric::mul_i32(above, i32::from(entry.gain_q15)) >> GAIN_FRACTION;
            let corrected = numeric::add_i32(above, change);
            let rounded = numeric::add_i32(corrected, black + HALF) >> OFFSET_FRACTION;
            *word = numeric::i32_to_u16(rounded.max(0).min(highest)) ^ inverted;
        }
    }

    /// The noise of a row without the offsets' share. The search estimates noise from neighbouring pixels of
    /// the uncorrected row, so its estimate contains the offsets.
    pub fn background_of(&self, background: Background) -> Background {
        let bits = |counts: Counts| counts.to_bits() as f32;
        let (noise, pattern) = (bits(background.noise), bits(self.summary.pattern));
        let squared = (noise * noise - pattern * pattern).max(ROUNDING * ROUNDING);
        Background {
            // Not above the noise that it was, which is at least that of rounding.
            noise: Counts::from_bits(numeric::whole_i32(dual_mac::square_root(squared))),
            ..background
        }
    }
}

/// The light pixels that estimator and check may read of a spot. `centre` is its pixel, and its width is
/// about 2^`block_log2` pixels. `width` is that of the row before; without one, the search knows the width to
/// a factor of two.
pub fn window(centre: usize, block_log2: u32, width: Option<Pixels>) -> Range<usize> {
    let block = 1usize << block_log2.min(7);
    let reach = match width {
        // At most 2^15 pixels, so this saturates nothing.
        Some(width) => {
            let reach = width.to_bits().max(0).saturating_mul(REACH) >> Pixels::FRACTION;
            (reach.cast_unsigned() as usize).saturating_add(block)
        }
        None => block * 2 * REACH as usize,
    };
    let reach = reach.saturating_add(MARGIN);
    centre.saturating_sub(reach)..centre.saturating_add(reach)
}

#[cfg(test)]
mod tests {
    use super::Correction::{Gain, OffsetAndGain};
    use super::*;
    use crate::row::Polarity;
    use crate::tests::tcd1304dg;

    fn map(entries: &[(i16, i16)]) -> PixelMap {
        let mut map = PixelMap::EMPTY;
        for (place, &(offset, gain)) in map.entries.iter_mut().zip(entries) {
            *place = Entry::new(offset, gain).expect("an entry");
        }
        map.pixels = entries.len() as u16;
        map
    }

    /// Corrects counts above a black level of 300, in words that rise with light and in words that fall.
    fn assert_corrected<const N: usize>(
        map: &PixelMap,
        counts: [u16; N],
        (window, saturation, correction): (Range<usize>, u16, Correction),
        expected: [u16; N],
    ) {
        for polarity in [Polarity::Rising, Polarity::Falling] {
            let geometry = Geometry {
                polarity,
                saturation,
                ..tcd1304dg()
            };
            let mut words = counts.map(|count| count ^ geometry.inverted());
            let black = Counts::from_int(300);
            map.correct(&mut words, window.clone(), black, &geometry, correction);
            assert_eq!(words.map(|word| word ^ geometry.inverted()), expected);
        }
    }

    #[test]
    fn offsets_are_subtracted_and_light_is_scaled() {
        // 10 counts less; a quarter more light; both; unchanged.
        let map = map(&[(160, 0), (0, 1 << 13), (-160, -(1 << 13)), (0, 0)]);
        let corrected = [300, 800, 600, 123];
        assert_corrected(
            &map,
            [310, 700, 690, 123],
            (0..4, 4095, OffsetAndGain),
            corrected,
        );
        // A row from which the offsets were subtracted already.
        assert_corrected(&map, [300, 700, 700, 123], (0..4, 4095, Gain), corrected);
    }

    #[test]
    fn saturated_pixels_stay_and_no_other_becomes_one() {
        let map = map(&[(0, 1 << 14), (0, 1 << 14), (1 << 14, 0), (0, -(1 << 14))]);
        for (counts, saturation, corrected) in [
            ([4095, 4094, 5, 4095], 4095, [4095, 4094, 0, 4095]),
            ([2500, 2400, 5, 4095], 2500, [2500, 2499, 0, 4095]),
        ] {
            assert_corrected(&map, counts, (0..4, saturation, OffsetAndGain), corrected);
        }
    }

    #[test]
    fn only_the_window_is_corrected_and_only_with_the_right_map() {
        let map = map(&[(160, 0); 4]);
        let how = || (1..3, 4095, OffsetAndGain);
        assert_corrected(&map, [400; 4], how(), [400, 390, 390, 400]);
        assert_corrected(&map, [400; 5], how(), [400; 5]);
    }

    #[test]
    fn entries_beyond_their_range_are_refused() {
        assert!(Entry::new(1 << 14, -(1 << 14)).is_some());
        for (offset, gain) in [((1 << 14) + 1, 0), (0, -(1 << 14) - 1), (i16::MIN, 0)] {
            assert_eq!(Entry::new(offset, gain), None);
        }
    }

    #[test]
    fn the_noise_of_a_row_loses_the_share_of_the_offsets() {
        let mut map = map(&[(0, 0)]);
        map.summary.pattern = Counts::from_int(3);
        let level = Counts::from_int(300);
        for (noise, bits) in [(5, 4 << Counts::FRACTION), (3, 74)] {
            let noise = Counts::from_int(noise);
            let expected = Background {
                level,
                noise: Counts::from_bits(bits),
            };
            assert_eq!(map.background_of(Background { level, noise }), expected);
        }
    }
}
