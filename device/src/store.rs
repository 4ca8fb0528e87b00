//! Keeps the sensor's configuration in two sectors of flash, over a power cycle.
//!
//! Each save adds an item to the sector in use. An item is a number, which rises by one with each save, and
//! the bytes of a [`Configuration`]. When the sector is full, the store erases the other sector and goes on
//! there. So the last whole item is never erased before a newer item is whole, and a power cut at any moment
//! leaves the old configuration or the new one. [`Store::read`] takes the whole and usable item with the
//! highest number, and tells if a newer save was interrupted or is damaged.
//!
//! `sequential-storage` lays out the items and checks them with a CRC-32, a sector at a time (see `sector`).
//! The library repairs a sector that looks broken by erasing, and after a torn erasure the good sector may
//! look broken. So the store does not let the library erase, and never repairs: the next save goes elsewhere.
//! The library is not ours, and not in the proof that no panic is reachable; tests and fuzzing search for
//! contents of the flash that make it panic.

pub mod configuration;
pub mod encoded_map;
mod error;
pub mod pixel_map;
mod sector;

use embedded_storage_async::nor_flash::NorFlash;

use crate::record::Record;
use configuration::{Configuration, ConfigurationError};
pub use error::StoreError;
use sector::{PageError, Sector};

/// Bytes of an item's number.
const NUMBER: usize = size_of::<u32>();

/// Bytes that the library writes before an item.
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
    /// The configuration of the last save.
    Newest(Configuration),
    /// The configuration of an earlier save. The last save was interrupted, is damaged, or is of a later
    /// firmware.
    Older(Configuration),
    /// No configuration is usable. The last one is whole, and has this later version of its format.
    Later(u8),
    /// The flash is not erased, and holds no usable configuration.
    Unusable,
}

impl Stored {
    /// The configuration, if there is a usable one.
    pub const fn configuration(&self) -> Option<&Configuration> {
        match self {
            Self::Newest(configuration) | Self::Older(configuration) => Some(configuration),
            Self::Nothing | Self::Later(_) | Self::Unusable => None,
        }
    }
}

/// What [`Store::find`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Nothing was ever saved.
    Nothing,
    /// An item of so many bytes, which the store now holds.
    Item {
        /// Its bytes.
        length: usize,
        /// It is the last save.
        is_last: bool,
    },
    /// See [`Stored::Later`].
    Later(u8),
    /// See [`Stored::Unusable`].
    Unusable,
}

/// Which of the usable items.
struct Item {
    number: u32,
    sector: Sector,
}

/// The result of a search through the items of both sectors.
#[derive(Default)]
struct Items {
    /// The highest number of all whole items, usable or not; 0 if there is none.
    last: u32,
    /// The usable item with the highest number.
    newest: Option<Item>,
    /// The sector and the version of the item with the highest number, if its version is a later one.
    later: Option<(Sector, u8)>,
}

impl<F: NorFlash> Store<F> {
    /// A store. It does not read the flash yet.
    pub const fn new(flash: F) -> Self {
        Self {
            flash,
            item: [0; LONGEST],
        }
    }

    /// The flash, for what else it holds: see [`pixel_map`].
    pub const fn flash(&mut self) -> &mut F {
        &mut self.flash
    }

    /// Reads the configuration of the last save, or of the newest earlier save that is usable. Never writes.
    /// Flash that cannot be read counts as unusable.
    pub async fn read(&mut self) -> Stored {
        let found = self.find().await;
        self.stored(found)
    }

    /// Finds what [`read`](Self::read) reads, for [`stored`](Self::stored). A task that waits for flash so
    /// needs no memory for a configuration, which has 3 KB.
    pub async fn find(&mut self) -> Found {
        match self.items().await {
            Ok(Items {
                newest: Some(newest),
                last,
                ..
            }) => {
                let is_last = newest.number == last && self.is_last(&newest).await;
                match self.read_item(&newest).await {
                    Ok(Some(length)) => Found::Item { length, is_last },
                    _ => Found::Unusable,
                }
            }
            Ok(Items {
                later: Some((_, version)),
                ..
            }) => Found::Later(version),
            Ok(_) if matches!(self.is_blank().await, Ok(true)) => Found::Nothing,
            _ => Found::Unusable,
        }
    }

