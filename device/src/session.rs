//! What the sensor does with commands and frames, without hardware: events in, actions out.
//!
//! ```text
//! flash's contents ─┐                       ┌─ text to send
//! command ──────────┼─> Session::take ──────┼─ settings for the measurement
//! result of a frame ┘    (+ vitals)         └─ settings and record for flash
//! ```
//!
//! The owner of the serial line brings the events and carries out the actions: the firmware, or a test on a
//! PC.

pub mod flat;

use core::fmt::{self, Write as _};
use core::mem;

use crate::filters::Filters;
use crate::filters::hold::Held;
use crate::filters::zero::Zero;
use crate::protocol::MAX_ANSWER;
use crate::protocol::advice::advice;
use crate::protocol::calibration::{CalibrationAnswer, FlashStatus};
use crate::protocol::command::{Command, Error};
use crate::protocol::csv::{CsvLine, Header};
use crate::protocol::help::{Estimators, Help};
use crate::protocol::info::{Banner, Hardware, Info};
use crate::protocol::line::{CentreLine, FaultLine, PartsOf, ResultLine};
use crate::protocol::modbus::{self, Shown};
use crate::protocol::packet::FrameResult;
use crate::protocol::piece::Piece;
use crate::protocol::refusal::Refusal;
use crate::protocol::row::RowPart;
use crate::protocol::selftest::{RowTest, Selftest};
use crate::protocol::status::{Errors, StartCause, Status, Uptime, Vitals};
use crate::protocol::upload::{Step, Upload};
use crate::record::Record;
use crate::record::encoded::EncodedRecord;
use crate::settings::serial_line::{Format, PixelStream};
use crate::settings::trigger::Trigger;
use crate::settings::{Affects, Setting, Settings, Value};
use crate::store::configuration::Configuration;
use crate::store::{StoreError, Stored};
use crate::text::Text;
use slitrange::base::fault::Fault;
use slitrange::base::units::{InUnits, Micrometres};
use slitrange::check::own_spot::Profile;
use slitrange::frame::comb::{Comb, Slits};
use slitrange::reading::uncertainty::CalibrationErrors;
use slitrange::reading::{Measured, Reading};
use slitrange::row::Geometry;
use slitrange::row::front_end::FrontEnd;
use slitrange::row::pixels::PixelErrors;
use slitrange::spot::region::Region;

/// What happens to the sensor.
#[derive(Debug)]
// One at a time, on the stack of whoever brings it.
#[expect(clippy::large_enum_variant)]
pub enum Event {
    /// The sensor starts. Flash holds this.
    Started(Stored),
    /// A line came in.
    Line(Result<Command, Error>),
    /// A line for all sensors of the line came in. Nobody answers.
    LineForAll(Result<Command, Error>),
    /// A frame ended.
    Frame(Result<Measured, Fault>),
    /// The save that [`Actions::save`] asked for has ended.
    Saved(Result<(), StoreError>),
    /// The row that [`Actions::test`] asked for. `None` if the sensor is silent.
    Tested(Option<RowTest>),
    /// The job that [`Actions::flat`] asked for has ended, or flash was read at the start.
    Flat(flat::Outcome),
}

/// What the owner of the serial line must do, in this order.
#[derive(Debug, Default)]
pub struct Actions {
    /// Text to send, each line with CR LF. Empty if there is nothing to say.
    pub text: Text<MAX_ANSWER>,
    /// If it is not 0, this address goes before each line of the text, as [`AddressPrefix`].
    pub address: u16,
    /// The text or [`Self::result`] is one of a stream: drop it if the line is busy. Any other text must
    /// arrive.
    pub may_drop: bool,
    /// Send this result, as a packet. Only with [`Format::Binary`], and without a text.
    pub result: Option<FrameResult>,
    /// What the measurement must use from now on.
    pub apply: Option<Applied>,
    /// Write [`Session::configuration`] to flash, and then take the event [`Event::Saved`]. No frame is due
    /// before that.
    pub save: bool,
    /// Send these pixels of the next row, in the lines of [`crate::protocol::row`]. No frame is due
    /// meanwhile.
    pub row: Option<RowPart>,
    /// Do this with the map of the pixels, and then take the event [`Event::Flat`].
    pub flat: Option<flat::Job>,
    /// Look at the next row, and then take the event [`Event::Tested`]. No frame is due meanwhile.
    pub test: bool,
    /// Start a frame: its rows are exposed from now on. Only if [`Settings::trigger`] is not continuous. A
    /// frame that is under way or waits for its first row goes on, and counts as a missed trigger.
    pub trigger: bool,
    /// Start again, once all text has left.
    pub reset: bool,
}

