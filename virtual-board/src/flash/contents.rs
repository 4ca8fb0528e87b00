//! The contents of the four sectors, and how operations change them: done in full, or cut off by a power cut.

use std::fmt;

use anyhow::{Result, ensure};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Where the sectors begin: bank 2 (RM0090 table 6).
pub const BASE: u64 = 0x0810_0000;

/// Bytes of a sector (RM0090 table 6).
pub const SECTOR_BYTES: usize = 16 << 10;

/// The number of the first sector. The others have the next numbers (RM0090 table 6).
pub const FIRST_SECTOR: usize = 12;

/// How many sectors there are.
pub const SECTORS: usize = 4;

/// Bytes of all four sectors.
pub const BYTES: usize = SECTORS * SECTOR_BYTES;

const ERASED: u8 = 0xFF;

/// An operation that changes flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Sets all bits of a sector.
    Erase {
        /// 12 to 15.
        sector: usize,
    },
    /// Clears the bits of a word that are clear in `word`.
    Program {
        /// A multiple of 4.
        address: u64,
        /// The word that is written.
        word: u32,
    },
}

/// The bytes of sectors 12 to 15.
#[derive(Clone, PartialEq, Eq)]
pub struct Contents(Vec<u8>);

impl fmt::Debug for Contents {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let used = self.0.iter().filter(|&&byte| byte != ERASED).count();
        write!(formatter, "Contents({used} bytes are not erased)")
    }
}

impl Contents {
    /// Erased sectors, as in a new chip.
    pub fn erased() -> Self {
        Self(vec![ERASED; BYTES])
    }

    /// Contents from [`BYTES`] bytes.
    ///
    /// # Errors
    /// The number of bytes is not [`BYTES`].
    pub fn new(bytes: Vec<u8>) -> Result<Self> {
        ensure!(
            bytes.len() == BYTES,
            "{} bytes are not four sectors of flash, which are {BYTES}",
            bytes.len()
        );
        Ok(Self(bytes))
    }

    /// All bytes, sector 12's first.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// Does all of `operation`.
    ///
    /// # Panics
    /// The operation is outside the sectors.
    pub fn apply(&mut self, operation: Operation) {
        match operation {
            Operation::Erase { sector } => self.sector(sector).fill(ERASED),
            Operation::Program { address, word } => {
                for (byte, written) in self.word(address).iter_mut().zip(word.to_le_bytes()) {
                    *byte &= written;
                }
            }
        }
    }

    /// Does the part of `operation` that a power cut leaves: it clears or sets only some of the bits. `seed`
    /// decides which. In an erase about a third of the bytes stay as they were, and about a third are erased
    /// fully.
    ///
    /// # Panics
    /// The operation is outside the sectors.
    pub fn apply_torn(&mut self, operation: Operation, seed: u64) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        match operation {
            Operation::Erase { sector } => {
                for byte in self.sector(sector) {
                    *byte |= match random.random_range(0..3) {
                        0 => 0x00,
                        1 => random.random::<u8>(),
                        _ => ERASED,
                    };
                }
            }
            Operation::Program { address, word } => {
                let spared = random.random::<u32>();
                let word = word | spared;
                self.apply(Operation::Program { address, word });
            }
        }
    }

    /// Flips `mask`'s bits in the byte at `offset` from [`BASE`], as an upset would.
    ///
    /// # Panics
    /// `offset` is not below [`BYTES`].
    pub fn flip_bits(&mut self, offset: usize, mask: u8) {
        self.0[offset] ^= mask;
    }

    /// The `count` bytes from `address` on, as one number. The caller has checked the range.
    pub(super) fn read(&self, address: u64, count: u32) -> u64 {
        let from = (address - BASE) as usize;
        let bytes = self.0[from..from + count as usize].iter().rev();
        bytes.fold(0, |value, &byte| value << 8 | u64::from(byte))
    }

    fn sector(&mut self, number: usize) -> &mut [u8] {
        let is_here = (FIRST_SECTOR..FIRST_SECTOR + SECTORS).contains(&number);
        assert!(is_here, "sector {number} is not one of the four");
        &mut self.0[(number - FIRST_SECTOR) * SECTOR_BYTES..][..SECTOR_BYTES]
    }

    fn word(&mut self, address: u64) -> &mut [u8] {
        let is_word = (BASE..BASE + BYTES as u64).contains(&address) && address.is_multiple_of(4);
        assert!(is_word, "{address:#010x} is no word of the four sectors");
        &mut self.0[(address - BASE) as usize..][..4]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn program(address: u64, word: u32) -> Operation {
        Operation::Program { address, word }
    }

    #[test]
    fn programming_clears_bits_and_erasing_sets_those_of_its_sector() {
        let mut contents = Contents::erased();
        contents.apply(program(BASE + 4, 0xF0F0_1234));
        contents.apply(program(BASE + 4, 0xFF00_FFFF));
        contents.apply(program(BASE + BYTES as u64 - 4, 0));
        assert_eq!(contents.read(BASE + 4, 4), 0xF000_1234);
        let bytes = [255, 255, 255, 255, 0x34, 0x12, 0x00, 0xF0, 255];
        assert_eq!(contents.bytes()[..9], bytes);
        contents.apply(Operation::Erase { sector: 12 });
        assert_eq!(contents.read(BASE + 4, 4), 0xFFFF_FFFF);
        assert_eq!(contents.read(BASE + BYTES as u64 - 4, 4), 0);
        contents.apply(Operation::Erase { sector: 15 });
        assert_eq!(contents, Contents::erased());
    }

    /// Bits only change in the direction of the operation, and not all of them: in a program about half of
    /// the bits, in an erase all bits of a third of the bytes and half of the bits of another third.
    #[test]
    fn a_torn_operation_is_done_in_part() {
        let (mut cleared, mut words) = (0, Vec::new());
        for seed in 0..1000 {
            let mut contents = Contents::erased();
            contents.apply(program(BASE, 0xFFFF_0000));
            contents.apply_torn(program(BASE, 0x0000_FFFF), seed);
            let word = contents.read(BASE, 4);
            assert_eq!(word & 0xFFFF, 0, "what was clear stays clear");
            cleared += (word >> 16).count_zeros() - 48;
            words.push(word);
        }
        let share = f64::from(cleared) / 16_000.0;
        println!("of the bits to be cleared {share:.3} are");
        // 16,000 coins: 0.004.
        assert!((share - 0.5).abs() < 0.02);
        words.sort_unstable();
        words.dedup();
        assert!(words.len() > 900, "{} words", words.len());

        let mut contents = Contents::erased();
        for word in 0..BYTES as u64 / 4 {
            contents.apply(program(BASE + 4 * word, 0));
        }
        contents.apply_torn(Operation::Erase { sector: 15 }, 1);
        let (others, last) = contents.bytes().split_at(BYTES - SECTOR_BYTES);
        assert!(others.iter().all(|&byte| byte == 0), "another sector");
        let count = |wanted| last.iter().filter(|&&byte| byte == wanted).count() as f64;
        let [as_before, erased] = [0, ERASED].map(|byte| count(byte) / SECTOR_BYTES as f64);
        println!("of the bytes to be erased {erased:.3} are, and {as_before:.3} are as before");
        // 1/3 + 1/768 each, of 16,384 throws: 0.0037.
        assert!((as_before - 0.3346).abs() < 0.015 && (erased - 0.3346).abs() < 0.015);
    }

    #[test]
    #[should_panic(expected = "0x08110000 is no word of the four sectors")]
    fn a_word_outside_the_sectors_panics() {
        Contents::erased().apply(program(BASE + BYTES as u64, 0));
    }
}
