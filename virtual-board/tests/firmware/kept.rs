//! Saves and reads configurations in flash on this PC, and compares them with a board that reads the same
//! flash.

use std::convert::Infallible;

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use slitrange::row::pixels::map::{MAX_MAP_PIXELS, PixelMap};
use slitrange_device::store::Store;
use slitrange_device::store::pixel_map;
use virtual_board::flash::FIRST_SECTOR;

use super::common::*;
use super::records::{assert_shown, written};

pub fn configuration(record: Record, rows: u16, mean: Mean) -> Configuration {
    Configuration {
        settings: Settings {
            rows,
            mean,
            estimator: record.estimator,
            black_level: record.black_level,
            ..Settings::default()
        },
        record: Some(record),
    }
}

pub fn save(contents: &mut Contents, saved: &Configuration) {
    block_on(Store::new(Flash(contents)).save(&saved.as_ref())).expect("sound flash");
}

pub fn read(contents: &Contents) -> Stored {
    let mut read = contents.clone();
    let kept = block_on(Store::new(Flash(&mut read)).read());
    assert_eq!(read, *contents, "reading only reads");
    kept
}

pub fn map_in(contents: &Contents) -> (StoredMap, Option<Box<PixelMap>>) {
    let mut read = contents.clone();
    let mut map = Box::new(PixelMap::EMPTY);
    let mut flash = Flash(&mut read);
    let loaded = block_on(pixel_map::load(&mut flash, MAX_MAP_PIXELS, &mut map));
    let stored = loaded.expect("sound flash");
    assert_eq!(read, *contents, "reading only reads");
    (stored, map.is_whole().then_some(map))
}

pub fn saved_in(contents: &Contents) -> Configuration {
    match read(contents) {
        Stored::Newest(saved) | Stored::Older(saved) => saved,
        other => panic!("{other:?} in {contents:?}"),
    }
}

/// Asserts that a board that found `kept` in its flash reports it. Gives the calibration in use.
pub fn assert_shown_as(board: &mut VirtualBoard, kept: &Stored) -> Option<EncodedRecord> {
    let record = kept.configuration().and_then(|saved| saved.record.clone());
    let calibration = match kept {
        Stored::Later(_) | Stored::Unusable => None,
        _ => record.map_or_else(EncodedRecord::nominal, |it| Some(written(it))),
    };
    let stored = match (kept, &calibration) {
        (Stored::Newest(_), Some(written)) => FlashStatus::Record(written.sum()),
        (Stored::Older(_), Some(written)) => FlashStatus::Older(written.sum()),
        (Stored::Nothing, _) => FlashStatus::Nothing,
        (&Stored::Later(version), _) => FlashStatus::Later(version),
        _ => FlashStatus::Damaged,
    };
    assert_shown(board, calibration.as_ref(), stored);
    if let Some(saved) = kept.configuration() {
        assert_eq!(ask(board, "rows"), format!("rows {}", saved.settings.rows));
    }
    calibration
}

/// Asserts that the board reports `kept`, measures with its settings, and gives distances if it has a
/// calibration.
pub fn assert_in_use(board: &mut VirtualBoard, kept: &Stored) {
    let calibration = assert_shown_as(board, kept);
    let results = fresh_results(board, 1);
    let is_as_kept = match calibration {
        Some(_) => is_reading(&results[0]),
        None => results[0].starts_with("f not calibrated: "),
    };
    assert!(is_as_kept, "{results:?} with {kept:?}");
}

struct Flash<'a>(&'a mut Contents);

impl ErrorType for Flash<'_> {
    type Error = Infallible;
}

impl ReadNorFlash for Flash<'_> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        let start = offset as usize;
        bytes.copy_from_slice(&self.0.bytes()[start..start + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        BYTES
    }
}

impl NorFlash for Flash<'_> {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        for sector in from as usize / SECTOR_BYTES..to as usize / SECTOR_BYTES {
            let sector = FIRST_SECTOR + sector;
            self.0.apply(Operation::Erase { sector });
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        let (words, _) = bytes.as_chunks();
        for (address, word) in (BASE + u64::from(offset)..).step_by(4).zip(words) {
            let word = u32::from_le_bytes(*word);
            self.0.apply(Operation::Program { address, word });
        }
        Ok(())
    }
}