/// What the measurement takes from settings and calibration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Applied {
    /// The settings.
    pub settings: Settings,
    /// The geometry of the rows, with what was measured of the front end.
    pub geometry: Geometry,
    /// The sensor's own spot, if the calibration knows it.
    pub profile: Option<Profile>,
    /// The slits of the comb, if the calibration knows them. Otherwise they are those of [`Comb::nominal`].
    pub comb: Option<Comb>,
}

impl Actions {
    /// Makes them those of an event that needs nothing. In place, because the text is large.
    fn start(&mut self, of_sensor: u16) {
        let Self {
            text,
            address,
            may_drop,
            result,
            apply,
            save,
            row,
            flat,
            test,
            trigger,
            reset,
        } = self;
        text.clear();
        *address = of_sensor;
        (*may_drop, *result, *apply, *save) = (false, None, None, false);
        (*row, *flat, *test) = (None, None, false);
        (*trigger, *reset) = (false, false);
    }

    /// Adds a line to the text.
    fn add_line(&mut self, line: &dyn fmt::Display) {
        // An answer that does not fit is cut off; the protocol's tests check that all fit.
        let _ = write!(self.text, "{line}\r\n");
    }
}

/// What commands want of the next result.
#[derive(Clone, Copy, Debug, Default)]
struct Wanted {
    distance: bool,
    centre: bool,
    parts: bool,
    /// The distance that the next reading is to have.
    zero: Option<Micrometres>,
    /// The result goes into the stream, even if the stream is off.
    result: bool,
}

/// A result on its way through the filters to the line.
struct Filtered {
    /// What commands and registers show. Relative to `zero`, but not in the answer to `zero` itself.
    result: Result<Reading, Fault>,
    /// What the stream gives: the same, or a reading that is held after a fault.
    held: Result<Held, Fault>,
    is_difference: bool,
}

/// A sensor's settings and calibration, and what a person asked of it.
///
/// A record has hundreds of bytes, and a function that moves a record needs as many on the stack. Such
/// functions are not inlined, so that they use that stack only while they run.
#[derive(Clone, Debug)]
pub struct Session {
    hardware: Hardware,
    geometry: Geometry,
    started_by: StartCause,
    settings: Settings,
    record: Option<EncodedRecord>,
    flash: FlashStatus,
    /// Whether frames become distances.
    calibration_on: bool,
    upload: Upload,
    flat: flat::FlatState,
    /// What commands want of the next result.
    wanted: Wanted,
    /// Nobody expects an answer to the save under way.
    saves_silently: bool,
    /// Distances are relative to this reading's. None after a change of what both readings must share: the
    /// calibration, the estimator, the black level, the slits or the map of the pixels.
    zero: Option<Zero>,
    filters: Filters,
    /// The latest result with its number, for [`Format::Modbus`].
    latest: Option<(u32, Result<Reading, Fault>)>,
    /// As the latest frame says.
    pixels: PixelErrors,
    readings: u32,
    faults: [u32; Fault::KINDS],
}

