//! A sector for `sequential-storage`: a queue of a single page, to which items are added until it is full.
//!
//! The library may read and program a sector. It must not erase: it erases to repair, and the sector that it
//! takes for broken may hold the only usable configuration.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::queue::{QueueConfig, QueueStorage};

use super::error::StoreError;

/// Bytes of a sector: the size of the chip's sectors 12 and 13.
pub const BYTES: u32 = 0x4000;

/// One of the two sectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sector {
    First,
    Second,
}

impl Sector {
    pub const BOTH: [Self; 2] = [Self::First, Self::Second];

    pub fn other(self) -> Self {
        match self {
            Self::First => Self::Second,
            Self::Second => Self::First,
        }
    }

    pub fn start(self) -> u32 {
        match self {
            Self::First => 0,
            Self::Second => BYTES,
        }
    }

    /// The queue of the sector's items.
    pub fn queue<F: NorFlash>(self, flash: &mut F) -> Queue<'_, F> {
        let page = Page {
            flash,
            start: self.start(),
        };
        let config = const { QueueConfig::new(0..BYTES) };
        QueueStorage::new(page, config, Cache::new_uncached())
    }

    /// Whether the whole sector reads as erased.
    pub async fn is_blank<F: NorFlash>(self, flash: &mut F) -> Result<bool, StoreError> {
        const PART: u32 = 256;
        let mut part = [0; PART as usize];
        let (mut at, end) = (self.start(), self.start().saturating_add(BYTES));
        while at < end {
            let read = flash.read(at, &mut part).await;
            read.map_err(|_| StoreError::Flash)?;
            if part.iter().any(|&byte| byte != 0xff) {
                return Ok(false);
            }
            at = at.saturating_add(PART);
        }
        Ok(true)
    }

    /// Erased bytes at the end of the sector.
    pub async fn room<F: NorFlash>(self, flash: &mut F) -> Result<u32, StoreError> {
        let end = self.programmed(flash).await?;
        Ok(BYTES.saturating_sub(4).saturating_sub(end))
    }

    /// Whether an item is the last thing that was programmed. Items begin at whole words.
    pub async fn ends_with<F: NorFlash>(
        self,
        flash: &mut F,
        item: &[u8],
    ) -> Result<bool, StoreError> {
        // The item includes the bytes that fill up its last word.
        #[expect(clippy::cast_possible_truncation, reason = "an item fits a sector")]
        let length = (item.len() as u32).next_multiple_of(4);
        let end = self.programmed(flash).await?;
        // The item's own last bytes may read as erased: at most as many as its CRC-32 has.
        let first = end.saturating_sub(length).next_multiple_of(4);
        for start in [first, first.saturating_add(4)] {
            if start.saturating_add(length) >= end && self.has_at(flash, start, item).await? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The end of what was programmed. The last word does not count: it marks the sector as full.
    async fn programmed<F: NorFlash>(self, flash: &mut F) -> Result<u32, StoreError> {
        const PART: u32 = 64;
        let mut end = 0;
        let mut at = 0;
        while at < BYTES {
            let mut part = [0; PART as usize];
            let read = flash.read(self.start().saturating_add(at), &mut part).await;
            read.map_err(|_| StoreError::Flash)?;
            let is_last = at.saturating_add(PART) >= BYTES;
            let items = part.len() - if is_last { 4 } else { 0 };
            let last = part.iter().take(items).rposition(|&byte| byte != 0xff);
            if let Some(Ok(last)) = last.map(u32::try_from) {
                end = at.saturating_add(last).saturating_add(1);
            }
            at = at.saturating_add(PART);
        }
        Ok(end)
    }

    async fn has_at<F: NorFlash>(
        self,
        flash: &mut F,
        start: u32,
        bytes: &[u8],
    ) -> Result<bool, StoreError> {
        if (start as usize).saturating_add(bytes.len()) > BYTES as usize {
            return Ok(false);
        }
        let mut at = self.start().saturating_add(start);
        for expected in bytes.chunks(4) {
            let mut word = [0; 4];
            let read = flash.read(at, &mut word).await;
            read.map_err(|_| StoreError::Flash)?;
            if word.get(..expected.len()) != Some(expected) {
                return Ok(false);
            }
            at = at.saturating_add(4);
        }
        Ok(true)
    }

    pub async fn erase<F: NorFlash>(self, flash: &mut F) -> Result<(), StoreError> {
        let start = self.start();
        let erased = flash.erase(start, start.saturating_add(BYTES)).await;
        erased.map_err(|_| StoreError::Flash)
    }
}

pub type Queue<'a, F> = QueueStorage<Page<'a, F>, Cache<Uncached, Uncached, Uncached, ()>>;

/// A sector as a flash of its own, from address 0.
pub struct Page<'a, F> {
    flash: &'a mut F,
    start: u32,
}

/// The error that the library gets from a [`Page`].
#[derive(Debug)]
pub enum PageError {
    Flash,
    /// The library must not erase.
    Erase,
}

impl NorFlashError for PageError {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<F: NorFlash> ErrorType for Page<'_, F> {
    type Error = PageError;
}

impl<F: NorFlash> ReadNorFlash for Page<'_, F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        let at = self.start.saturating_add(offset);
        let read = self.flash.read(at, bytes).await;
        read.map_err(|_| PageError::Flash)
    }

    fn capacity(&self) -> usize {
        BYTES as usize
    }
}

impl<F: NorFlash> NorFlash for Page<'_, F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = {
        assert!(
            F::ERASE_SIZE == BYTES as usize,
            "the store is made for sectors of 16 KB"
        );
        BYTES as usize
    };

    async fn erase(&mut self, _: u32, _: u32) -> Result<(), Self::Error> {
        Err(PageError::Erase)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        let at = self.start.saturating_add(offset);
        let written = self.flash.write(at, bytes).await;
        written.map_err(|_| PageError::Flash)
    }
}
