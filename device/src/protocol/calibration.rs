//! The answer to `calibration`: the calibration in use, and what flash holds.

use core::fmt;

use super::command::Command;
use crate::record::{self, Record};
use crate::settings::Value;
use crate::store::configuration::ConfigurationError;
use slitrange::base::units::{InUnits, Units};
use slitrange::distance::Calibration;

/// The calibration that flash keeps over a power cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashStatus {
    /// Nothing was ever saved.
    Nothing,
    /// The saved configuration is damaged.
    Damaged,
    /// The saved configuration has this later version of its format.
    Later(u8),
    /// The saved calibration is of another sensor head.
    OtherSensor,
    /// The record with this CRC-32.
    Record(u32),
    /// The record with this CRC-32, of an earlier save: the last save was interrupted, or is damaged.
    Older(u32),
}

impl FlashStatus {
    /// Whether flash holds a calibration other than the one with this CRC-32.
    pub fn holds_other(self, sum: u32) -> bool {
        match self {
            Self::Nothing | Self::Damaged => false,
            Self::OtherSensor | Self::Later(_) => true,
            Self::Record(stored) | Self::Older(stored) => stored != sum,
        }
    }
}

/// The answer to `calibration`, lines parted by CR LF. The first is `calibration on`, `calibration off` or,
/// without a calibration, `calibration none`. The others are `calibration`, a name and a value, and the last
/// of them is `stored`.
#[derive(Clone, Copy, Debug)]
pub struct CalibrationAnswer<'a> {
    /// The calibration in use, if there is one.
    pub record: Option<&'a Record>,
    /// Whether frames become distances.
    pub is_on: bool,
    /// What flash holds.
    pub stored: FlashStatus,
    /// The unit of lengths.
    pub units: Units,
}

impl fmt::Display for CalibrationAnswer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.record {
            None => f.write_str("calibration none")?,
            Some(record) => self.write_record(record, f)?,
        }
        match self.stored {
            FlashStatus::Nothing | FlashStatus::Record(_) => {}
            FlashStatus::Later(version) => {
                let error = ConfigurationError::Version { version };
                write!(f, "\r\ncalibration fault {error}")?;
            }
            FlashStatus::Damaged => f.write_str(
                "\r\ncalibration fault what was saved cannot be used: upload it again, or defaults, then save",
            )?,
            FlashStatus::Older(_) => f.write_str(
                "\r\ncalibration fault the last save is unusable, flash holds an earlier one: upload the \
                 calibration again, or save",
            )?,
            FlashStatus::OtherSensor => f.write_str(
                "\r\ncalibration fault what was saved is of another sensor head: upload this one's \
                 calibration, then save",
            )?,
        }
        write!(f, "\r\ncalibration stored {}", self.stored_word())
    }
}

impl CalibrationAnswer<'_> {
    fn write_record(&self, record: &Record, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match record.calibration {
            Calibration::Eq1(_) => "eq1",
            Calibration::Table(_) => "table",
            Calibration::Corrected(_) => "corrected",
        };
        write!(f, "{}", Command::Calibration(Some(self.is_on)))?;
        write!(f, "\r\ncalibration source {}", self.source(record))?;
        write!(f, "\r\ncalibration kind {kind}")?;
        let (bytes, sum) = record::with_bytes(record, |bytes| (bytes.len(), record::sum_of(bytes)));
        write!(f, "\r\ncalibration record {bytes} {sum:08x}")?;
        write!(f, "\r\ncalibration serial {}", record.serial_number)?;
        write!(f, "\r\ncalibration date {}", record.date)?;
        write!(f, "\r\ncalibration estimator {}", record.estimator.name())?;
        let black = Value::Black(record.black_level);
        write!(f, "\r\ncalibration {black}")?;
        if let Some(comb) = &record.comb {
            write!(f, "\r\ncalibration slits {}", comb.slits().len())?;
        }
        let front_end = match record.front_end {
            Some(_) => "measured",
            None => "assumed",
        };
        write!(f, "\r\ncalibration front-end {front_end}")?;
        let (first, last) = record.calibration.valid();
        write!(f, "\r\ncalibration centres {first} {last} px")?;
        if let Ok(distances) = record.calibration.distances() {
            let [least, most] = [distances.start(), distances.end()];
            let [least, most] = [least, most].map(|&length| InUnits(length, self.units));
            write!(
                f,
                "\r\ncalibration distances {least} {most} {}",
                self.units.name()
            )?;
        }
        Ok(())
    }

    fn source(&self, record: &Record) -> &'static str {
        if record.is_nominal() {
            "default"
        } else if self.stored_word() == "same" {
            "stored"
        } else {
            "uploaded"
        }
    }

    /// The last line's value: how the record in flash compares with the record in use.
    fn stored_word(&self) -> &'static str {
        match self.stored {
            FlashStatus::Nothing => "none",
            FlashStatus::Damaged | FlashStatus::OtherSensor | FlashStatus::Later(_) => "unusable",
            FlashStatus::Record(sum) | FlashStatus::Older(sum) => {
                let is_same = self.record.map(record::sum) == Some(sum);
                if is_same { "same" } else { "other" }
            }
        }
    }
}