impl Session {
    /// A session with the settings and the calibration of the factory.
    #[inline(never)]
    pub fn new(hardware: Hardware, geometry: Geometry, started_by: StartCause) -> Self {
        Self {
            hardware,
            started_by,
            settings: Settings::default(),
            record: record_of_factory(&geometry),
            geometry,
            flash: FlashStatus::Nothing,
            calibration_on: true,
            upload: Upload::none(),
            flat: flat::FlatState::new(),
            wanted: Wanted::default(),
            saves_silently: false,
            zero: None,
            filters: Filters::default(),
            latest: None,
            pixels: PixelErrors::TCD1304DG,
            readings: 0,
            faults: [0; Fault::KINDS],
        }
    }

    /// The settings in use.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The record in use, if there is one.
    pub fn record(&self) -> Option<&Record> {
        self.record.as_ref().map(EncodedRecord::record)
    }

    /// The geometry of the rows: the driver's, with what was measured of the front end.
    pub fn geometry(&self) -> Geometry {
        match self.front_end() {
            Some(front_end) => front_end.geometry(&self.geometry),
            None => self.geometry.clone(),
        }
    }

    /// The front end as it was measured. It holds also while the calibration is off.
    fn front_end(&self) -> Option<&FrontEnd> {
        self.record()?.front_end.as_ref()
    }

    /// Whether the pixels around the spot are to be sent behind the results of the stream.
    pub fn streams_windows(&self) -> bool {
        self.streams_pixels(PixelStream::Window)
    }

    /// Whether whole rows are to be sent now in place of results: not while a command waits for a frame, or
    /// if a trigger starts frames.
    pub fn streams_rows(&self) -> bool {
        self.streams_pixels(PixelStream::Rows)
            && !self.is_frame_due()
            && self.settings.trigger == Trigger::Continuous
    }

    /// Whether a command waits for a frame.
    pub const fn is_frame_due(&self) -> bool {
        let Wanted {
            distance,
            centre,
            parts,
            zero,
            result,
        } = &self.wanted;
        *distance || *centre || *parts || zero.is_some() || *result
    }

    fn streams_pixels(&self, pixels: PixelStream) -> bool {
        let settings = &self.settings;
        self.sends_packets() && settings.stream && settings.pixels == pixels
    }

    /// Whether results and answers are packets. With an address they are text, because a packet says not from
    /// which sensor it is.
    pub const fn sends_packets(&self) -> bool {
        matches!(self.settings.format, Format::Binary) && self.settings.address == 0
    }

    /// Whether the line speaks Modbus. Bytes then go to [`Self::answer_modbus`].
    pub const fn speaks_modbus(&self) -> bool {
        matches!(self.settings.format, Format::Modbus)
    }

    /// Whether the sensor may send without being asked: it is alone on its line, which is not Modbus.
    const fn is_alone(&self) -> bool {
        self.settings.address == 0 && !self.speaks_modbus()
    }

    /// Whether the switching output is on: the latest distance is within the setting `limits`. While whole
    /// rows are sent there are no results, and the output is off.
    pub fn is_within_limits(&self) -> bool {
        self.filters.is_within && !self.streams_rows()
    }

    /// Whether rows are to be corrected with the map of the pixels.
    pub const fn is_map_on(&self) -> bool {
        self.flat.is_on()
    }

    /// What `save` writes to flash: without a record if it is that of the factory. `None` without a
    /// calibration, because the next start would then take the nominal one.
    #[inline(never)]
    pub fn configuration(&self) -> Option<Configuration> {
        let record = self.record()?;
        Some(Configuration {
            settings: self.settings,
            record: (!record.is_of_factory()).then(|| record.clone()),
        })
    }

