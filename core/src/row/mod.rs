//! A row: one read-out of the sensor, in counts. The sensor's geometry says which word is which pixel, and
//! how a word becomes a count.

pub mod front_end;
mod light_pixels;
pub mod pixels;
pub mod sensor_heads;

use core::ops::Range;

use dual_mac::Pair;
use serde::{Deserialize, Serialize};

use crate::base::{Counts, Electrons, Pixels};

pub use light_pixels::{Extremes, Light};

/// The largest count of a row: that of a 12-bit converter. The arithmetic of the core is proven for counts up
/// to this.
pub const LARGEST_COUNT: u16 = 4095;
/// The most pixels in the light range of a row, and the most in its shielded range.
pub const MAX_PIXELS: usize = 4096;

/// One read-out of the sensor, light positive: at most [`MAX_PIXELS`] counts of at most [`LARGEST_COUNT`].
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    light: Light<'a>,
    /// The sums over the light pixels' blocks. Empty where nobody summed them.
    blocks: &'a [u16],
    shielded: Light<'a>,
    saturation: u16,
    /// The sensor's pixel that is pixel 0 of `light`, if this is a part of a row.
    first: u16,
}

impl<'a> Row<'a> {
    /// Makes a row from its parts, light positive. A pixel of the count `saturation` or more is saturated:
    /// see [`Geometry::saturated_from`]. [`Geometry::row`] makes a row from a sensor's words.
    ///
    /// # Errors
    /// A count is above [`LARGEST_COUNT`], or there are more than [`MAX_PIXELS`].
    pub fn new(light: &'a [u16], shielded: &'a [u16], saturation: u16) -> Result<Self, RowError> {
        if light.len() > MAX_PIXELS || shielded.len() > MAX_PIXELS {
            return Err(RowError::Length {
                words: light.len().max(shielded.len()),
            });
        }
        let bits = (light.iter().chain(shielded)).fold(0, |bits, &count| bits | count);
        if bits > LARGEST_COUNT {
            return Err(RowError::Impossible { bits });
        }
        Ok(Self {
            light: light.into(),
            blocks: &[],
            shielded: shielded.into(),
            saturation,
            first: 0,
        })
    }

    /// As this row, with another count from which a pixel is saturated.
    pub const fn with_saturation(self, saturation: u16) -> Self {
        Self { saturation, ..self }
    }

    /// The least count of a saturated pixel.
    #[inline]
    pub const fn saturated_from(&self) -> u16 {
        self.saturation
    }

    /// Whether any of these pixels is saturated. Pixels off the row do not count.
    #[inline]
    pub fn reaches_saturation(&self, pixels: Range<usize>) -> bool {
        let end = pixels.end.min(self.light.len());
        let near = self.light.slice(pixels.start.min(end)..end);
        near.is_some_and(|near| near.extremes(self.saturation).saturated)
    }

    /// The pixels that see light.
    #[inline]
    pub const fn light(&self) -> Light<'a> {
        self.light
    }

    /// The place on the sensor of a place on this row: they differ if this is a part of a row.
    #[inline(always)]
    pub(crate) fn on_sensor(&self, place: Pixels) -> Pixels {
        place.moved_by(self.first.into())
    }

    /// The sums over blocks of 8 of them. Empty where nobody summed them.
    #[inline]
    pub(crate) const fn blocks(&self) -> &'a [u16] {
        self.blocks
    }

    /// The pixels under metal.
    #[inline]
    pub const fn shielded(&self) -> Light<'a> {
        self.shielded
    }
}

/// Whether more light makes a converter word larger or smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Polarity {
    /// A word rises with light.
    Rising,
    /// A word falls with light, from the full scale down.
    Falling,
}

/// The layout and the meaning of a row's words, as the sensor's driver states it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// Words in one read-out.
    pub words: usize,
    /// The words of the shielded pixels, from which the black level is read.
    pub shielded: Range<usize>,
    /// The words of the pixels that see light. Pixel 0 of a centre is the first of them.
    pub light: Range<usize>,
    /// What light does to a word.
    pub polarity: Polarity,
    /// Bits of the converter: its words go from 0 to 2^bits - 1. More than 12 count as 12.
    pub bits: u8,
    /// Variance of the light's shot noise for each count of light, in counts squared, Q0.16. It is one over
    /// the electrons that make a count. 0 ignores shot noise.
    pub shot_variance_per_count_q16: u16,
    /// The count from which a pixel counts as saturated: light positive, black level included. A sensor whose
    /// well is full below the converter's largest word has a lower one. The read noise comes after the well,
    /// so state four of its standard deviations less than the level. Above full scale it means full scale.
    pub saturation: u16,
}

