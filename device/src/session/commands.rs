//! What each command does.

use core::fmt;
use core::ops::RangeInclusive;

use crate::filters::{Limits, SpikeFilter, step};
use crate::protocol::calibration::CalibrationAnswer;
use crate::protocol::command::Command;
use crate::protocol::help::{Estimators, Help};
use crate::protocol::info::{Info, Range};
use crate::protocol::piece::Piece;
use crate::protocol::refusal::Refusal;
use crate::protocol::status::{Errors, Status, Uptime, Vitals};
use crate::protocol::upload::Step;
use crate::record;
use crate::session::{Actions, Session, record_of_factory};
use crate::settings::lengths::write_lengths;
use crate::settings::trigger::Trigger;
use crate::settings::{Affects, Setting, Settings, Value};
use slitrange::base::units::Micrometres;
use slitrange::spot::region::Region;

impl Session {
    pub(super) fn execute(
        &mut self,
        command: Command,
        vitals: &Vitals,
        actions: &mut Actions,
    ) -> Result<(), Refusal> {
        match command {
            Command::Nothing => {}
            Command::Help => actions.add_line(&Help(self.settings.units)),
            Command::HelpEstimator => actions.add_line(&Estimators),
            Command::Info => actions.add_line(&Info {
                hardware: &self.hardware,
                geometry: &self.geometry(),
                settings: &self.settings,
                record: self.record(),
                is_calibration_on: self.calibration_on,
                pixels: self.pixels,
            }),
            Command::Status => actions.add_line(&Status {
                started_by: self.started_by,
                vitals,
                readings: self.readings,
                faults: self.faults,
                is_within_limits: self.is_within_limits(),
            }),
            Command::Errors => actions.add_line(&Errors {
                vitals,
                faults: &self.faults,
            }),
            Command::Uptime => actions.add_line(&Uptime(vitals.uptime_us)),
            Command::Selftest => actions.test = true,
            Command::Reset => {
                actions.reset = true;
                actions.add_line(&command);
            }
            // The next frame answers.
            Command::Distance => self.wanted.distance = true,
            Command::Measure if self.settings.trigger == Trigger::Continuous => {
                return Err(Refusal::NotTriggered);
            }
            Command::Measure => self.wanted.result = true,
            Command::Centre => self.wanted.centre = true,
            Command::Uncertainty => self.wanted.parts = true,
            Command::Row(part) => actions.row = Some(part),
            Command::Zero(true) => self.wanted.zero = Some(Micrometres::default()),
            Command::Master(None) => match &self.zero {
                Some(zero) => {
                    let (value, units) = (zero.value, self.settings.units);
                    let value = fmt::from_fn(|f| write_lengths(f, &[value], Some(units)));
                    actions.add_line(&format_args!("master {value}"));
                }
                None => actions.add_line(&Command::Zero(false)),
            },
            Command::Master(Some(value)) => self.wanted.zero = Some(value),
            Command::Zero(false) => {
                (self.zero, self.wanted.zero) = (None, None);
                actions.add_line(&command);
            }
            Command::Show(setting) => {
                let value = self.settings.get(setting);
                actions.add_line(&value.in_units(self.settings.units));
            }
            Command::Set(value) => {
                if let Value::Region(region) = value {
                    self.check_region(region)?;
                }
                let sent_packets = self.sends_packets();
                self.settings.set(value);
                // Ends the line that a reader of text takes the packets for.
                if sent_packets && !self.sends_packets() {
                    actions.add_line(&"");
                }
                match value {
                    Value::Estimator(_) | Value::Black(_) | Value::Slits(_) => {
                        self.forget_readings()
                    }
                    Value::Limits(_) => self.filters.is_within = false,
                    _ => {}
                }
                if value.setting().affects() == Affects::Measurement {
                    self.filters.clear();
                    actions.apply = Some(self.applied());
                }
                self.warn_beyond_range(value, actions);
                actions.add_line(&value.in_units(self.settings.units));
                if matches!(value, Value::Format(_) | Value::Output(_) | Value::Plain(_)) {
                    self.add_header(actions);
                }
            }
            Command::Calibration(None) => actions.add_line(&CalibrationAnswer {
                record: self.record(),
                is_on: self.calibration_on,
                stored: self.flash,
                units: self.settings.units,
            }),
            Command::Calibration(Some(on)) => {
                if on && self.record.is_none() {
                    return Err(self.no_calibration());
                }
                self.calibration_on = on;
                self.filters.clear();
                actions.apply = Some(self.applied());
                actions.add_line(&command);
            }
            Command::Data(offset) => actions.add_line(&self.piece(offset)?),
            Command::Upload(step) => {
                self.upload(step, actions)?;
                actions.add_line(&command);
            }
            Command::Defaults => {
                self.set_defaults();
                actions.apply = Some(self.applied());
                actions.add_line(&command);
                self.add_header(actions);
            }
            Command::Save | Command::SaveNominal => {
                self.check_save(command)?;
                actions.save = true;
                actions.add_line(&"save pauses the stream");
            }
            Command::Flat(flat) => self.flat.execute(flat, actions)?,
        }
        Ok(())
    }