    /// Takes an event, and writes into `actions` what must be done. `vitals` is what the firmware has counted
    /// so far.
    pub fn take(&mut self, event: Event, vitals: &Vitals, actions: &mut Actions) {
        actions.start(self.settings.address);
        let spoke_modbus = self.speaks_modbus();
        match event {
            Event::Started(stored) => {
                self.load(stored);
                actions.apply = Some(self.applied());
                if self.is_alone() {
                    actions.add_line(&Banner(&self.hardware, self.started_by));
                }
            }
            Event::Line(Ok(command)) => self.take_command(command, vitals, actions),
            Event::Line(Err(error)) => actions.add_line(&error),
            Event::LineForAll(Ok(command)) if command.is_for_all() => {
                self.take_command(command, vitals, actions);
                self.saves_silently = actions.save;
                actions.text.clear();
            }
            Event::LineForAll(_) => {}
            Event::Frame(measured) => self.report(measured, vitals, actions),
            Event::Saved(saved) => {
                match saved {
                    Ok(()) => {
                        self.note_saved();
                        actions.add_line(&Command::Save);
                    }
                    Err(error) => actions.add_line(&Refusal::NotSaved(error)),
                }
                if mem::take(&mut self.saves_silently) {
                    actions.text.clear();
                }
            }
            Event::Tested(row) => actions.add_line(&Selftest {
                flash: self.flash,
                started_by: self.started_by,
                row_rate_tenths: row_rate_tenths(vitals),
                front_end: self.front_end(),
                row,
            }),
            Event::Flat(outcome) => {
                // A new map may leave errors of the same size, but not the same errors.
                if !matches!(outcome, flat::Outcome::Saved(_)) {
                    self.forget_readings();
                }
                self.flat.end(outcome, actions);
            }
        }
        // A master that speaks Modbus would take a text for an answer.
        if spoke_modbus {
            actions.text.clear();
        }
    }

    /// Answers a Modbus request, and writes into `actions` what must be done once the answer is sent. Its
    /// bytes are empty if nobody expects one. Without an address, the sensor is station 1.
    #[inline(never)]
    pub fn answer_modbus(
        &mut self,
        request: &[u8],
        vitals: &Vitals,
        actions: &mut Actions,
    ) -> modbus::Answer {
        actions.start(self.settings.address);
        // At most 247.
        let station = (self.settings.address as u8).max(1);
        let (number, result) = match &self.latest {
            Some((number, result)) => (*number, Some(result)),
            None => (0, None),
        };
        let shown = Shown {
            inputs: &modbus::inputs(result, number),
            settings: &self.settings,
            can_save: self.check_save(Command::Save).is_ok(),
        };
        let answer = modbus::answer(request, station, &shown);
        let mut apply = None;
        for &change in &answer.changes {
            self.take_command(Command::Set(change), vitals, actions);
            apply = actions.apply.take().or(apply);
        }
        actions.apply = apply;
        actions.save = answer.save;
        actions.text.clear();
        answer
    }

    /// Takes a command and writes its answer. Starts a frame for it, if it needs one and frames do not start
    /// by themselves.
    fn take_command(&mut self, command: Command, vitals: &Vitals, actions: &mut Actions) {
        let was_due = self.is_frame_due();
        if let Err(refusal) = self.execute(command, vitals, actions) {
            actions.add_line(&refusal);
        }
        // A new trigger drops the frame that the one before started.
        let starts = matches!(command, Command::Measure | Command::Set(Value::Trigger(_)));
        actions.trigger = self.settings.trigger != Trigger::Continuous
            && self.is_frame_due()
            && (starts || !was_due);
    }

    /// Loads what flash holds. A saved calibration that cannot be used is not replaced by the nominal one,
    /// whose distances would be wrong without a warning.
    #[inline(never)]
    fn load(&mut self, stored: Stored) {
        match stored {
            Stored::Nothing => {}
            Stored::Unusable => {
                self.record = None;
                self.flash = FlashStatus::Damaged;
            }
            Stored::Newest(configuration) => self.load_configuration(configuration),
            Stored::Older(configuration) => {
                self.load_configuration(configuration);
                if let FlashStatus::Record(sum) = self.flash {
                    self.flash = FlashStatus::Older(sum);
                }
            }
        }
    }