/// Why words do not form a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowError {
    /// The number of words is not that of the geometry, or there are more pixels than [`MAX_PIXELS`].
    Length {
        /// The number of words.
        words: usize,
    },
    /// Words that the converter cannot make: a wire is open or shorted.
    Impossible {
        /// All bits that were set in any word.
        bits: u16,
    },
}

impl Geometry {
    /// Whether a calibration that was made with one geometry may be used with the other. All fields must
    /// agree except the noise figure, the saturation, and the shielded pixels. A centre hardly depends on
    /// which of the shielded pixels give the black level.
    pub fn is_compatible_with(&self, other: &Self) -> bool {
        // All fields by name: a new one does not compile until someone decides here whether it counts.
        let Self {
            words,
            shielded: _,
            light,
            polarity,
            bits,
            shot_variance_per_count_q16: _,
            saturation: _,
        } = self;
        *words == other.words
            && *light == other.light
            && *polarity == other.polarity
            && *bits == other.bits
    }

    /// Electrons that make a count, by the shot noise. The largest that there can be without shot noise.
    pub fn electrons_per_count(&self) -> Electrons {
        // Electrons have 12 bits after the point: 2^12 * 2^16 / variance.
        let bits = (1i32 << 28).checked_div(self.shot_variance_per_count_q16.into());
        bits.map_or(Electrons::MAX, Electrons::from_bits)
    }

    /// The largest word the converter makes, in counts.
    #[inline]
    pub const fn full_scale(&self) -> u16 {
        if self.bits < 12 {
            (1 << self.bits) - 1
        } else {
            LARGEST_COUNT
        }
    }

    /// The least count of a saturated pixel: [`Self::saturation`], at most full scale.
    #[inline]
    pub const fn saturated_from(&self) -> u16 {
        let full_scale = self.full_scale();
        if self.saturation < full_scale {
            self.saturation
        } else {
            full_scale
        }
    }

    /// The largest height above the black level that can be measured: the least saturated count less the
    /// black level. A pixel of this height is saturated.
    pub fn height_limit(&self, black_level: Counts) -> Counts {
        let saturation = Counts::from_int(self.saturated_from().into());
        Counts::from_bits(saturation.to_bits().saturating_sub(black_level.to_bits()))
    }

    /// Makes a row from the words of a read-out.
    ///
    /// # Errors
    /// The words are not a row of this sensor.
    pub fn row<'a>(&self, words: &'a [u16]) -> Result<Row<'a>, RowError> {
        let mut blocks = Blocks::NONE;
        self.tested_part(words, &self.light, &mut blocks)
    }

    /// A row without pixels. It stands for a row that did not come.
    pub fn empty_row(&self) -> Row<'static> {
        Row {
            light: Light::default(),
            blocks: &[],
            shielded: Light::default(),
            saturation: self.saturated_from(),
            first: 0,
        }
    }

    /// As [`Geometry::row`], with the row's blocks, of some of the light pixels. `part` is their range in the
    /// words.
    pub(crate) fn part_and_blocks<'a>(
        &self,
        words: &'a [u16],
        part: &Range<usize>,
        blocks: &'a mut Blocks,
    ) -> Result<Row<'a>, RowError> {
        let row = self.tested_part(words, part, blocks)?;
        Ok(Row {
            blocks: blocks.sums(),
            ..row
        })
    }

    /// Makes a row of a part, and sums its blocks in the pass that tests all words.
    #[inline]
    fn tested_part<'a>(
        &self,
        words: &'a [u16],
        part: &Range<usize>,
        blocks: &mut Blocks,
    ) -> Result<Row<'a>, RowError> {
        let length = RowError::Length { words: words.len() };
        if words.len() != self.words {
            return Err(length);
        }
        let row = self.part_of_valid(words, part).ok_or(length)?;
        let (before, rest) = words.split_at_checked(part.start).ok_or(length)?;
        let whole = row.light.len() / BLOCK * BLOCK;
        let (_, after) = rest.split_at_checked(whole).ok_or(length)?;
        let bits = blocks.sum(row.light) | all_bits(before) | all_bits(after);
        // Full scale is 2^bits - 1: a larger word sets a bit that no valid word has.
        if bits > self.full_scale() {
            return Err(RowError::Impossible { bits });
        }
        Ok(row)
    }

    /// Makes a row of words that are not above full scale. `None` where the row has more or fewer words than
    /// the geometry says.
    pub fn row_of_valid<'a>(&self, words: &'a [u16]) -> Option<Row<'a>> {
        self.part_of_valid(words, &self.light)
    }

    /// As [`Geometry::row_of_valid`], of some of the light pixels. `part` is their range in the words.
    #[inline(always)]
    pub(crate) fn part_of_valid<'a>(
        &self,
        words: &'a [u16],
        part: &Range<usize>,
    ) -> Option<Row<'a>> {
        let pixels = |range: &Range<usize>| {
            let words = words.get(range.clone())?;
            (words.len() <= MAX_PIXELS).then_some(Light::new(words, self.inverted()))
        };
        Some(Row {
            light: pixels(part)?,
            blocks: &[],
            shielded: pixels(&self.shielded)?,
            saturation: self.saturated_from(),
            first: self.first_of(part),
        })
    }

    /// The pixel with which a part of the light range begins. A row that is too long has no pixels.
    #[inline(always)]
    pub(crate) fn first_of(&self, part: &Range<usize>) -> u16 {
        u16::try_from(part.start.saturating_sub(self.light.start)).unwrap_or(0)
    }

    /// What turns a word into a count, and a count into a word, by an exclusive or.
    pub(crate) const fn inverted(&self) -> u16 {
        match self.polarity {
            Polarity::Falling => self.full_scale(),
            Polarity::Rising => 0,
        }
    }
}

