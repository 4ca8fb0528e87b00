//! A flash with two sectors, of which power can be cut at any operation: the erasing of a sector, or the
//! programming of a word.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const SECTOR: usize = 0x4000;
pub const BYTES: usize = 2 * SECTOR;
const WORD: usize = 4;

/// As the chip's: erasing sets all bits of a sector, programming a word clears bits.
#[derive(Clone)]
pub struct Flash {
    pub bytes: Vec<u8>,
    pub erases: [u32; 2],
    /// Erasures and words programmed.
    pub operations: usize,
    /// Words that were programmed over what was there, other than to 0.
    pub overwritten: usize,
    power: Power,
}

#[derive(Clone)]
enum Power {
    On,
    /// Off after some more operations. With a seed, the next one is then begun.
    Until(usize, Option<u64>),
    Off,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoPower;

impl NorFlashError for NoPower {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl Flash {
    pub fn erased() -> Self {
        Self::with(vec![0xff; BYTES])
    }

    pub fn with(bytes: Vec<u8>) -> Self {
        assert_eq!(bytes.len(), BYTES);
        Self {
            bytes,
            erases: [0; 2],
            operations: 0,
            overwritten: 0,
            power: Power::On,
        }
    }

    /// Power fails after so many operations. With a seed the next one is begun, but not finished.
    pub fn cut_after(&mut self, operations: usize, torn: Option<u64>) {
        self.power = Power::Until(operations, torn);
    }

    pub fn power_on(&mut self) {
        self.power = Power::On;
    }

    /// Does an operation on a range, as far as there is power: `new` are the bytes that it would leave.
    fn operate(&mut self, range: std::ops::Range<usize>, new: &[u8]) -> Result<(), NoPower> {
        match &mut self.power {
            Power::On => {}
            Power::Until(0, torn) => {
                if let Some(seed) = *torn {
                    let mut random = ChaCha8Rng::seed_from_u64(seed);
                    tear(&mut random, &mut self.bytes[range], new);
                }
                self.power = Power::Off;
                return Err(NoPower);
            }
            Power::Until(operations, _) => *operations -= 1,
            Power::Off => return Err(NoPower),
        }
        self.operations += 1;
        self.bytes[range].copy_from_slice(new);
        Ok(())
    }
}

/// An operation that was begun: single bits done, single bytes, or all from one end to anywhere.
fn tear(random: &mut ChaCha8Rng, bytes: &mut [u8], new: &[u8]) {
    let part = random.random::<f64>();
    let place = random.random_range(0..=bytes.len());
    let kind = random.random_range(0..4);
    for (i, (byte, new)) in bytes.iter_mut().zip(new).enumerate() {
        let mask = match kind {
            0 => (0..8)
                .map(|bit| u8::from(random.random_bool(part)) << bit)
                .sum(),
            1 if random.random_bool(part) => 0xff,
            2 if i < place => 0xff,
            3 if i >= place => 0xff,
            _ => 0,
        };
        *byte = *byte & !mask | new & mask;
    }
}

impl ErrorType for Flash {
    type Error = NoPower;
}

impl ReadNorFlash for Flash {
    // As embassy-stm32's for this chip.
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NoPower> {
        if matches!(self.power, Power::Off) {
            return Err(NoPower);
        }
        let start = offset as usize;
        bytes.copy_from_slice(&self.bytes[start..start + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        BYTES
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NoPower> {
        let (from, to) = (from as usize, to as usize);
        assert!(from.is_multiple_of(SECTOR) && to.is_multiple_of(SECTOR) && from < to);
        for sector in from / SECTOR..to / SECTOR {
            self.operate(sector * SECTOR..(sector + 1) * SECTOR, &[0xff; SECTOR])?;
            self.erases[sector] += 1;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NoPower> {
        let start = offset as usize;
        assert!(start.is_multiple_of(WORD) && bytes.len().is_multiple_of(WORD));
        for (i, new) in bytes.chunks(WORD).enumerate() {
            let range = start + i * WORD..start + (i + 1) * WORD;
            let old = &self.bytes[range.clone()];
            if old != [0xff; WORD] && new != [0; WORD] {
                self.overwritten += 1;
            }
            let cleared: Vec<u8> = old.iter().zip(new).map(|(old, new)| old & new).collect();
            self.operate(range, &cleared)?;
        }
        Ok(())
    }
}
