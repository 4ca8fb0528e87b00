//! Things to save, each another, and what the store makes of them.

use embassy_futures::block_on;
use slitrange::black_level::BlackLevel;
use slitrange::centre::Estimator;
use slitrange::frame::Mean;
use slitrange::record::Record;
use slitrange::settings::Settings;
use slitrange::store::configuration::Configuration;
use slitrange::store::{Store, StoreError, Stored};
use slitrange::units::Counts;

use crate::flash::Flash;
use crate::records::{longest, nominal};

/// How long what is saved is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// The settings alone.
    Least,
    /// With a record of eq. (1).
    Middle,
    /// With the longest record.
    Most,
}

pub fn sample(size: Size, i: u32) -> Configuration {
    let settings = Settings {
        rows: 16,
        mean: Mean::Weighted,
        estimator: Estimator::PhaseTable,
        black_level: BlackLevel::Fixed(Counts::from_bits(i as i32)),
        ..Settings::default()
    };
    let record = match size {
        Size::Least => None,
        Size::Middle => Some(nominal()),
        Size::Most => Some(longest()),
    };
    Configuration {
        settings,
        record: record.map(|record| Record {
            // As long for each.
            serial_number: u32::MAX - i,
            ..record
        }),
    }
}

pub fn read(flash: &mut Flash) -> Stored {
    let (operations, before) = (flash.operations, flash.bytes.clone());
    let kept = block_on(Store::new(&mut *flash).read());
    assert!(
        flash.operations == operations && flash.bytes == before,
        "reading must only read"
    );
    kept
}

pub fn save(flash: &mut Flash, saved: &Configuration) -> Result<(), StoreError> {
    block_on(Store::new(flash).save(saved))
}

/// Saves, and it is there.
pub fn keep(flash: &mut Flash, saved: &Configuration) {
    assert_eq!(save(flash, saved), Ok(()));
    assert!(
        read(flash) == Stored::Newest(saved.clone()),
        "it is not there"
    );
}