fn all_bits(words: &[u16]) -> u16 {
    words.iter().fold(0, |bits, &word| bits | word)
}

/// Blocks of 2^3 = 8 pixels: a block's sum fits 16 bits.
pub(crate) const BLOCK_LOG2: u32 = 3;
pub(crate) const BLOCK: usize = 1 << BLOCK_LOG2;

const _: () = assert!((LARGEST_COUNT as u32) << BLOCK_LOG2 <= u16::MAX as u32);

const MAX_BLOCKS: usize = MAX_PIXELS / BLOCK;

/// The sums over the blocks of a row, light positive. Pixels that do not fill the last block are left out.
/// The pass that tests a read-out's words sums them, and the search for the spot starts from them.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    sums: [u16; MAX_BLOCKS],
    length: usize,
}

impl Blocks {
    pub(crate) const NONE: Self = Self {
        sums: [0; MAX_BLOCKS],
        length: 0,
    };

    pub(crate) fn of(light: Light<'_>) -> Self {
        let mut blocks = Self::NONE;
        blocks.sum(light);
        blocks
    }

    /// Sums a row's blocks, and returns all bits that are set in any of their words. If one of these bits is
    /// above full scale, the sums mean nothing.
    #[inline]
    pub(crate) fn sum(&mut self, light: Light<'_>) -> u16 {
        let (words, inverted) = light.words();
        let blocks = words.as_chunks::<BLOCK>().0;
        self.length = blocks.len().min(MAX_BLOCKS);
        // A count is full scale less a word, or the word itself.
        let (sign, of_eight) = match inverted {
            0 => (Pair(1, 1), 0),
            full_scale => (Pair(-1, -1), full_scale.wrapping_shl(BLOCK_LOG2)),
        };
        dual_mac::sum_blocks(blocks, sign, of_eight, &mut self.sums)
    }

    pub(crate) fn clear(&mut self) {
        self.length = 0;
    }

    #[inline]
    pub(crate) fn sums(&self) -> &[u16] {
        self.sums.get(..self.length).unwrap_or_default()
    }
}

/// Level and noise of a row away from the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Background {
    /// The counts of an unlit pixel.
    pub level: Counts,
    /// Standard deviation of an unlit pixel. At least that of rounding to a count, 1/sqrt(12).
    pub noise: Counts,
}

impl Background {
    /// The level in the bits of [`Counts`], limited to what a row can hold: 0 to 4095 * 2^8 < 2^20.
    pub fn level_bits(&self) -> i32 {
        level_bits(self.level)
    }

    /// Two variances in counts squared: of an unlit pixel, rounding included, and of the shot noise for each
    /// count of light.
    pub fn variances(&self, geometry: &Geometry) -> (f32, f32) {
        let noise = self.noise.to_f32();
        let shot = f32::from(geometry.shot_variance_per_count_q16) / 65536.0;
        (noise * noise, shot)
    }
}

