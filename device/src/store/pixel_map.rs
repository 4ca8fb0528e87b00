//! Keeps the map of the pixels in two sectors of flash, over a power cycle. They follow the two sectors of
//! the configuration.
//!
//! A save erases the sector that does not hold the newest whole map, and writes the map there. So a power cut
//! at any moment leaves the old map or the new one.

use embedded_storage_async::nor_flash::NorFlash;

use super::StoreError;
use super::sector::{BYTES, Sector};
use crate::store::encoded_map::{MAX_WORDS, Read, Reader, Words};
use slitrange::row::pixels::map::PixelMap;

/// Where a sector of the map starts.
fn start(sector: Sector) -> u32 {
    sector.start().saturating_add(2 * BYTES)
}

/// Bytes that are read or written together.
const PART: u32 = 64;

// A map fits a sector.
const _: () = assert!(4 * MAX_WORDS <= BYTES as usize);

/// What flash holds of a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StoredMap {
    /// Nothing: both sectors are erased.
    #[default]
    Nothing,
    /// The map of the last save.
    Newest,
    /// The map of an earlier save. The last save was interrupted, or is damaged.
    Older,
    /// No map is usable, and one has this later version of its layout.
    Later(u8),
    /// Contents that are not a map of this sensor.
    Unusable,
}

/// What a sector holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Contents {
    Erased,
    /// A whole map: the number of its save.
    Map(u32),
    /// A map in this later version of its layout.
    Later(u8),
    Damaged,
}

/// Reads the map with the highest number into `map`, if it is of a sensor with that many pixels. Otherwise
/// `map` is empty.
///
/// # Errors
/// The flash refuses to read.
pub async fn load<F: NorFlash>(
    flash: &mut F,
    pixels: usize,
    map: &mut PixelMap,
) -> Result<StoredMap, StoreError> {
    map.clear();
    let contents = look(flash, pixels).await?;
    let [first, second] = contents;
    let Some((newest, _)) = newest(contents) else {
        return Ok(match contents {
            [Contents::Erased, Contents::Erased] => StoredMap::Nothing,
            [Contents::Later(it), _] | [_, Contents::Later(it)] => StoredMap::Later(it),
            _ => StoredMap::Unusable,
        });
    };
    let other = match newest {
        Sector::First => second,
        Sector::Second => first,
    };
    match read(flash, start(newest), pixels, Some(&mut *map)).await? {
        Contents::Map(_) if matches!(other, Contents::Damaged | Contents::Later(_)) => {
            Ok(StoredMap::Older)
        }
        Contents::Map(_) => Ok(StoredMap::Newest),
        Contents::Erased | Contents::Later(_) | Contents::Damaged => {
            map.clear();
            Ok(StoredMap::Unusable)
        }
    }
}

/// Writes a map. If that fails or is interrupted, the map that was there before is still there. Takes up to 2
/// s.
///
/// # Errors
/// [`StoreError`] says why it failed.
pub async fn save<F: NorFlash>(flash: &mut F, map: &PixelMap) -> Result<(), StoreError> {
    let pixels = map.entries().len();
    let contents = look(flash, pixels).await?;
    let (sector, before) = match newest(contents) {
        Some((newest, number)) => (newest.other(), number),
        // Keep the map of later firmware.
        None if matches!(contents, [Contents::Later(_), _]) => (Sector::Second, 0),
        None => (Sector::First, 0),
    };
    let start = start(sector);
    // The number ends only after 2^32 saves, which no flash endures.
    let number = before.checked_add(1).ok_or(StoreError::Worn)?;
    erase_sector(flash, start).await?;
    let mut words = Words::new(map, number);
    let mut at = start;
    loop {
        let mut part = [0xff; PART as usize];
        let mut is_last = false;
        for place in part.as_chunks_mut::<4>().0 {
            match words.next() {
                Some(word) => *place = word,
                None => is_last = true,
            }
        }
        let written = flash.write(at, &part).await;
        written.map_err(|_| StoreError::Flash)?;
        if is_last {
            break;
        }
        at = at.saturating_add(PART);
    }
    match read(flash, start, pixels, None).await? {
        Contents::Map(found) if found == number => Ok(()),
        _ => Err(StoreError::Worn),
    }
}

/// Erases both sectors, the one with the newest map last.
///
/// # Errors
/// The flash refuses to erase.
pub async fn erase<F: NorFlash>(flash: &mut F, pixels: usize) -> Result<(), StoreError> {
    let [first, second] = look(flash, pixels).await?;
    let mut order = [(Sector::First, first), (Sector::Second, second)];
    if matches!(newest([first, second]), Some((Sector::First, _))) {
        order.reverse();
    }
    for (sector, contents) in order {
        if contents != Contents::Erased {
            erase_sector(flash, start(sector)).await?;
        }
    }
    Ok(())
}

async fn erase_sector<F: NorFlash>(flash: &mut F, start: u32) -> Result<(), StoreError> {
    let erased = flash.erase(start, start.saturating_add(BYTES)).await;
    erased.map_err(|_| StoreError::Flash)
}

/// The sector with the newest whole map, and the number of the map's save.
fn newest(contents: [Contents; 2]) -> Option<(Sector, u32)> {
    match contents {
        [Contents::Map(first), Contents::Map(second)] if second > first => {
            Some((Sector::Second, second))
        }
        [Contents::Map(first), _] => Some((Sector::First, first)),
        [_, Contents::Map(second)] => Some((Sector::Second, second)),
        _ => None,
    }
}

async fn look<F: NorFlash>(flash: &mut F, pixels: usize) -> Result<[Contents; 2], StoreError> {
    Ok([
        read(flash, start(Sector::First), pixels, None).await?,
        read(flash, start(Sector::Second), pixels, None).await?,
    ])
}

/// Reads a sector, and writes its map into `map`, if there is a place for it.
async fn read<F: NorFlash>(
    flash: &mut F,
    start: u32,
    pixels: usize,
    mut map: Option<&mut PixelMap>,
) -> Result<Contents, StoreError> {
    let mut reader = Reader::default();
    let (mut is_map, mut is_erased) = (true, true);
    let (mut at, end) = (start, start.saturating_add(BYTES));
    while at < end {
        let mut part = [0; PART as usize];
        let got = flash.read(at, &mut part).await;
        got.map_err(|_| StoreError::Flash)?;
        for &word in part.as_chunks::<4>().0 {
            if is_map {
                match reader.take(word, map.as_deref_mut()) {
                    Read::More => {}
                    Read::Whole(number) if reader.pixels() == pixels => {
                        return Ok(Contents::Map(number));
                    }
                    Read::Later(version) => return Ok(Contents::Later(version)),
                    Read::Whole(_) | Read::NoMap => is_map = false,
                }
            }
            is_erased &= word == [0xff; 4];
            if !is_map && !is_erased {
                return Ok(Contents::Damaged);
            }
        }
        at = at.saturating_add(PART);
    }
    Ok(match is_erased {
        true => Contents::Erased,
        false => Contents::Damaged,
    })
}
