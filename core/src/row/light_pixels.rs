//! The pixels of a row as they lie in a read-out's words.

use core::slice::SliceIndex;

use crate::base::numeric;

/// Pixels side by side, light positive, in the words of a read-out. Words that fall with light stay as they
/// are: each count is computed when it is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Light<'a> {
    words: &'a [u16],
    /// What turns a word into a count by an exclusive or. Full scale is 2^bits - 1, so full scale less a word
    /// is the word with all its bits inverted.
    inverted: u16,
}

impl<'a> From<&'a [u16]> for Light<'a> {
    /// Words that are counts already.
    #[inline]
    fn from(counts: &'a [u16]) -> Self {
        Self {
            words: counts,
            inverted: 0,
        }
    }
}

impl<'a, const N: usize> From<&'a [u16; N]> for Light<'a> {
    #[inline]
    fn from(counts: &'a [u16; N]) -> Self {
        Self::from(counts.as_slice())
    }
}

impl<'a> Light<'a> {
    /// Words, and what turns them into counts by an exclusive or.
    #[inline]
    pub(super) const fn new(words: &'a [u16], inverted: u16) -> Self {
        Self { words, inverted }
    }

    /// The number of pixels.
    #[inline]
    pub const fn len(self) -> usize {
        self.words.len()
    }

    /// Whether there is no pixel.
    #[inline]
    pub const fn is_empty(self) -> bool {
        self.words.is_empty()
    }

    /// The count of a pixel. `None` off the row.
    #[inline]
    pub fn get(self, pixel: usize) -> Option<u16> {
        self.words.get(pixel).map(|word| word ^ self.inverted)
    }

    /// Some of the pixels. `None` where they are not all there.
    #[inline]
    pub fn slice(self, pixels: impl SliceIndex<[u16], Output = [u16]>) -> Option<Self> {
        Some(Self {
            words: self.words.get(pixels)?,
            ..self
        })
    }

    /// The pixels before one, and those from it on. Both are empty where there are fewer pixels.
    #[inline]
    pub fn split(self, pixel: usize) -> (Self, Self) {
        let (left, right) = self.words.split_at_checked(pixel).unwrap_or_default();
        let of = |words| Self { words, ..self };
        (of(left), of(right))
    }