    /// Names the range of the calibration where a length of a setting reaches beyond it. The line comes
    /// before the answer, so that the answer is the last line.
    fn warn_beyond_range(&self, value: Value, actions: &mut Actions) {
        let record = self.record().filter(|_| self.calibration_on);
        let distances = record.and_then(|record| record.calibration.distances().ok());
        let Some((least, most)) = distances.map(RangeInclusive::into_inner) else {
            return;
        };
        let [least, most] = [least, most].map(|it| self.zero.map_or(it, |zero| zero.distance(it)));
        let is_beyond = match value {
            Value::Limits(Limits::Within { low, high, .. }) => low < least || high > most,
            Value::SpikeFilter(SpikeFilter::Beyond(jump)) => jump > step(least, most),
            _ => false,
        };
        if is_beyond {
            let range = Range(&[least, most], self.settings.units);
            actions.add_line(&format_args!(
                "(beyond what the calibration measures, {range})"
            ));
        }
    }

    /// Refuses a `save`, or a `save nominal`, that has nothing to save or would lose a calibration.
    pub(super) fn check_save(&self, command: Command) -> Result<(), Refusal> {
        let record = (self.record.as_ref()).ok_or_else(|| self.no_calibration())?;
        let (is_nominal, is_of_factory) = (record.is_nominal(), record.is_of_factory());
        if command == Command::Save && is_of_factory && self.flash.holds_other(record::sum(record))
        {
            return Err(Refusal::WouldReplace);
        }
        if command == Command::SaveNominal && !is_nominal {
            return Err(Refusal::NotNominal);
        }
        Ok(())
    }

    fn no_calibration(&self) -> Refusal {
        Refusal::NoCalibration {
            has_nominal: record_of_factory(&self.geometry).is_some(),
        }
    }

    /// Refuses a region that has too few of this sensor's pixels.
    fn check_region(&self, region: Region) -> Result<(), Refusal> {
        let light = &self.geometry.light;
        if region.part_of(light).len() < Region::FEWEST {
            return Err(Refusal::OffRow {
                region,
                pixels: light.len(),
            });
        }
        Ok(())
    }

    fn piece(&self, offset: u16) -> Result<Piece, Refusal> {
        let record = (self.record.as_ref()).ok_or_else(|| self.no_calibration())?;
        record::with_bytes(record, |bytes| {
            Piece::of(bytes, offset).ok_or(Refusal::NoPiece {
                offset,
                bytes: bytes.len(),
            })
        })
    }

    #[inline(never)]
    fn upload(&mut self, step: Step, actions: &mut Actions) -> Result<(), Refusal> {
        let is_whole = (self.upload).take(step, &self.geometry, &mut self.record)?;
        if is_whole && let Some(record) = &self.record {
            // Centres and black level are found as when the record was made, behind the same slits.
            self.settings.estimator = record.estimator;
            self.settings.black_level = record.black_level;
            self.settings.slits = record.slits();
            self.forget_readings();
            actions.apply = Some(self.applied());
        }
        Ok(())
    }

    #[inline(never)]
    fn set_defaults(&mut self) {
        let default = Settings::default();
        for &setting in Setting::ALL {
            if matches!(setting.affects(), Affects::Measurement | Affects::Lines) {
                self.settings.set(default.get(setting));
            }
        }
        self.record = record_of_factory(&self.geometry);
        self.calibration_on = true;
        self.forget_readings();
    }
}
