//! A row, and the geometry of the sensor that made it.

use core::ops::Range;

use crate::units::Counts;

/// Whether more light makes a converter word larger or smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
}

/// The largest count of a row: that of a 12-bit converter. The arithmetic of the core is proven for counts up
/// to this.
pub const LARGEST_COUNT: u16 = 4095;

/// The most pixels in the light range of a row, and the most in its shielded range.
pub const MAX_PIXELS: usize = 4096;

/// One read-out of the sensor, light positive: at most [`MAX_PIXELS`] counts of at most [`LARGEST_COUNT`].
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    light: &'a [u16],
    shielded: &'a [u16],
    reaches_full_scale: bool,
}

impl<'a> Row<'a> {
    /// Makes a row from its parts, light positive. `full_scale` is the converter's largest word.
    /// [`Geometry::row`] makes a row from a sensor's words.
    ///
    /// # Errors
    /// A count is above [`LARGEST_COUNT`], or there are more than [`MAX_PIXELS`].
    pub fn new(light: &'a [u16], shielded: &'a [u16], full_scale: u16) -> Result<Self, RowError> {
        if light.len() > MAX_PIXELS || shielded.len() > MAX_PIXELS {
            return Err(RowError::Length {
                words: light.len().max(shielded.len()),
            });
        }
        let bits = light
            .iter()
            .chain(shielded)
            .fold(0, |bits, &count| bits | count);
        if bits > LARGEST_COUNT {
            return Err(RowError::Impossible { bits });
        }
        Ok(Self {
            light,
            shielded,
            reaches_full_scale: light.iter().any(|&count| count >= full_scale),
        })
    }

    /// Whether any word of the read-out is at full scale. Where none is, no pixel is saturated.
    #[inline]
    pub const fn reaches_full_scale(&self) -> bool {
        self.reaches_full_scale
    }

    /// The pixels that see light.
    #[inline]
    pub const fn light(&self) -> &'a [u16] {
        self.light
    }

    /// The pixels under metal.
    #[inline]
    pub const fn shielded(&self) -> &'a [u16] {
        self.shielded
    }
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
    /// Whether a calibration that was made with one geometry may be used with the other. All fields but the
    /// noise figure must agree: the noise figure changes a centre's uncertainty and not its meaning.
    pub fn is_compatible_with(&self, other: &Self) -> bool {
        // All fields by name: a new one does not compile until someone decides here whether it counts.
        let Self {
            words,
            shielded,
            light,
            polarity,
            bits,
            shot_variance_per_count_q16: _,
        } = self;
        *words == other.words
            && *shielded == other.shielded
            && *light == other.light
            && *polarity == other.polarity
            && *bits == other.bits
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

    /// The largest height above the black level that can be measured: full scale less the black level. A
    /// pixel of this height is saturated.
    pub fn height_limit(&self, black_level: Counts) -> Counts {
        let full_scale = Counts::from_int(self.full_scale().into());
        Counts::from_bits(full_scale.to_bits().saturating_sub(black_level.to_bits()))
    }

    /// Makes a row from the words of a read-out. Where words fall with light, subtracts them from full scale
    /// in place.
    ///
    /// # Errors
    /// The words are not a row of this sensor. Do not use them after this: some may have been changed.
    pub fn row<'a>(&self, words: &'a mut [u16]) -> Result<Row<'a>, RowError> {
        let length = RowError::Length { words: words.len() };
        if words.len() != self.words {
            return Err(length);
        }
        let full_scale = self.full_scale();
        let (bits, reaches_full_scale) = match self.polarity {
            Polarity::Falling => invert_words(words, full_scale),
            Polarity::Rising => {
                let bits = words.iter().fold(0, |bits, &word| bits | word);
                (bits, words.iter().any(|&word| word >= full_scale))
            }
        };
        // Full scale is 2^bits - 1: a larger word sets a bit that no valid word has.
        if bits > full_scale {
            return Err(RowError::Impossible { bits });
        }
        let words = &*words;
        match (
            words.get(self.light.clone()),
            words.get(self.shielded.clone()),
        ) {
            (Some(light), Some(shielded)) if light.len().max(shielded.len()) <= MAX_PIXELS => {
                Ok(Row {
                    light,
                    shielded,
                    reaches_full_scale,
                })
            }
            _ => Err(length),
        }
    }
}

impl Geometry {
    /// Makes a row again from words that [`Geometry::row`] made a row of, and whose light pixels were then
    /// corrected: see [`PixelMap::correct`](crate::pixels::map::PixelMap::correct). A correction keeps the
    /// counts in their range.
    pub(crate) fn corrected_row<'a>(
        &self,
        words: &'a [u16],
        reaches_full_scale: bool,
    ) -> Option<Row<'a>> {
        let light = words.get(self.light.clone())?;
        let shielded = words.get(self.shielded.clone())?;
        (light.len().max(shielded.len()) <= MAX_PIXELS).then_some(Row {
            light,
            shielded,
            reaches_full_scale,
        })
    }
}

