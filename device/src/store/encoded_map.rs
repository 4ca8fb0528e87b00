//! A map of the pixels as words of four bytes, as flash holds it.
//!
//! | words | |
//! |---|---|
//! | 1 | `FL`: a map; the version of this layout, 1; and the complement of the version |
//! | 1 | the number of the save, which rises by one with each |
//! | 1 | the number of pixels (low half), and of those outside the map's range |
//! | 1 | the response that remains, Q0.16 (low half), and zero |
//! | 1 | the offset that remains, [`Counts`] |
//! | 1 | the noise that the offsets add to a row, [`Counts`] |
//! | pixels | offset, Q11.4 (low half), and gain less one, Q0.15 |
//! | 1 | CRC-32 of all bytes before |

use crc::{CRC_32_ISO_HDLC, Crc};

use slitrange::base::units::Counts;
use slitrange::row::pixels::PixelErrors;
use slitrange::row::pixels::map::{Entry, MAX_MAP_PIXELS, MapSummary, PixelMap};

/// Words before the entries.
const HEADER: usize = 6;

/// The words of the longest map.
pub const MAX_WORDS: usize = HEADER + MAX_MAP_PIXELS + 1;

/// The version of the layout.
pub const VERSION: u8 = 1;

/// The first word. The complement tells a later version from a damaged byte.
const NAME: [u8; 4] = [b'F', b'L', VERSION, !VERSION];

const CRC: Crc<u32, crc::Table<0>> = Crc::<u32, crc::Table<0>>::new(&CRC_32_ISO_HDLC);

/// Four bytes, as flash holds them.
pub type Word = [u8; 4];

/// A map as words, one after the other.
#[derive(Debug)]
pub struct Words<'a> {
    map: &'a PixelMap,
    number: u32,
    next: usize,
    sum: Sum,
}

impl<'a> Words<'a> {
    /// The words of a map. `number` is that of the save.
    pub fn new(map: &'a PixelMap, number: u32) -> Self {
        Self {
            map,
            number,
            next: 0,
            sum: Sum::default(),
        }
    }
}

impl Iterator for Words<'_> {
    type Item = Word;

    fn next(&mut self) -> Option<Word> {
        let summary = self.map.summary();
        let word = match self.next {
            0 => NAME,
            1 => self.number.to_le_bytes(),
            2 => halves(self.map.pixels(), summary.outside),
            3 => halves(summary.errors.response_q16, 0),
            4 => summary.errors.offset.to_bits().to_le_bytes(),
            5 => summary.pattern.to_bits().to_le_bytes(),
            next => match self.map.entries().get(next.saturating_sub(HEADER)) {
                Some(entry) => halves(
                    entry.offset_q4().cast_unsigned(),
                    entry.gain_q15().cast_unsigned(),
                ),
                None if next == self.map.entries().len().saturating_add(HEADER) => {
                    self.sum.0.to_le_bytes()
                }
                None => return None,
            },
        };
        self.sum.add(word);
        self.next = self.next.saturating_add(1);
        Some(word)
    }
}

/// The CRC-32 of words. Not the library's digest: that refers to its algorithm, and then the compiler cannot
/// prove that the algorithm's shifts lose nothing.
#[derive(Clone, Copy, Debug, Default)]
struct Sum(u32);

impl Sum {
    fn add(&mut self, word: Word) {
        // The CRC of no bytes is 0. This algorithm reflects its bits and inverts them at the end.
        let mut digest = CRC.digest_with_initial((!self.0).reverse_bits());
        digest.update(&word);
        self.0 = digest.finalize();
    }
}

/// Reads a map from its words, one after the other.
#[derive(Clone, Debug, Default)]
pub struct Reader {
    next: usize,
    sum: Sum,
    number: u32,
    pixels: u16,
    outside: u16,
    response_q16: u16,
    offset: i32,
    pattern: i32,
}

/// What a word of a map brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// More words are needed.
    More,
    /// The last word: the map is whole. Holds the number of the save.
    Whole(u32),
    /// The words are a map in this later version of the layout.
    Later(u8),
    /// These words are not a map.
    NoMap,
}