    #[inline(never)]
    fn load_configuration(&mut self, Configuration { settings, record }: Configuration) {
        self.settings = settings;
        if let Some(mut record) = record {
            let Some(geometry) = record.geometry.clone().in_words_of(&self.geometry) else {
                self.record = None;
                self.flash = FlashStatus::OtherSensor;
                return;
            };
            record.geometry = geometry;
            self.set_record(record);
        }
        self.note_saved();
    }

    #[inline(never)]
    fn set_record(&mut self, record: Record) {
        // A record that was read can be written.
        self.record = EncodedRecord::new(record).ok();
        self.forget_readings();
    }

    /// Forgets the readings of before a change of what readings must share, if their errors are to be
    /// compared.
    fn forget_readings(&mut self) {
        self.zero = None;
        self.filters.clear();
    }

    fn note_saved(&mut self) {
        if let Some(record) = &self.record {
            self.flash = FlashStatus::Record(record.sum());
        }
    }

    /// Takes a frame's result through the filters to who wants it: commands, registers, the stream.
    fn report(
        &mut self,
        measured: Result<Measured, Fault>,
        vitals: &Vitals,
        actions: &mut Actions,
    ) {
        self.note_pixels(&measured);
        let result = measured.and_then(|measured| self.reading(&measured));
        let result = self.filters.spikes.take(self.settings.spike_filter, result);
        self.count(&result);
        let wanted = mem::take(&mut self.wanted);
        let filtered = self.filter(result, wanted.zero);
        self.latest = Some((vitals.results, filtered.result));
        let line = ResultLine {
            number: vitals.results,
            us: vitals.result_us,
            result: &filtered.result,
            is_difference: filtered.is_difference,
            held: 0,
            columns: self.settings.output,
            units: self.settings.units,
        };
        self.answer(&wanted, &measured, &line, actions);
        let is_due = wanted.result || self.is_due_in_stream(vitals);
        if actions.text.as_str().is_empty() && is_due {
            self.stream(&line, &filtered.held, actions);
        }
    }

    /// Forgets the readings before, if the frame's rows had another map of the pixels: two readings then do
    /// not share the pixels' errors.
    fn note_pixels(&mut self, measured: &Result<Measured, Fault>) {
        if let Ok(measured) = measured {
            if measured.pixels != self.pixels {
                self.forget_readings();
            }
            self.pixels = measured.pixels;
        }
    }

    /// Counts a reading, or a fault of its kind.
    fn count(&mut self, result: &Result<Reading, Fault>) {
        let count = match result {
            Ok(_) => Some(&mut self.readings),
            Err(fault) => self.faults.get_mut(fault.kind()),
        };
        if let Some(count) = count {
            *count = count.wrapping_add(1);
        }
    }

    /// Averages and holds a result, switches the output, and makes the result relative to `zero`. A reading
    /// becomes the new zero if it `is_to_show` a distance.
    fn filter(
        &mut self,
        result: Result<Reading, Fault>,
        is_to_show: Option<Micrometres>,
    ) -> Filtered {
        let Settings {
            average,
            ambient,
            hold,
            limits,
            ..
        } = self.settings;
        let result = self.filters.take(average, ambient, result);
        let held = self.filters.hold(hold, result);
        if let (Some(value), Ok(reading)) = (is_to_show, result) {
            self.zero = Some(Zero { reading, value });
        }
        // The answer to `zero` shows the distance from the laser. The output takes the distance from the new
        // zero.
        let distance = held.ok().map(|held| match &self.zero {
            Some(zero) => zero.distance(&held.reading),
            None => held.reading.distance,
        });
        self.filters.is_within = limits.is_on(self.filters.is_within, distance);
        let zero = self.zero.filter(|_| is_to_show.is_none());
        let relative = |now: Reading| match &zero {
            Some(zero) => zero.relative(&now),
            None => now,
        };
        Filtered {
            result: result.map(relative),
            held: held.map(|held| Held {
                reading: relative(held.reading),
                ..held
            }),
            is_difference: zero.is_some(),
        }
    }