    /// What flash holds, after [`find`](Self::find) and before the next use of the store.
    pub fn stored(&self, found: Found) -> Stored {
        match found {
            Found::Nothing => Stored::Nothing,
            Found::Later(version) => Stored::Later(version),
            Found::Unusable => Stored::Unusable,
            Found::Item { length, is_last } => {
                match configuration::decode(self.item.get(NUMBER..length).unwrap_or_default()) {
                    Ok(configuration) if is_last => Stored::Newest(configuration),
                    Ok(configuration) => Stored::Older(configuration),
                    Err(_) => Stored::Unusable,
                }
            }
        }
    }

    /// Whether no save was started after this item.
    async fn is_last(&mut self, newest: &Item) -> bool {
        match self.read_item(newest).await {
            Ok(Some(length)) => self.is_at_the_end(newest.sector, length).await,
            _ => false,
        }
    }

    /// Whether flash holds this item, and no save was started after it.
    async fn is_last_with(
        &mut self,
        newest: &Item,
        configuration: &Configuration<&Record>,
    ) -> bool {
        match self.write_item(newest.number, configuration) {
            Ok(length) => self.is_at_the_end(newest.sector, length).await,
            Err(_) => false,
        }
    }

    /// Whether the item in the buffer is the last thing in a sector. If the sector has no room for another
    /// item, the other sector must be erased or hold whole, older items.
    async fn is_at_the_end(&mut self, sector: Sector, length: usize) -> bool {
        let item = self.item.get(..length).unwrap_or_default();
        if !matches!(sector.ends_with(&mut self.flash, item).await, Ok(true)) {
            return false;
        }
        match sector.room(&mut self.flash).await {
            Ok(room) if (room as usize) < HEADER + LONGEST => {
                matches!(self.is_broken(sector.other()).await, Ok(false))
            }
            Ok(_) => true,
            Err(_) => false,
        }
    }

    /// Writes an item into the buffer, and gives its length.
    fn write_item(
        &mut self,
        number: u32,
        configuration: &Configuration<&Record>,
    ) -> Result<usize, StoreError> {
        let (head, body) = self.item.split_first_chunk_mut().ok_or(StoreError::Worn)?;
        *head = number.to_le_bytes();
        Ok(NUMBER.saturating_add(configuration::encode(configuration, body)?.len()))
    }

    /// Reads an item into the buffer, and gives its length.
    async fn read_item(&mut self, wanted: &Item) -> Result<Option<usize>, StoreError> {
        let mut queue = wanted.sector.queue(&mut self.flash);
        let Some(mut iterator) = none_if_corrupt(queue.iter().await)? else {
            return Ok(None);
        };
        while let Some(Some(item)) = none_if_corrupt(iterator.next(&mut self.item).await)? {
            if item.first_chunk() == Some(&wanted.number.to_le_bytes()) {
                return Ok(Some(item.len()));
            }
        }
        Ok(None)
    }

    /// Whether a sector is not erased and does not begin with a whole item.
    async fn is_broken(&mut self, sector: Sector) -> Result<bool, StoreError> {
        if sector.is_blank(&mut self.flash).await? {
            return Ok(false);
        }
        let mut queue = sector.queue(&mut self.flash);
        let Some(mut iterator) = none_if_corrupt(queue.iter().await)? else {
            return Ok(true);
        };
        let first = none_if_corrupt(iterator.next(&mut self.item).await)?;
        Ok(!matches!(first, Some(Some(_))))
    }