/// A level in the bits of [`Counts`], limited to what a row can hold.
pub(crate) fn level_bits(level: Counts) -> i32 {
    const LARGEST: i32 = (LARGEST_COUNT as i32) << Counts::FRACTION;
    level.to_bits().clamp(0, LARGEST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::with;

    fn geometry() -> Geometry {
        with(crate::tests::bare(8, Polarity::Falling), |it| {
            (it.shielded, it.light) = (1..3, 3..7)
        })
    }

    /// Words at the ends of every range, for every number of bits.
    #[test]
    fn words_above_full_scale_are_impossible() {
        for bits in 1..=12 {
            let full_scale = (1 << bits) - 1;
            let geometry = Geometry { bits, ..geometry() };
            for word in [0, 1, full_scale / 2, full_scale - 1, full_scale] {
                let words = [word; 8];
                let row = geometry.row(&words).expect("a row");
                assert_eq!(row.light().get(0), Some(full_scale - word));
                assert_eq!(row.reaches_saturation(0..9), word == 0);
                for beyond in [full_scale + 1, full_scale + 2, 0x7FFF, 0x8000, u16::MAX] {
                    for place in 0..8 {
                        let mut words = words;
                        words[place] = beyond;
                        let bits = word | beyond;
                        let error = geometry.row(&words).err();
                        assert_eq!(error, Some(RowError::Impossible { bits }));
                    }
                }
            }
        }
    }

    #[test]
    fn only_the_pixels_asked_for_reach_full_scale() {
        let row = Row::new(&[1, 4095, 1, 1], &[], 4095).expect("12 bits");
        for (pixels, is_so) in [
            (0..4, true),
            (1..2, true),
            (0..1, false),
            (2..9, false),
            (7..9, false),
        ] {
            assert_eq!(row.reaches_saturation(pixels.clone()), is_so, "{pixels:?}");
        }
    }

    /// For words that rise and words that fall, of 8 and 12 bits.
    #[test]
    fn a_saturation_above_full_scale_means_full_scale() {
        for (bits, saturation, from) in [
            (12, 2500, 2500),
            (12, 4095, 4095),
            (12, u16::MAX, 4095),
            (8, 4095, 255),
            (8, 256, 255),
            (8, 200, 200),
            (8, 0, 0),
        ] {
            for polarity in [Polarity::Rising, Polarity::Falling] {
                let geometry = Geometry {
                    polarity,
                    bits,
                    saturation,
                    ..geometry()
                };
                assert_eq!(geometry.saturated_from(), from);
                let limit = geometry.height_limit(Counts::from_int(100));
                assert_eq!(limit, Counts::from_int(i32::from(from) - 100));
                let counts = [0, 199, 200, 254, 255, 2499, 2500, 4094, 4095].into_iter();
                for count in counts.filter(|&count| count <= geometry.full_scale()) {
                    let words = [count ^ geometry.inverted(); 8];
                    let row = geometry.row(&words).expect("a row");
                    assert_eq!(row.saturated_from(), from);
                    assert_eq!(row.reaches_saturation(0..9), count >= from, "{count}");
                    assert!(row.with_saturation(count).reaches_saturation(0..9));
                }
            }
        }
    }

    #[test]
    fn falling_words_become_light_positive() {
        let words = [0, 4000, 4001, 4095, 4000, 0, 3000, 7];
        let geometry = geometry();
        let row = geometry.row(&words).expect("a row");
        let light = row.light();
        assert!(light.iter().eq([0, 95, 4095, 1095]));
        assert!(light.iter().rev().eq([1095, 4095, 95, 0]));
        assert!(light.chunks::<2>().eq([[0, 95], [4095, 1095]]));
        assert_eq!(light.get(3), Some(1095));
        let (left, right) = light.split(1);
        assert!(left.iter().eq([0]) && right.iter().eq([95, 4095, 1095]));
        assert_eq!(light.slice(1..3).map(Light::len), Some(2));
        assert_eq!(light.slice(1..5), None);
        assert!(row.shielded().iter().eq([95, 94]));
        let rising = with(geometry, |it| it.polarity = Polarity::Rising);
        let row = rising.row(&[0, 1, 2, 3, 4, 5, 6, 7]).expect("a row");
        assert!(row.light().iter().eq([3, 4, 5, 6]));
    }

    #[test]
    fn noise_saturation_and_shielded_pixels_do_not_change_what_words_mean() {
        let changes: [fn(&mut Geometry); 8] = [
            |_| {},
            |it| it.shot_variance_per_count_q16 = 1,
            |it| it.saturation = 2500,
            |it| it.shielded = 0..1,
            |it| it.words = 9,
            |it| it.light = 3..8,
            |it| it.polarity = Polarity::Rising,
            |it| it.bits = 10,
        ];
        for (number, change) in changes.into_iter().enumerate() {
            let is_compatible = number < 4;
            let (here, mut other) = (geometry(), geometry());
            change(&mut other);
            assert_eq!(here.is_compatible_with(&other), is_compatible, "{other:?}");
            assert_eq!(other.is_compatible_with(&here), is_compatible, "{other:?}");
        }
    }

    #[test]
    fn malformed_rows_are_rejected() {
        let beyond = with(geometry(), |it| it.light = 3..9);
        let words = [0, 1, 2, 3, 4, 5, 6, 7];
        let impossible = [0, 1, 2, 3, 4, 5, 6, 0x8007];
        for (geometry, words, error) in [
            (&geometry(), &words[..3], RowError::Length { words: 3 }),
            (
                &geometry(),
                &impossible,
                RowError::Impossible { bits: 0x8007 },
            ),
            (&beyond, &words, RowError::Length { words: 8 }),
        ] {
            assert_eq!(geometry.row(words).expect_err("no row"), error);
        }
        let error = Row::new(&[1, 4096], &[], LARGEST_COUNT).expect_err("too large");
        assert_eq!(error, RowError::Impossible { bits: 4097 });
    }
}
