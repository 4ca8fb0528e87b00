//! What is in use, and of it what is kept over a power cycle.

use slitrange::calibration::written::Written;
use slitrange::measurement::Settings;
use slitrange::protocol::calibration::Stored;
use slitrange::store::Kept;
use slitrange::store::saved::Saved;

use super::{measuring, tcd1304};

/// Settings and calibration.
pub struct InUse {
    /// What is set.
    pub settings: Settings,
    /// What centres mean, where that is known.
    pub calibration: Option<Written>,
    /// What is kept of it.
    pub stored: Stored,
}

impl InUse {
    /// What is in use from the start on. A calibration that was saved and cannot be used is not replaced by the nominal one: the
    /// sensor was somebody's, and its distances would be wrong without a word.
    pub fn from(kept: Kept) -> Self {
        match kept {
            Kept::Nothing => Self {
                settings: measuring::default_settings(),
                calibration: Written::nominal(),
                stored: Stored::Nothing,
            },
            Kept::Unusable => Self {
                settings: measuring::default_settings(),
                calibration: None,
                stored: Stored::Damaged,
            },
            Kept::Saved(Saved { settings, record }) => {
                let (calibration, stored) = match record {
                    Some(record) if record.geometry != tcd1304::geometry() => {
                        (None, Stored::OtherSensor)
                    }
                    Some(record) => kept_as(Written::new(record).ok()),
                    None => kept_as(Written::nominal()),
                };
                Self {
                    settings,
                    calibration,
                    stored,
                }
            }
        }
    }

    /// What is to be kept of it. Not without a calibration: the next start would take the nominal one.
    pub fn to_save(&self) -> Option<Saved> {
        let record = self.calibration.as_ref()?.record();
        Some(Saved {
            settings: self.settings,
            record: (!record.is_nominal()).then(|| record.clone()),
        })
    }

    /// It was saved.
    pub fn saved(&mut self) {
        if let Some(written) = &self.calibration {
            self.stored = Stored::Record(written.sum());
        }
    }
}

/// A calibration that is kept.
fn kept_as(calibration: Option<Written>) -> (Option<Written>, Stored) {
    let stored = calibration
        .as_ref()
        // What was read can be written.
        .map_or(Stored::Damaged, |written| Stored::Record(written.sum()));
    (calibration, stored)
}
