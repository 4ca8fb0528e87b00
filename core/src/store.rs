//! What a sensor keeps over a power cycle, in two sectors of flash.
//!
//! Each save adds an item to the sector in use: a number that counts on, and [`saved`]'s bytes. When the sector is full, the other is
//! erased and is the one in use. So what was saved before is never erased until something newer is whole, and a power cut at any
//! moment leaves the old or the new. What is read is the item with the highest number of those that are whole and usable, and
//! whether something newer was begun that is not.
//!
//! `sequential-storage` lays out the items and checks them with a CRC-32, a sector at a time (see `sector`). It repairs what it takes
//! for broken by erasing, which a half-erased sector can turn against the good one: so it cannot erase here, and nothing is ever
//! repaired; the next save overwrites instead. The library is not ours, and not in the proof that no panic is reachable: tests and
//! fuzzing look for contents of the flash that it would panic on.

pub mod configuration;
mod sector;

use core::fmt;

use embedded_storage_async::nor_flash::NorFlash;

use configuration::{Configuration, ConfigurationError};
use sector::{PageError, Sector};

/// Bytes of an item's number.
const NUMBER: usize = size_of::<u32>();

/// Bytes that the library puts before an item.
const HEADER: usize = 8;

/// The longest item, in whole words of flash.
const LONGEST: usize = (NUMBER + configuration::MAX_ENCODED).next_multiple_of(4);

/// The store, in the first 32 KB of a flash with sectors of 16 KB that is programmed in words of 4 bytes.
pub struct Store<F> {
    flash: F,
    item: [u8; LONGEST],
}

/// What flash holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stored {
    /// Nothing was ever saved: the flash is erased.
    Nothing,
    /// What was saved last.
    Newest(Configuration),
    /// What was saved before. Something newer was begun: it was interrupted, is damaged, or is of a later firmware.
    Older(Configuration),
    /// Something was there, and nothing usable is left of it.
    Unusable,
}

impl Stored {
    /// What there is to use.
    pub const fn saved(&self) -> Option<&Configuration> {
        match self {
            Self::Newest(saved) | Self::Older(saved) => Some(saved),
            Self::Nothing | Self::Unusable => None,
        }
    }
}

/// An item that can be used.
struct Item {
    number: u32,
    sector: Sector,
    saved: Configuration,
}

/// All items.
struct Items {
    /// The highest number, of those too that cannot be used; 0 if there is none.
    last: u32,
    newest: Option<Item>,
}

impl<F: NorFlash> Store<F> {
    /// A store. Nothing is read yet.
    pub const fn new(flash: F) -> Self {
        Self {
            flash,
            item: [0; LONGEST],
        }
    }

    /// What was saved last, or else before. Reads only. Flash that cannot be read is unusable.
    pub async fn read(&mut self) -> Stored {
        match self.items().await {
            Ok(Items {
                newest: Some(newest),
                last,
            }) => {
                let is_last = newest.number == last && self.is_last(&newest).await;
                if is_last {
                    Stored::Newest(newest.saved)
                } else {
                    Stored::Older(newest.saved)
                }
            }
            Ok(_) if matches!(self.is_blank().await, Ok(true)) => Stored::Nothing,
            _ => Stored::Unusable,
        }
    }

    /// Nothing was begun after an item: it is what its sector ends with; and where that has no room for any other, nothing is in the other
    /// sector but whole items, all of them older.
    async fn is_last(&mut self, newest: &Item) -> bool {
        let sector = newest.sector;
        let other_is_newer = match sector.room(&mut self.flash).await {
            Ok(room) if room < (HEADER + LONGEST) as u32 => self.is_broken(sector.other()).await,
            Ok(_) => Ok(false),
            Err(error) => Err(error),
        };
        let Some((head, body)) = self.item.split_first_chunk_mut() else {
            return false;
        };
        *head = newest.number.to_le_bytes();
        let Ok(length) = configuration::encode(&newest.saved, body).map(<[u8]>::len) else {
            return false;
        };
        let item = self.item.get(..NUMBER.saturating_add(length));
        let ends_with = newest
            .sector
            .ends_with(&mut self.flash, item.unwrap_or_default());
        matches!(other_is_newer, Ok(false)) && matches!(ends_with.await, Ok(true))
    }

    /// There is something in a sector, and no whole item.
    async fn is_broken(&mut self, sector: Sector) -> Result<bool, StoreError> {
        if sector.is_blank(&mut self.flash).await? {
            return Ok(false);
        }
        let mut queue = sector.queue(&mut self.flash);
        let Some(mut iterator) = done(queue.iter().await)? else {
            return Ok(true);
        };
        let first = done(iterator.next(&mut self.item).await)?;
        Ok(!matches!(first, Some(Some(_))))
    }