    /// Answers the commands that wait for a result.
    fn answer(
        &self,
        wanted: &Wanted,
        measured: &Result<Measured, Fault>,
        line: &ResultLine<'_>,
        actions: &mut Actions,
    ) {
        let format = self.settings.format;
        if wanted.distance || wanted.zero.is_some() {
            answer(line, format, actions);
        }
        if wanted.centre {
            match measured {
                Ok(measured) => actions.add_line(&CentreLine(measured)),
                Err(fault) => {
                    actions.add_line(&FaultLine(fault));
                    advise(fault, actions);
                }
            }
        }
        if wanted.parts {
            answer(line, format, actions);
            if let Ok(reading) = line.result {
                actions.add_line(&PartsOf(&reading.parts, self.settings.units));
            }
        }
    }

    /// Whether the stream is on and its next line is due.
    fn is_due_in_stream(&mut self, vitals: &Vitals) -> bool {
        self.settings.stream
            && self.is_alone()
            && (self.settings.trigger != Trigger::Continuous
                || (self.filters.rate).is_due(self.settings.rate, vitals.result_us))
    }

    /// Gives a result to the stream, as a line or as a packet.
    fn stream(&self, line: &ResultLine<'_>, held: &Result<Held, Fault>, actions: &mut Actions) {
        // The answer to `measure` at an address must arrive.
        actions.may_drop = self.is_alone();
        match self.sends_packets() {
            false => {
                let line = ResultLine {
                    result: &held.map(|it| it.reading),
                    held: held.map_or(0, |it| it.results),
                    ..*line
                };
                add_result(&line, self.settings.format, actions);
            }
            // Each row has its own result.
            true if self.streams_rows() => {}
            true => {
                actions.result = Some(FrameResult {
                    counter: line.number,
                    time_us: line.us,
                    is_difference: line.is_difference,
                    result: *line.result,
                });
            }
        }
    }

    /// Converts a frame's centre by the record, if there is one and it is on.
    fn reading(&self, measured: &Measured) -> Result<Reading, Fault> {
        let Some(record) = self.record().filter(|_| self.calibration_on) else {
            return measured.reading(None, &CalibrationErrors::Unknown, self.settings.surface);
        };
        let calibration = Some(&record.calibration);
        let reading = measured.reading(calibration, &record.errors, self.settings.surface)?;
        let is_as_calibrated = reading.is_nominal
            || record.estimator == self.settings.estimator
                && record.black_level == self.settings.black_level
                && (record.slits() == Slits::Comb) == measured.comb.is_some();
        Ok(Reading {
            has_other_settings: !is_as_calibrated,
            ..reading
        })
    }

