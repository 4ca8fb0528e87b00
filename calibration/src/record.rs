//! From fitted curves to the record that a sensor holds.
//!
//! ```text
//! tabulate -> form -> errors, profile -> record
//! ```

pub mod errors;
pub mod form;
pub mod profile;
pub mod surface;
pub mod tabulate;
pub mod verdict;

use slitrange::row::sensor_heads::tcd1304dg;
use slitrange_device::record::Record;
use slitrange_device::record::date::Date;
use slitrange_device::settings::Settings;

use crate::fit::comb::FittedComb;
use crate::fit::solve::Solved;
use crate::points::Setup;
use form::Made;

/// The record of a calibration, for the sensor and the settings with which its points were taken. A setup
/// without an estimator or a black level is taken to be that of the factory.
pub fn of(
    setup: &Setup,
    date: Date,
    solved: &Solved,
    made: &Made<'_>,
    comb: Option<&FittedComb>,
) -> Record {
    let factory = Settings::default();
    Record {
        serial_number: setup.serial_number.unwrap_or(0),
        date,
        geometry: tcd1304dg(),
        estimator: setup.estimator.unwrap_or(factory.estimator),
        black_level: setup.black_level.unwrap_or(factory.black_level),
        calibration: made.calibration.clone(),
        errors: errors::of(solved, made),
        profile: profile::of(solved, &made.calibration),
        comb: comb.map(|comb| comb.comb.clone()),
        // `calibrate write` takes over the front end that the sensor has.
        front_end: None,
    }
}