/// Subtracts each word from full scale, in place. Returns all bits that were set in any word if one of them
/// is above full scale, otherwise full scale; and whether a word was zero (full scale of light). Takes two
/// words at a time, because it runs on every word of every row.
fn invert_words(words: &mut [u16], full_scale: u16) -> (u16, bool) {
    const ONES: u32 = 0x0001_0001;
    let full_scales = u32::from(full_scale) * ONES;
    // All bits of the inverted words, and of those plus one. Full scale is 2^bits - 1: only full scale plus
    // one has the bit above.
    let (mut bits, mut bits_plus_one) = (0u32, 0u32);
    let (pairs, last) = words.as_chunks_mut::<2>();
    for pair in &mut *pairs {
        let both = u32::from(pair[0]) | (u32::from(pair[1]) * 0x1_0000);
        // No half borrows from the other if both words are at most full scale.
        let inverted = full_scales.wrapping_sub(both);
        bits |= inverted;
        bits_plus_one |= inverted.wrapping_add(ONES);
        *pair = [inverted as u16, (inverted >> 16) as u16];
    }
    for word in &mut *last {
        *word = full_scale.wrapping_sub(*word);
        bits |= u32::from(*word);
        bits_plus_one |= u32::from(word.wrapping_add(1));
    }
    // A word above full scale leaves a bit above it: in its half, or in the one that lent to it.
    if bits & !full_scales != 0 {
        return (bits_before(words, full_scale), false);
    }
    let above = full_scales.wrapping_add(ONES);
    (full_scale, bits_plus_one & above != 0)
}

/// All bits that were set in any word before [`invert_words`].
#[cold]
fn bits_before(words: &[u16], full_scale: u16) -> u16 {
    let full_scales = u32::from(full_scale) * 0x0001_0001;
    let (pairs, last) = words.as_chunks::<2>();
    let bits = pairs.iter().fold(0, |bits, pair| {
        let inverted = u32::from(pair[0]) | (u32::from(pair[1]) * 0x1_0000);
        bits | full_scales.wrapping_sub(inverted)
    });
    let of_last = |bits, word: &u16| bits | full_scale.wrapping_sub(*word);
    last.iter().fold((bits | bits >> 16) as u16, of_last)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn geometry() -> Geometry {
        Geometry {
            words: 8,
            shielded: 1..3,
            light: 3..7,
            polarity: Polarity::Falling,
            bits: 12,
            shot_variance_per_count_q16: 6554,
        }
    }

    /// All pairs of words at the ends of every range, for every number of bits.
    #[test]
    fn pairs_of_words_are_inverted_like_single_words() {
        for bits in 1..=12 {
            let full_scale = (1 << bits) - 1;
            let ends = [0, 1, full_scale / 2, full_scale - 1, full_scale];
            let beyond = [full_scale + 1, full_scale + 2, 0x7FFF, 0x8000, u16::MAX];
            let all = || ends.into_iter().chain(beyond);
            for first in all() {
                for second in all() {
                    let mut words = [first, second, first];
                    let (found, is_zero) = invert_words(&mut words, full_scale);
                    if first > full_scale || second > full_scale {
                        assert_eq!(found, first | second, "{first} {second} of {bits} bits");
                    } else {
                        assert!(found <= full_scale);
                        assert_eq!(is_zero, first == 0 || second == 0);
                        assert_eq!(words, [first, second, first].map(|word| full_scale - word));
                    }
                }
            }
        }
    }

    #[test]
    fn falling_words_become_light_positive() {
        let mut words = [0, 4000, 4001, 4095, 4000, 0, 3000, 7];
        let row = geometry().row(&mut words).expect("a row");
        assert_eq!(row.light(), [0, 95, 4095, 1095]);
        assert_eq!(row.shielded(), [95, 94]);
        let mut rising = [0, 1, 2, 3, 4, 5, 6, 7];
        let geometry = Geometry {
            polarity: Polarity::Rising,
            ..geometry()
        };
        assert_eq!(
            geometry.row(&mut rising).expect("a row").light(),
            [3, 4, 5, 6]
        );
    }

    #[test]
    fn noise_figures_do_not_change_what_words_mean() {
        let here = geometry();
        let noisier = Geometry {
            shot_variance_per_count_q16: 1,
            ..geometry()
        };
        assert!(here.is_compatible_with(&here) && here.is_compatible_with(&noisier));
        for other in [
            Geometry {
                words: 9,
                ..geometry()
            },
            Geometry {
                shielded: 0..3,
                ..geometry()
            },
            Geometry {
                light: 3..8,
                ..geometry()
            },
            Geometry {
                polarity: Polarity::Rising,
                ..geometry()
            },
            Geometry {
                bits: 10,
                ..geometry()
            },
        ] {
            assert!(!here.is_compatible_with(&other), "{other:?}");
            assert!(!other.is_compatible_with(&here), "{other:?}");
        }
    }

    #[test]
    fn malformed_rows_are_rejected() {
        let error = |words: &mut [u16]| geometry().row(words).expect_err("no row");
        assert_eq!(error(&mut [1, 2, 3]), RowError::Length { words: 3 });
        assert_eq!(
            error(&mut [0, 1, 2, 3, 4, 5, 6, 0x8007]),
            RowError::Impossible { bits: 0x8007 }
        );
        let beyond = Geometry {
            light: 3..9,
            ..geometry()
        };
        assert_eq!(
            beyond
                .row(&mut [0, 1, 2, 3, 4, 5, 6, 7])
                .expect_err("no row"),
            RowError::Length { words: 8 }
        );
        assert_eq!(
            Row::new(&[1, 4096], &[], LARGEST_COUNT).expect_err("too large"),
            RowError::Impossible { bits: 4097 }
        );
    }
}