    /// Saves a configuration, unless it is the one of the last save. If the save fails or is interrupted, the
    /// configuration that was there before is still there.
    ///
    /// When a sector is full, a save erases the other one, which takes up to 0.8 s.
    ///
    /// # Errors
    /// [`StoreError`] says why the save failed.
    pub async fn save(&mut self, configuration: &Configuration<&Record>) -> Result<(), StoreError> {
        // Refuse what no later read would take.
        configuration::check(configuration::encode(configuration, &mut self.item)?)?;
        let Items {
            last,
            newest,
            later,
        } = self.items().await?;
        if let Some(newest) = &newest
            && newest.number == last
            && self.is_last_with(newest, configuration).await
        {
            return Ok(());
        }
        let next = match newest {
            Some(newest) => {
                if self.add(newest.sector, last, configuration).await? {
                    return Ok(());
                }
                newest.sector.other()
            }
            // Write beside unusable contents, so that a power cut during this save still leaves them to be
            // reported. Keep the last save of later firmware.
            None if let Some((sector, _)) = later => sector.other(),
            None if Sector::First.is_blank(&mut self.flash).await? => Sector::First,
            None => Sector::Second,
        };
        next.erase(&mut self.flash).await?;
        // The failed attempt to add may have uncovered items that damage had hidden.
        let Items { last, .. } = self.items().await?;
        if self.add(next, last, configuration).await? {
            Ok(())
        } else {
            Err(StoreError::Worn)
        }
    }

    async fn is_blank(&mut self) -> Result<bool, StoreError> {
        Ok(Sector::First.is_blank(&mut self.flash).await?
            && Sector::Second.is_blank(&mut self.flash).await?)
    }

    /// Adds an item to a sector. False if the sector has no room, or if damage hides the new item or looks
    /// like a newer one.
    async fn add(
        &mut self,
        sector: Sector,
        last: u32,
        configuration: &Configuration<&Record>,
    ) -> Result<bool, StoreError> {
        // The number ends only after 2^32 saves, which no flash endures.
        let number = last.checked_add(1).ok_or(StoreError::Worn)?;
        let length = self.write_item(number, configuration)?;
        let item = self.item.get(..length).unwrap_or_default();
        let pushed = sector.queue(&mut self.flash).push(item, false).await;
        if none_if_corrupt(pushed)?.is_none() {
            return Ok(false);
        }
        let Some(newest) = self.items().await?.newest else {
            return Ok(false);
        };
        Ok(newest.number == number && self.is_last_with(&newest, configuration).await)
    }

    /// Reads the items of both sectors.
    async fn items(&mut self) -> Result<Items, StoreError> {
        let mut items = Items::default();
        for sector in Sector::BOTH {
            let mut queue = sector.queue(&mut self.flash);
            let Some(mut iterator) = none_if_corrupt(queue.iter().await)? else {
                continue;
            };
            while let Some(Some(item)) = none_if_corrupt(iterator.next(&mut self.item).await)? {
                let Some((number, bytes)) = item.split_first_chunk() else {
                    continue;
                };
                let number = u32::from_le_bytes(*number);
                let is_last = number > items.last;
                items.last = items.last.max(number);
                let newest = items.newest.as_ref();
                if newest.is_some_and(|newest| newest.number >= number) {
                    continue;
                }
                let checked = configuration::check(bytes);
                if is_last {
                    let later = checked.err().and_then(ConfigurationError::later_version);
                    items.later = later.map(|version| (sector, version));
                }
                if checked.is_ok() {
                    items.newest = Some(Item { number, sector });
                }
            }
        }
        Ok(items)
    }
}

/// Converts the library's result: `None` if the library finds the contents of the sector corrupt.
fn none_if_corrupt<T>(
    result: Result<T, sequential_storage::Error<PageError>>,
) -> Result<Option<T>, StoreError> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(sequential_storage::Error::Storage {
            value: PageError::Flash,
        }) => Err(StoreError::Flash),
        Err(_) => Ok(None),
    }
}
