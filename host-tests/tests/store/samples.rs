//! Configurations to save, each one different, and the store around a flash.

use super::flash::Flash;
use crate::records::{longest, nominal};
use crate::support::*;
use embassy_futures::block_on;
use slitrange_device::store::Store;
use slitrange_device::store::configuration::{MAX_ENCODED, encode};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    Least,
    /// With a record of eq. (1).
    Middle,
    /// With the longest record.
    Most,
}

pub fn sample(size: Size, i: u32) -> Configuration {
    // Different for each `i`, and of the same length.
    let settings = with(Settings::default(), |it| {
        (it.rows, it.estimator) = (10 + (i / 3000 % 50) as u16, Estimator::PhaseTable);
        it.black_level = BlackLevel::Fixed(Counts::from_int(1000 + (i % 3000) as i32));
    });
    let record = match size {
        Size::Least => None,
        Size::Middle => Some(nominal()),
        Size::Most => Some(longest()),
    };
    let record = record.map(|record| with(record, |it| it.serial_number = u32::MAX - i));
    Configuration { settings, record }
}

/// Bytes of an item: the library's header, the number, the configuration; without the last word's filling.
pub fn item_bytes(size: Size) -> usize {
    let mut buffer = [0; MAX_ENCODED];
    let bytes = encode(&sample(size, 0).as_ref(), &mut buffer).expect("a usable configuration");
    HEADER + NUMBER + bytes.len()
}

/// Bytes of the library's header of an item.
pub const HEADER: usize = 8;
/// Bytes of an item's number.
pub const NUMBER: usize = 4;

pub fn read(flash: &mut Flash) -> Stored {
    let (operations, before) = (flash.operations, flash.bytes.clone());
    let stored = block_on(Store::new(&mut *flash).read());
    let is_as_before = flash.operations == operations && flash.bytes == before;
    assert!(is_as_before, "reading must only read");
    stored
}

pub fn save(flash: &mut Flash, saved: &Configuration) -> Result<(), StoreError> {
    block_on(Store::new(flash).save(&saved.as_ref()))
}

pub fn save_and_check(flash: &mut Flash, saved: &Configuration) {
    assert_eq!(save(flash, saved), Ok(()));
    let is_there = read(flash) == Stored::Newest(saved.clone());
    assert!(is_there, "the configuration is not there");
}

/// A flash after saves of these sizes, with what was saved.
pub fn saves(sizes: &[Size]) -> (Flash, Vec<Configuration>) {
    let mut flash = Flash::erased();
    let saved = (0..).zip(sizes).map(|(i, &size)| sample(size, i));
    let saved: Vec<Configuration> = saved.collect();
    for saved in &saved {
        save_and_check(&mut flash, saved);
    }
    (flash, saved)
}