impl Reader {
    /// Takes the next word, and writes what it holds into `map`, if there is one. From the first entry to the
    /// last word, the map is not whole.
    pub fn take(&mut self, word: Word, map: Option<&mut PixelMap>) -> Read {
        let [low, high] = [0, 2].map(|at| match word.get(at..) {
            Some(&[a, b, ..]) => u16::from_le_bytes([a, b]),
            _ => 0,
        });
        let sum = self.sum.0;
        self.sum.add(word);
        let at = self.next;
        self.next = at.saturating_add(1);
        let last = HEADER.saturating_add(self.pixels.into());
        match at {
            0 => match word {
                NAME => {}
                [b'F', b'L', version, complement] if version == !complement => {
                    return Read::Later(version);
                }
                _ => return Read::NoMap,
            },
            1 => self.number = u32::from_le_bytes(word),
            2 if low == 0 || usize::from(low) > MAX_MAP_PIXELS => return Read::NoMap,
            2 => (self.pixels, self.outside) = (low, high),
            3 => self.response_q16 = low,
            4 => self.offset = i32::from_le_bytes(word),
            5 => self.pattern = i32::from_le_bytes(word),
            _ if at < last => {
                let Some(entry) = Entry::new(low as i16, high as i16) else {
                    return Read::NoMap;
                };
                if let Some(map) = map {
                    map.set_entry(at.saturating_sub(HEADER), entry);
                }
            }
            _ if at > last || u32::from_le_bytes(word) != sum => return Read::NoMap,
            _ => {
                if let Some(map) = map {
                    map.complete(self.pixels, self.summary());
                }
                return Read::Whole(self.number);
            }
        }
        Read::More
    }

    /// What the header says.
    pub fn summary(&self) -> MapSummary {
        MapSummary {
            errors: PixelErrors {
                response_q16: self.response_q16,
                offset: Counts::from_bits(self.offset),
            },
            pattern: Counts::from_bits(self.pattern),
            outside: self.outside,
        }
    }

    /// The number of pixels.
    pub fn pixels(&self) -> usize {
        self.pixels.into()
    }
}

fn halves(low: u16, high: u16) -> Word {
    let ([a, b], [c, d]) = (low.to_le_bytes(), high.to_le_bytes());
    [a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> PixelMap {
        let mut map = PixelMap::EMPTY;
        for index in 0..MAX_MAP_PIXELS {
            let value = index as i16;
            let entry = Entry::new(value - 1824, value * 3 - 5000).expect("an entry");
            map.set_entry(index, entry);
        }
        let summary = MapSummary {
            errors: PixelErrors {
                response_q16: 33,
                offset: Counts::from_bits(20),
            },
            pattern: Counts::from_int(5),
            outside: 3,
        };
        map.complete(MAX_MAP_PIXELS as u16, summary);
        map
    }

    fn read(words: &[Word], map: &mut PixelMap) -> Read {
        let mut reader = Reader::default();
        let mut result = Read::More;
        for &word in words {
            assert_eq!(result, Read::More);
            result = reader.take(word, Some(&mut *map));
            if matches!(result, Read::NoMap | Read::Later(_)) {
                break;
            }
        }
        result
    }

    #[test]
    fn what_is_written_is_read_back() {
        let map = map();
        let words: std::vec::Vec<Word> = Words::new(&map, 7).collect();
        assert_eq!(words.len(), MAX_WORDS);
        assert!(4 * words.len() <= 16 << 10);
        let mut back = PixelMap::EMPTY;
        assert_eq!(read(&words, &mut back), Read::Whole(7));
        assert_eq!(back, map);
    }

    #[test]
    fn a_changed_bit_anywhere_is_seen() {
        // Miri takes seconds to read a map.
        let (every, bits) = if cfg!(miri) {
            (1999, &[13][..])
        } else {
            (71, &[0, 13, 31][..])
        };
        let words: std::vec::Vec<Word> = Words::new(&map(), 7).collect();
        let mut back = PixelMap::EMPTY;
        let last = words.len() - 1;
        for at in (0..=last).step_by(every).chain([1, 2, last]) {
            for bit in bits {
                let mut changed = words.clone();
                changed[at] = (u32::from_le_bytes(changed[at]) ^ (1 << bit)).to_le_bytes();
                let read = read(&changed, &mut back);
                let is_taken = matches!(read, Read::Whole(_) | Read::Later(_));
                assert!(!is_taken, "{at} {bit}");
                assert!(!back.is_whole());
            }
        }
    }

    #[test]
    fn words_that_are_no_map_are_refused() {
        let (mut back, zero, one) = (PixelMap::EMPTY, [0; 4], [1, 0, 0, 0]);
        let beyond = [0, 0x80, 0, 0];
        for (words, expected) in [
            (&[[0xff; 4]][..], Read::NoMap),
            (&[zero], Read::NoMap),
            (&[[b'F', b'L', 2, !2]], Read::Later(2)),
            // One wrong bit in the version is damage.
            (&[[b'F', b'L', 3, !1]], Read::NoMap),
            // 3649 pixels.
            (&[NAME, zero, [0x41, 0x0e, 0, 0]], Read::NoMap),
            // An entry beyond its range.
            (&[NAME, one, one, zero, zero, zero, beyond], Read::NoMap),
        ] {
            assert_eq!(read(words, &mut back), expected, "{words:?}");
        }
    }
}