    /// The counts, one after the other.
    #[inline]
    pub fn iter(
        self,
    ) -> impl DoubleEndedIterator<Item = u16> + ExactSizeIterator + Clone + use<'a> {
        let inverted = self.inverted;
        self.words.iter().map(move |word| word ^ inverted)
    }

    /// The counts in groups of N. Pixels that do not fill the last group are left out.
    #[inline]
    pub fn chunks<const N: usize>(
        self,
    ) -> impl DoubleEndedIterator<Item = [u16; N]> + ExactSizeIterator + Clone + use<'a, N> {
        let inverted = self.inverted;
        let chunks = self.words.as_chunks::<N>().0.iter();
        chunks.map(move |chunk| chunk.map(|word| word ^ inverted))
    }

    /// The pixels in groups of so many. Pixels that do not fill the last group are left out.
    #[inline]
    pub fn groups(self, pixels: usize) -> impl DoubleEndedIterator<Item = Self> + use<'a> {
        let groups = self.words.chunks_exact(pixels.max(1));
        groups.map(move |words| Self { words, ..self })
    }

    /// The words, and what turns them into counts by an exclusive or: full scale, or zero.
    #[inline]
    pub(crate) const fn words(self) -> (&'a [u16], u16) {
        (self.words, self.inverted)
    }

    /// The sum of the counts. A row has at most 2^12 pixels of 12 bits.
    #[inline(always)]
    pub(crate) fn sum(self) -> u32 {
        let (many, rest) = self.words.as_chunks::<16>();
        let few = |words| Self { words, ..self }.sum_of_few(0).0;
        let sum = (many.iter()).fold(0, |sum, words| numeric::add_u32(sum, few(words)));
        numeric::add_u32(sum, few(rest))
    }

    /// The sum of at most 32 counts, and whether any of them is saturated.
    // Takes two words at a time: 16 counts of 12 bits fit 16 bits. The highest of 16 bits is set in each
    // saturated count plus the rest from the least of them to 2^15.
    #[inline(always)]
    pub(crate) fn sum_of_few(self, saturation: u16) -> (u32, bool) {
        const ONES: u32 = 0x0001_0001;
        const HIGHEST: u32 = 0x8000_8000;
        let inverted = u32::from(self.inverted).wrapping_mul(ONES);
        let rest = HIGHEST.wrapping_sub(u32::from(saturation) * ONES);
        let (mut both, mut full) = (0u32, 0);
        let (pairs, last) = self.words.as_chunks::<2>();
        for &[low, high] in pairs {
            let counts = (u32::from(low) | (u32::from(high) * 0x1_0000)) ^ inverted;
            both = both.wrapping_add(counts);
            full |= counts.wrapping_add(rest);
        }
        for &word in last {
            let count = u32::from(word ^ self.inverted);
            both = both.wrapping_add(count);
            full |= count.wrapping_add(rest);
        }
        ((both & 0xFFFF) + (both >> 16), full & HIGHEST != 0)
    }

    /// Whether any count exceeds a limit.
    // Takes two words of at most 15 bits at a time. Adding 2^15 - 1 - limit sets bit 15 of exactly the counts
    // above the limit. A falling word is full scale less its count: the count is above the limit if the word
    // is below `least`, and adding 2^15 - `least` sets bit 15 of all other words. No sum exceeds 16 bits.
    #[inline(never)]
    pub(crate) fn exceeds(self, limit: u32) -> bool {
        const ONES: u32 = 0x0001_0001;
        const LARGEST: u32 = 0x7FFF;
        const HIGHEST: u32 = ONES * (LARGEST + 1);
        if self.inverted == 0 {
            return LARGEST.checked_sub(limit).is_some_and(|rest| {
                let has_hit = |bits: u32| bits & HIGHEST != 0;
                self.any_pair(rest.wrapping_mul(ONES), |a, b| a | b, has_hit)
            });
        }
        let least = u32::from(self.inverted).checked_sub(limit);
        least.is_some_and(|least| {
            let rest = (LARGEST + 1).wrapping_sub(least);
            let has_hit = |bits: u32| bits & HIGHEST != HIGHEST;
            self.any_pair(rest.wrapping_mul(ONES), |a, b| a & b, has_hit)
        })
    }

    /// Adds `rest` to both halves of each pair of words, and tests whether any sum has a hit. `combine`
    /// merges two sums into one that has a hit if either has.
    #[inline(always)]
    fn any_pair(
        self,
        rest: u32,
        combine: impl Fn(u32, u32) -> u32,
        has_hit: impl Fn(u32) -> bool,
    ) -> bool {
        let add = |low: u16, high: u16| {
            (u32::from(low) | (u32::from(high) * 0x1_0000)).wrapping_add(rest)
        };
        let (eights, last) = self.words.as_chunks::<8>();
        let (twos, last) = last.as_chunks::<2>();
        eights.iter().any(|&[a, b, c, d, e, f, g, h]| {
            has_hit(combine(
                combine(add(a, b), add(c, d)),
                combine(add(e, f), add(g, h)),
            ))
        }) || twos.iter().any(|&[a, b]| has_hit(add(a, b)))
            || last.iter().any(|&word| has_hit(add(word, word)))
    }

    /// How many counts are zero.
    // Takes two words of at most 15 bits at a time. Adding 2^15 - 1 sets bit 15 of all counts but zero. At
    // most 2^11 pairs, so each half of the sum fits 16 bits.
    pub(crate) fn zeros(self) -> u32 {
        const ONES: u32 = 0x0001_0001;
        let inverted = u32::from(self.inverted).wrapping_mul(ONES);
        let (pairs, last) = self.words.as_chunks::<2>();
        let others = pairs.iter().fold(0u32, |sum, &[low, high]| {
            let counts = (u32::from(low) | (u32::from(high) * 0x1_0000)) ^ inverted;
            sum.wrapping_add((counts.wrapping_add(ONES * 0x7FFF) >> 15) & ONES)
        });
        let others = numeric::add_u32(others & 0xFFFF, others >> 16);
        let last = last.iter().filter(|&&word| word != self.inverted).count();
        numeric::to_u32(self.words.len())
            .saturating_sub(others.saturating_add(numeric::to_u32(last)))
    }

    /// Whether any count is zero or saturated.
    // Takes two words at a time, of at most 15 bits. The highest of 16 bits is set in each word below
    // `few` less `few`, and in each word from `many` on plus the rest to 2^15. A borrow from the left word
    // comes only from a right word that is below `few` itself. Words that fall with light: a count of
    // `saturation` is full scale less it, and zero is full scale.
    #[inline(never)]
    pub fn extremes(self, saturation: u16) -> Extremes {
        const ONES: u32 = 0x0001_0001;
        const HIGHEST: u32 = 0x8000_8000;
        let (few, many) = match self.inverted {
            0 => (1, saturation),
            inverted => (
                inverted.saturating_sub(saturation).saturating_add(1),
                inverted,
            ),
        };
        let few = u32::from(few).wrapping_mul(ONES);
        let rest = HIGHEST.wrapping_sub(u32::from(many) * ONES);
        let both = |low: u16, high: u16| {
            let words = u32::from(low) | (u32::from(high) * 0x1_0000);
            (words.wrapping_sub(few), words.wrapping_add(rest))
        };
        let either = |low: u16, high: u16| {
            let (less, more) = both(low, high);
            less | more
        };
        let (eights, last) = self.words.as_chunks::<8>();
        // Most rows have none. A loop that ends early is not unrolled: it would need too many registers.
        let none = eights.iter().all(|&[a, b, c, d, e, f, g, h]| {
            (either(a, b) | either(c, d) | either(e, f) | either(g, h)) & HIGHEST == 0
        }) && last.iter().all(|&word| either(word, word) & HIGHEST == 0);
        if none {
            return Extremes::default();
        }
        let (less, more) = self
            .words
            .iter()
            .fold((0, 0), |(all_less, all_more), &word| {
                let (less, more) = both(word, word);
                (all_less | less, all_more | more)
            });
        let (least, largest) = (less & HIGHEST != 0, more & HIGHEST != 0);
        // Words that fall with light go from full scale down.
        let (zero, saturated) = match self.inverted {
            0 => (least, largest),
            _ => (largest, least),
        };
        Extremes { zero, saturated }
    }
}