    /// Executes a command, and writes its answer into `actions`.
    fn execute(
        &mut self,
        command: Command,
        vitals: &Vitals,
        actions: &mut Actions,
    ) -> Result<(), Refusal> {
        match command {
            Command::Nothing => {}
            Command::Help => actions.add_line(&Help),
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
                    let value = InUnits(zero.value, self.settings.units);
                    actions.add_line(&format_args!("master {value}"));
                }
                None => actions.add_line(&Command::Zero(false)),
            },
            Command::Master(Some(value)) => {
                let value = value.in_units(self.settings.units);
                self.wanted.zero = Some(value.ok_or(Refusal::MasterRange)?);
            }
            Command::Zero(false) => {
                (self.zero, self.wanted.zero) = (None, None);
                actions.add_line(&command);
            }
            Command::Show(setting) => actions.add_line(&self.settings.get(setting)),
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
                if matches!(
                    value,
                    Value::Estimator(_) | Value::Black(_) | Value::Slits(_)
                ) {
                    self.forget_readings();
                }
                if matches!(value, Value::Limits(_)) {
                    self.filters.is_within = false;
                }
                if value.setting().affects() == Affects::Measurement {
                    self.filters.clear();
                    actions.apply = Some(self.applied());
                }
                actions.add_line(&value);
                if matches!(value, Value::Format(_) | Value::Output(_)) {
                    self.add_header(actions);
                }
            }
            Command::Calibration(None) => actions.add_line(&CalibrationAnswer {
                record: self.record.as_ref(),
                is_on: self.calibration_on,
                stored: self.flash,
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

    /// Names the columns of the lines to come, if they are comma-separated values.
    fn add_header(&self, actions: &mut Actions) {
        if self.settings.format == Format::Csv {
            actions.add_line(&Header(self.settings.output));
        }
    }

    /// Refuses a `save`, or a `save nominal`, that has nothing to save or would lose a calibration.
    fn check_save(&self, command: Command) -> Result<(), Refusal> {
        let record = (self.record.as_ref()).ok_or_else(|| self.no_calibration())?;
        let (is_nominal, is_of_factory) = (
            record.record().is_nominal(),
            record.record().is_of_factory(),
        );
        if command == Command::Save && is_of_factory && self.flash.holds_other(record.sum()) {
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

    /// What the measurement must use.
    fn applied(&self) -> Applied {
        let record = self.record().filter(|_| self.calibration_on);
        Applied {
            settings: self.settings,
            geometry: self.geometry(),
            profile: record.and_then(|record| record.profile),
            comb: record.and_then(|record| record.comb.clone()),
        }
    }

    fn piece(&self, offset: u16) -> Result<Piece, Refusal> {
        let record = (self.record.as_ref()).ok_or_else(|| self.no_calibration())?;
        let bytes = record.bytes();
        Piece::of(bytes, offset).ok_or(Refusal::NoPiece {
            offset,
            bytes: bytes.len(),
        })
    }

    #[inline(never)]
    fn upload(&mut self, step: Step, actions: &mut Actions) -> Result<(), Refusal> {
        if let Some(record) = self.upload.take(step, &self.geometry)? {
            // Centres and black level are found as when the record was made, behind the same slits.
            self.settings.estimator = record.estimator;
            self.settings.black_level = record.black_level;
            self.settings.slits = record.slits();
            self.set_record(record);
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

/// The nominal calibration. A sensor of another geometry than its own has no calibration.
#[inline(never)]
fn record_of_factory(geometry: &Geometry) -> Option<EncodedRecord> {
    EncodedRecord::nominal()
        .filter(|nominal| nominal.record().geometry.is_compatible_with(geometry))
}

/// An address before a line, `@17 `: from which sensor the line is.
#[derive(Clone, Copy, Debug)]
pub struct AddressPrefix(pub u16);

impl fmt::Display for AddressPrefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "@{} ", self.0)
    }
}

/// Ten times the rows a second since the start.
fn row_rate_tenths(vitals: &Vitals) -> u64 {
    // 32 bits times 10^7 fit 64. Half a step rounds.
    let rows = u64::from(vitals.rows).saturating_mul(10_000_000);
    let rounded = rows.saturating_add(vitals.uptime_us / 2);
    rounded.checked_div(vitals.uptime_us).unwrap_or(0)
}

/// Answers with a result, and with what to do about a fault. Among comma-separated values there is no advice.
fn answer(line: &ResultLine<'_>, format: Format, actions: &mut Actions) {
    add_result(line, format, actions);
    if let Err(fault) = line.result
        && format != Format::Csv
    {
        advise(fault, actions);
    }
}

/// Adds the line of a result.
fn add_result(line: &ResultLine<'_>, format: Format, actions: &mut Actions) {
    match format {
        Format::Csv => actions.add_line(&CsvLine(line)),
        Format::Text | Format::Binary | Format::Modbus => actions.add_line(line),
    }
}

/// Adds what to do about a fault.
fn advise(fault: &Fault, actions: &mut Actions) {
    actions.add_line(&format_args!("({})", advice(fault)));
}
