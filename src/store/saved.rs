//! What is kept.

use crate::calibration::record::Record;
use crate::measurement::Settings;

/// What `save` keeps: the settings, and the calibration's record where the sensor has one of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Saved {
    /// What was set.
    pub settings: Settings,
    /// The sensor's own calibration. Without it the nominal one holds.
    pub record: Option<Record>,
}