/// Whether counts are at an end of what the sensor can deliver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extremes {
    /// A count is zero.
    pub zero: bool,
    /// A count is saturated.
    pub saturated: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::LARGEST_COUNT;
    use crate::tests::hash;

    /// Of all lengths, in words that rise and that fall.
    #[test]
    fn sums_zeros_and_limits_match_the_counts() {
        let words: [u16; 40] = core::array::from_fn(|i| match i % 7 {
            3 => 0,
            4 => LARGEST_COUNT,
            _ => hash(i) as u16 >> 4,
        });
        for length in 0..=words.len() {
            for inverted in [0, LARGEST_COUNT] {
                let light = Light::new(&words[..length], inverted);
                assert_eq!(light.sum(), light.iter().map(u32::from).sum());
                let zeros = light.iter().filter(|count| *count == 0).count();
                assert_eq!(light.zeros() as usize, zeros);
                let few = light.slice(..length.min(32)).expect("so many");
                for saturation in [LARGEST_COUNT, 1000] {
                    let is_full = few.iter().any(|count| count >= saturation);
                    assert_eq!(few.sum_of_few(saturation), (few.sum(), is_full));
                }
                assert_extremes(light);
                assert_exceeds(light);
            }
        }
    }

    /// Compares [`Light::exceeds`] with the counts, for limits about each count and at all ends.
    fn assert_exceeds(light: Light<'_>) {
        let ends = [
            0, 1, 999, 2048, 4094, 4095, 4096, 0x7FFE, 0x7FFF, 0x8000, 0xFFFFFFFF,
        ];
        let about = light.iter().flat_map(|count| {
            let count = u32::from(count);
            [count.saturating_sub(1), count, count + 1]
        });
        for limit in ends.into_iter().chain(about) {
            let is_so = light.iter().any(|count| u32::from(count) > limit);
            assert_eq!(light.exceeds(limit), is_so, "{limit}");
        }
    }

    /// Compares [`Light::extremes`] with the counts, for saturations about each count and at all ends.
    fn assert_extremes(light: Light<'_>) {
        let full_scale = match light.inverted {
            0 => LARGEST_COUNT,
            inverted => inverted,
        };
        let about = light.iter().flat_map(|count| {
            let most = count.saturating_add(1).min(full_scale);
            [count.saturating_sub(1), count, most]
        });
        for saturation in [0, 1, full_scale / 2 + 1, full_scale]
            .into_iter()
            .chain(about)
        {
            let of_counts = Extremes {
                zero: light.iter().any(|count| count == 0),
                saturated: light.iter().any(|count| count >= saturation),
            };
            assert_eq!(light.extremes(saturation), of_counts, "{saturation}");
        }
    }

    /// The lowest and the highest count in each place of rows of several lengths, with no other near them, in
    /// words of 12 and 10 bits. No other count may borrow a hit from its neighbour.
    #[test]
    fn extremes_and_limits_are_seen_in_any_place() {
        let lengths = [1, 7, 8, 9, 27].into_iter();
        for (length, place) in lengths.flat_map(|all| (0..all).map(move |place| (all, place))) {
            for (inverted, full_scale) in [(0, 4095), (4095, 4095), (1023, 1023)] {
                let half = full_scale / 2;
                for count in [0, 1, 303, half, half + 1, full_scale - 1, full_scale] {
                    let mut words = [300 ^ inverted; 27];
                    words[place] = count ^ inverted;
                    let light = Light::new(&words[..length], inverted);
                    assert_extremes(light);
                    assert_exceeds(light);
                }
            }
        }
    }

    #[test]
    fn a_limit_is_exceeded_by_the_widest_words() {
        // Sums over blocks, and all 15 bits.
        for highest in [8 * LARGEST_COUNT, 0x7FFF] {
            let mut words = [0; 27];
            words[13] = highest;
            assert_exceeds(Light::from(&words));
            assert_exceeds(Light::from(&[highest; 27]));
        }
    }
}
