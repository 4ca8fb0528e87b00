//! What the sensor does with commands and frames, without hardware: events in, actions out.
//!
//! ```text
//! flash's contents ──> Session::start ─┐    ┌─ text to send
//! command ──────────┬─> Session::take ──┴────┼─ settings for the measurement
//! result of a frame ┘    (+ vitals)         └─ settings and record for flash
//! ```
//!
//! The owner of the serial line brings the events and carries out the actions: the firmware, or a test on a
//! PC.

mod actions;
mod commands;
pub mod flat;
mod results;

use core::fmt;
use core::mem;

use crate::filters::Filters;
use crate::filters::zero::Zero;
use crate::protocol::calibration::FlashStatus;
use crate::protocol::command::{Command, Error};
use crate::protocol::csv::Header;
use crate::protocol::info::{Banner, Hardware};
use crate::protocol::modbus::{self, Shown};
use crate::protocol::refusal::Refusal;
use crate::protocol::selftest::{RowTest, Selftest};
use crate::protocol::status::{StartCause, Vitals};
use crate::protocol::upload::Upload;
use crate::record::{self, Record};
use crate::settings::serial_line::{Connection, Format, PixelStream};
use crate::settings::trigger::Trigger;
use crate::settings::{Settings, Value};
use crate::store::configuration::Configuration;
use crate::store::{StoreError, Stored};
pub use actions::{Actions, Applied};
use slitrange::row::front_end::FrontEnd;
use slitrange::row::pixels::PixelErrors;
use slitrange::{Fault, Geometry, Measured, Micrometres, Reading};

/// What happens to the sensor after its start.
#[derive(Debug)]
pub enum Event {
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

/// After so many lines of comma-separated values in the stream, one names the columns: a logger that starts
/// late learns them within 10 s at 16 rows a frame.
const HEADER_PERIOD: u8 = 100;

/// What commands want of the next result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Wanted {
    distance: bool,
    centre: bool,
    parts: bool,
    /// The distance that the next reading is to have.
    zero: Option<Micrometres>,
    /// The result goes into the stream, even if the stream is off.
    result: bool,
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
    record: Option<Record>,
    flash: FlashStatus,
    /// Whether frames become distances.
    calibration_on: bool,
    upload: Upload,
    flat: flat::FlatState,
    wanted: Wanted,
    /// Nobody expects an answer to the save under way.
    saves_silently: bool,
    /// Distances are relative to this reading's. None after a change of what both readings must share: the
    /// calibration, the estimator, the black level, the slits or the map of the pixels.
    zero: Option<Zero>,
    filters: Filters,
    /// The lines of comma-separated values before the next one that names the columns.
    lines_to_header: u8,
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
            flat: flat::FlatState::default(),
            wanted: Wanted::default(),
            saves_silently: false,
            zero: None,
            filters: Filters::default(),
            lines_to_header: 0,
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

    /// How the sensor speaks now.
    pub fn connection(&self) -> Connection {
        self.settings.connection()
    }

