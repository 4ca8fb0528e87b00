//! What is in use, and of it what is kept over a power cycle.

use slitrange::measurement::Settings;
use slitrange::protocol::calibration::FlashStatus;
use slitrange::record::Record;
use slitrange::record::encoded::EncodedRecord;
use slitrange::store::Stored;
use slitrange::store::configuration::Configuration;

use super::{measuring, tcd1304};

/// Settings and calibration.
///
/// Records take kilobytes, and so does a function that moves them, of the stack: they are not inlined, so that it is only theirs
/// while they run.
pub struct InUse {
    /// What is set.
    pub settings: Settings,
    /// What centres mean, where that is known.
    pub calibration: Option<EncodedRecord>,
    /// What is kept of it.
    pub stored: FlashStatus,
}

impl InUse {
    /// As it left the factory, with nothing kept yet.
    #[inline(never)]
    pub fn new() -> Self {
        Self {
            settings: measuring::default_settings(),
            calibration: EncodedRecord::nominal(),
            stored: FlashStatus::Nothing,
        }
    }

    /// As it left the factory.
    #[inline(never)]
    pub fn set_defaults(&mut self) {
        self.settings = measuring::default_settings();
        self.calibration = EncodedRecord::nominal();
    }

    /// Another calibration, with centres and black level found as when it was made.
    pub fn set_calibration(&mut self, record: Record) {
        self.settings.estimator = record.estimator;
        self.settings.black_level = record.black_level;
        self.set_record(record);
    }

    #[inline(never)]
    fn set_record(&mut self, record: Record) {
        // What was read can be written.
        self.calibration = EncodedRecord::new(record).ok();
    }

    /// What was kept, of one that is new. A calibration that was saved and cannot be used is not replaced by the nominal one: the sensor was
    /// somebody's, and its distances would be wrong without a word.
    #[inline(never)]
    pub fn set_kept(&mut self, kept: Stored) {
        match kept {
            Stored::Nothing => {}
            Stored::Unusable => {
                self.calibration = None;
                self.stored = FlashStatus::Damaged;
            }
            Stored::Newest(saved) => self.set_saved(saved),
            Stored::Older(saved) => {
                self.set_saved(saved);
                if let FlashStatus::Record(sum) = self.stored {
                    self.stored = FlashStatus::Older(sum);
                }
            }
        }
    }

    #[inline(never)]
    fn set_saved(&mut self, Configuration { settings, record }: Configuration) {
        self.settings = settings;
        match record {
            Some(record) if !record.geometry.has_same_words(&tcd1304::geometry()) => {
                self.calibration = None;
                self.stored = FlashStatus::OtherSensor;
                return;
            }
            Some(record) => self.set_record(record),
            None => {}
        }
        self.note_saved();
    }

    /// What is to be kept of it. Not without a calibration: the next start would take the nominal one.
    #[inline(never)]
    pub fn to_save(&self) -> Option<Configuration> {
        let record = self.calibration.as_ref()?.record();
        Some(Configuration {
            settings: self.settings,
            record: (!record.is_nominal()).then(|| record.clone()),
        })
    }

    /// It is what is kept.
    pub fn note_saved(&mut self) {
        if let Some(written) = &self.calibration {
            self.stored = FlashStatus::Record(written.sum());
        }
    }
}
