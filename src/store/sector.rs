//! A sector as `sequential-storage` sees it: a queue of a single page, which items are added to until it is full.
//!
//! The library may read it and program it. It must not erase: that is how it repairs, and what it takes for broken may be all that
//! is left.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::queue::{QueueConfig, QueueStorage};

use super::StoreError;

/// Bytes of a sector: those of sectors 12 and 13 of the chip.
pub const BYTES: u32 = 0x4000;

/// Which of the two.
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

    fn start(self) -> u32 {
        match self {
            Self::First => 0,
            Self::Second => BYTES,
        }
    }

    /// The items in it.
    pub fn queue<F: NorFlash>(self, flash: &mut F) -> Queue<'_, F> {
        let page = Page {
            flash,
            start: self.start(),
        };
        let config = const { QueueConfig::new(0..BYTES) };
        QueueStorage::new(page, config, Cache::new_uncached())
    }

    /// All of it reads as erased.
    pub async fn is_blank<F: NorFlash>(self, flash: &mut F) -> Result<bool, StoreError> {
        let mut part = [0; 256];
        let (mut at, end) = (self.start(), self.start().saturating_add(BYTES));
        while at < end {
            let read = flash.read(at, &mut part).await;
            read.map_err(|_| StoreError::Flash)?;
            if part.iter().any(|&byte| byte != 0xff) {
                return Ok(false);
            }
            at = at.saturating_add(part.len() as u32);
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

/// A sector alone, from address 0.
pub struct Page<'a, F> {
    flash: &'a mut F,
    start: u32,
}

/// Why the library could not do something.
#[derive(Debug)]
pub enum PageError {
    Flash,
    /// It is not allowed to.
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