    /// The record in use, if there is one.
    pub const fn record(&self) -> Option<&Record> {
        self.record.as_ref()
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
    pub fn is_frame_due(&self) -> bool {
        self.wanted != Wanted::default()
    }

    fn streams_pixels(&self, pixels: PixelStream) -> bool {
        let settings = &self.settings;
        self.sends_packets() && settings.stream && settings.pixels == pixels
    }

    /// Whether results and answers are packets. With an address they are text, because a packet says not from
    /// which sensor it is.
    pub fn sends_packets(&self) -> bool {
        let connection = self.connection();
        connection.format == Format::Binary && connection.address == 0
    }

    /// Whether the line speaks Modbus. Bytes then go to [`Self::answer_modbus`].
    pub fn speaks_modbus(&self) -> bool {
        self.connection().format == Format::Modbus
    }

    /// Whether the sensor may send without being asked: it is alone on its line, which is not Modbus.
    fn is_alone(&self) -> bool {
        self.connection().address == 0 && !self.speaks_modbus()
    }

    /// Whether the switching output is on: the latest distance is within the setting `limits`. While whole
    /// rows are sent there are no results, and the output is off.
    pub fn is_within_limits(&self) -> bool {
        self.filters.is_within && !self.streams_rows()
    }

    /// Whether rows are to be corrected with the map of the pixels.
    pub const fn is_map_on(&self) -> bool {
        self.flat.is_on
    }

    /// What `save` writes to flash: without a record if it is that of the factory. `None` without a
    /// calibration, because the next start would then take the nominal one.
    pub fn configuration(&self) -> Option<Configuration<&Record>> {
        let record = self.record()?;
        Some(Configuration {
            settings: self.settings,
            record: (!record.is_of_factory()).then_some(record),
        })
    }

    /// Starts with what flash holds, and writes into `actions` what must be done.
    #[inline(never)]
    pub fn start(&mut self, stored: &Stored, actions: &mut Actions) {
        self.load(stored);
        actions.start(self.connection().address);
        actions.apply = Some(self.applied());
        if self.is_alone() {
            actions.add_line(&Banner(&self.hardware, self.started_by));
        }
    }

    /// Takes an event, and writes into `actions` what must be done. `vitals` is what the firmware has counted
    /// so far.
    pub fn take(&mut self, event: Event, vitals: &Vitals, actions: &mut Actions) {
        actions.start(self.connection().address);
        let spoke_modbus = self.speaks_modbus();
        match event {
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
                region: self.settings.searched(),
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
        // A master that speaks Modbus would take a text for an answer. `plain on` at the start ends Modbus.
        if spoke_modbus && self.speaks_modbus() {
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
        actions.start(self.connection().address);
        let station = u8::try_from(self.settings.address).unwrap_or(1).max(1);
        let latest = self.latest.as_ref();
        let (number, result) = latest.map_or((0, None), |(number, it)| (*number, Some(it)));
        let shown = Shown {
            inputs: &modbus::inputs(result, number),
            settings: &self.settings,
            is_relative: self.zero.is_some() || self.wanted.zero.is_some(),
            can_save: self.check_save(Command::Save).is_ok(),
        };
        let answer = modbus::answer(request, station, &shown);
        let (mut apply, mut trigger) = (None, false);
        let changes = answer.changes.iter().map(|&change| Command::Set(change));
        let zero = answer.zero.map(Command::Zero);
        let measure = answer.measure.then_some(Command::Measure);
        for command in changes.chain(zero).chain(measure) {
            self.take_command(command, vitals, actions);
            apply = actions.apply.take().or(apply);
            trigger |= actions.trigger;
        }
        (actions.apply, actions.trigger) = (apply, trigger);
        actions.save = answer.save;
        actions.text.clear();
        answer
    }

    /// Names the columns of the lines to come, if they are comma-separated values.
    fn add_header(&mut self, actions: &mut Actions) {
        if self.connection().format == Format::Csv {
            self.lines_to_header = HEADER_PERIOD;
            actions.add_line(&Header(self.settings.output));
        }
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
    fn load(&mut self, stored: &Stored) {
        match stored {
            Stored::Nothing => {}
            Stored::Unusable => {
                self.record = None;
                self.flash = FlashStatus::Damaged;
            }
            Stored::Later(version) => {
                self.record = None;
                self.flash = FlashStatus::Later(*version);
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
    fn load_configuration(&mut self, Configuration { settings, record }: &Configuration) {
        self.settings = *settings;
        if let Some(record) = record {
            if !record.geometry.is_compatible_with(&self.geometry) {
                self.record = None;
                self.flash = FlashStatus::OtherSensor;
                return;
            }
            self.record = Some(record.clone());
            self.forget_readings();
        }
        self.note_saved();
    }

    /// Forgets the readings of before a change of what readings must share, if their errors are to be
    /// compared.
    fn forget_readings(&mut self) {
        self.zero = None;
        self.filters.clear();
    }

    fn note_saved(&mut self) {
        if let Some(record) = &self.record {
            self.flash = FlashStatus::Record(record::sum(record));
        }
    }

    fn applied(&self) -> Applied {
        let record = self.record().filter(|_| self.calibration_on);
        Applied {
            settings: self.settings,
            geometry: self.geometry(),
            profile: record.and_then(|record| record.profile),
            comb: record.and_then(|record| record.comb.clone()),
        }
    }
}

/// The nominal calibration. A sensor of another geometry than its own has no calibration.
#[inline(never)]
fn record_of_factory(geometry: &Geometry) -> Option<Record> {
    Record::nominal().filter(|nominal| nominal.geometry.is_compatible_with(geometry))
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