    /// Saves, unless just that is what was saved last. If it is interrupted, or fails, what was saved before is still there.
    ///
    /// It erases a sector where needed, which takes up to 0.8 s.
    ///
    /// # Errors
    /// [`StoreError`] says why it could not.
    pub async fn save(&mut self, saved: &Configuration) -> Result<(), StoreError> {
        let Items { last, newest } = self.items().await?;
        if let Some(newest) = &newest
            && newest.saved == *saved
            && newest.number == last
            && self.is_last(newest).await
        {
            return Ok(());
        }
        let next = match newest {
            Some(newest) => {
                if self.add(newest.sector, last, saved).await? {
                    return Ok(());
                }
                newest.sector.other()
            }
            // What is unusable stays to be seen until something usable is whole: one of two sectors in which there is something.
            None if Sector::First.is_blank(&mut self.flash).await? => Sector::First,
            None => Sector::Second,
        };
        next.erase(&mut self.flash).await?;
        // What was tried may have brought items to light that damage had hidden.
        let Items { last, .. } = self.items().await?;
        if self.add(next, last, saved).await? {
            Ok(())
        } else {
            Err(StoreError::Worn)
        }
    }

    async fn is_blank(&mut self) -> Result<bool, StoreError> {
        Ok(Sector::First.is_blank(&mut self.flash).await?
            && Sector::Second.is_blank(&mut self.flash).await?)
    }

    /// Adds an item to a sector. False if it has no room, or if damage hides the new item or looks like a newer one.
    async fn add(
        &mut self,
        sector: Sector,
        last: u32,
        saved: &Configuration,
    ) -> Result<bool, StoreError> {
        // So many saves no flash endures.
        let number = last.checked_add(1).ok_or(StoreError::Worn)?;
        let (head, body) = self.item.split_first_chunk_mut().ok_or(StoreError::Worn)?;
        *head = number.to_le_bytes();
        let length = NUMBER.saturating_add(configuration::encode(saved, body)?.len());
        let item = self.item.get(..length).unwrap_or_default();
        let pushed = sector.queue(&mut self.flash).push(item, false).await;
        if done(pushed)?.is_none() {
            return Ok(false);
        }
        let Some(newest) = self.items().await?.newest else {
            return Ok(false);
        };
        Ok(newest.number == number && newest.saved == *saved && self.is_last(&newest).await)
    }

    /// Goes through the items of both sectors.
    async fn items(&mut self) -> Result<Items, StoreError> {
        let mut items = Items {
            last: 0,
            newest: None,
        };
        for sector in Sector::BOTH {
            let mut queue = sector.queue(&mut self.flash);
            let Some(mut iterator) = done(queue.iter().await)? else {
                continue;
            };
            while let Some(Some(item)) = done(iterator.next(&mut self.item).await)? {
                let Some((number, bytes)) = item.split_first_chunk() else {
                    continue;
                };
                let number = u32::from_le_bytes(*number);
                items.last = items.last.max(number);
                if items
                    .newest
                    .as_ref()
                    .is_some_and(|newest| newest.number >= number)
                {
                    continue;
                }
                if let Ok(saved) = configuration::decode(bytes) {
                    items.newest = Some(Item {
                        number,
                        sector,
                        saved,
                    });
                }
            }
        }
        Ok(items)
    }
}

/// None if the library could not do it with what is in the sector.
fn done<T>(
    result: Result<T, sequential_storage::Error<PageError>>,
) -> Result<Option<T>, StoreError> {
    match result {
        Ok(done) => Ok(Some(done)),
        Err(sequential_storage::Error::Storage {
            value: PageError::Flash,
        }) => Err(StoreError::Flash),
        Err(_) => Ok(None),
    }
}

/// Why something could not be saved. What was saved before is still there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    /// It is nothing that could be read again.
    Saved(ConfigurationError),
    /// The flash refused.
    Flash,
    /// The flash did, but does not keep what is written to it.
    Worn,
}

impl From<ConfigurationError> for StoreError {
    fn from(error: ConfigurationError) -> Self {
        Self::Saved(error)
    }
}

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Saved(error) => error.fmt(f),
            Self::Flash => f.write_str(
                "the flash did not do as it was told, what was saved before still holds: save again",
            ),
            Self::Worn => f.write_str(
                "the flash does not keep what is written, what was saved before still holds: save again, and if that does not help, replace the sensor's board",
            ),
        }
    }
}

impl core::error::Error for StoreError {}
