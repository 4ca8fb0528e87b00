//! Every command, fault and start of a sensor, through the core's session, without hardware and without an
//! emulator.

use judges::frames::at_centre;
use proptest::prelude::*;
use slitrange::base::exposure::Exposure;
use slitrange::base::fault::Fault;
use slitrange::base::places::PLACES;
use slitrange::base::units::{Counts, Electrons, Micrometres, Pixels};
use slitrange::centre::Estimator;
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::check::own_spot::Profile;
use slitrange::distance::Calibration;
use slitrange::distance::knots::Knot;
use slitrange::distance::table::Table;
use slitrange::frame::FrameCentre;
use slitrange::frame::comb::{Comb, Combined, MAX_SLITS, SlitMap, Slits};
use slitrange::light::black_level::BlackLevel;
use slitrange::reading::Measured;
use slitrange::reading::uncertainty::{CalibrationErrors, Surface};
use slitrange::row::front_end::{Estimate, FrontEnd};
use slitrange::row::pixels::PixelErrors;
use slitrange::row::pixels::flat_field::{Kind, TakeError, Taken};
use slitrange::row::pixels::map::MapSummary;
use slitrange::row::sensor_heads::tcd1304dg;
use slitrange::row::{Geometry, Polarity};
use slitrange_device::protocol::advice::advice;
use slitrange_device::protocol::command::{Command, parse};
use slitrange_device::protocol::help::{Estimators, Help};
use slitrange_device::protocol::info::{Banner, BrownOut, Clock, Hardware, Info};
use slitrange_device::protocol::line::{CentreLine, FaultLine, ReadingLine};
use slitrange_device::protocol::piece::{PIECE, Piece};
use slitrange_device::protocol::refusal::Refusal;
use slitrange_device::protocol::selftest::RowTest;
use slitrange_device::protocol::status::{StartCause, Status, Vitals};
use slitrange_device::protocol::upload::Step;
use slitrange_device::record::Record;
use slitrange_device::record::encoded::EncodedRecord;
use slitrange_device::session::flat::{Job, Outcome};
use slitrange_device::session::{Actions, Applied, Event, Session};
use slitrange_device::settings::{Affects, Setting, Settings};
use slitrange_device::store::configuration::Configuration;
use slitrange_device::store::pixel_map::StoredMap;
use slitrange_device::store::{StoreError, Stored};

const HARDWARE: Hardware = Hardware {
    board: "a board",
    head: "TCD1304DG",
    row_us: 5700,
    longest_exposure: Exposure::LONGEST,
    clock: Clock::External,
    brown_out: BrownOut::Off,
};

/// What the measurement of a sensor with one slit takes.
fn applied(settings: Settings, profile: Option<Profile>) -> Applied {
    Applied {
        settings,
        geometry: tcd1304dg(),
        profile,
        comb: None,
    }
}

/// A session, and the actions of its latest event.
struct Sensor {
    session: Session,
    actions: Actions,
}

impl Sensor {
    /// Just started, with this in flash.
    fn started(stored: Stored) -> Self {
        let sensor = Self::comb_started(stored);
        assert_eq!(
            sensor.actions.apply,
            Some(applied(*sensor.session.settings(), None))
        );
        sensor
    }

    /// The same of a sensor that may have a comb.
    fn comb_started(stored: Stored) -> Self {
        Self::with_head(tcd1304dg(), stored)
    }

    /// The same of a sensor with this head.
    fn with_head(geometry: Geometry, stored: Stored) -> Self {
        let mut sensor = Self {
            session: Session::new(HARDWARE, geometry, StartCause::PowerOn),
            actions: Actions::default(),
        };
        sensor.session.start(&stored, &mut sensor.actions);
        let banner = Banner(&HARDWARE, StartCause::PowerOn).to_string() + "\r\n";
        assert_eq!(sensor.actions.text.as_str(), banner);
        sensor
    }

    fn new() -> Self {
        Self::started(Stored::Nothing)
    }

    /// The text that an event brings, without its last line end.
    fn take(&mut self, event: Event) -> String {
        let vitals = vitals();
        self.session.take(event, &vitals, &mut self.actions);
        let text = self.actions.text.as_str();
        assert!(
            text.is_ascii() && (text.is_empty() || text.ends_with("\r\n")),
            "{text:?}"
        );
        text.strip_suffix("\r\n").unwrap_or_default().to_owned()
    }

    /// The answer to a line.
    fn ask(&mut self, line: &str) -> String {
        let answer = self.take(Event::Line(parse(line.as_bytes())));
        assert!(!self.actions.may_drop, "an answer must arrive: {line}");
        answer
    }

    /// A line that is answered by itself.
    fn set(&mut self, line: &str) {
        assert_eq!(self.ask(line), line);
    }

    /// Sends a record as `slitrange calibrate write` does.
    fn upload(&mut self, record: &EncodedRecord) {
        self.set(&Step::Begin(record.bytes().len() as u16).to_string());
        for offset in (0..record.bytes().len()).step_by(PIECE) {
            let piece = Piece::of(record.bytes(), offset as u16).expect("a piece");
            self.set(&Command::Upload(Step::Piece(piece)).to_string());
        }
        self.set("calibration commit");
    }

    /// Writes to flash as the firmware does, and gives what flash then holds.
    fn save(&mut self) -> Configuration {
        assert_eq!(self.ask("save"), "save pauses the stream");
        assert!(self.actions.save);
        let saved = self
            .session
            .configuration()
            .map(Configuration::cloned)
            .expect("something to save");
        assert_eq!(self.take(Event::Saved(Ok(()))), "save");
        saved
    }
}

fn vitals() -> Vitals {
    Vitals {
        uptime_us: 61_005_000,
        results: 1234,
        result_us: 12_345_678,
        rows: 10_700,
        row_cycles: 35_000,
        ..Vitals::default()
    }
}

/// A record of a sensor head with longer rows.
fn of_another_head() -> Record {
    let mut record = own_record().record().clone();
    record.geometry.light.end -= 1;
    record
}

/// A frame whose spot is at a centre in pixels.
fn frame(centre: f64) -> Measured {
    let exact = at_centre(centre);
    Measured {
        frame: FrameCentre {
            uncertainty: Pixels::from_f32(0.002),
            amplitude: Counts::from_int(1993),
            exposure: None,
            ..exact.frame
        },
        pixels: PixelErrors::TCD1304DG,
        ..exact
    }
}

const TOO_DIM: Fault = Fault::TooDim {
    amplitude: Counts::from_int(35),
    needed: Counts::from_int(60),
};

/// A sensor's own record: not the nominal one, and made with other settings.
fn own_record() -> EncodedRecord {
    let record = Record {
        serial_number: 42,
        estimator: Estimator::Adaptive,
        black_level: BlackLevel::Frame,
        ..Record::nominal().expect("a record")
    };
    EncodedRecord::new(record).expect("a record")
}

#[test]
fn every_setting_is_shown_set_and_applied() {
    let mut sensor = Sensor::new();
    for &setting in Setting::ALL {
        let default = Settings::default().get(setting).to_string();
        assert_eq!(sensor.ask(setting.name()), default);
        assert_eq!(sensor.actions.apply, None, "{setting:?}");
    }
    for line in [
        "stream off",
        "format binary",
        "baud 921600",
        "baud 115200",
        "pixels window",
        "pixels rows",
        "trigger serial",
        "trigger pin",
        "rows 64",
        "mean plain",
        "black fixed 300",
        "black frame",
        "exposure 200",
        "exposure limit 300",
        "exposure auto",
        "laser off",
        "ambient subtract",
        "estimator gauss-newton",
        "region 0 63",
        "region 3584 4095",
        "region all",
        "peak last",
    ] {
        sensor.set(line);
        let words: Vec<&str> = line.split(' ').collect();
        let (setting, _) = Setting::of_words(&words).expect("a setting");
        let name = setting.name();
        let expected = (setting.affects() == Affects::Measurement)
            .then(|| applied(*sensor.session.settings(), None));
        assert_eq!(sensor.actions.apply, expected);
        assert_eq!(sensor.ask(name), line);
    }
    let settings = *sensor.session.settings();
    for (line, error) in [
        ("rows 65", "E3 out of range, expected rows 1..64"),
        ("format json", "E2 expected format text|csv|binary|modbus"),
        (
            "baud 9600",
            "E3 out of range, expected baud 115200|230400|460800|921600",
        ),
        ("pixels all", "E2 expected pixels none|window|rows"),
        ("trigger edge", "E2 expected trigger continuous|serial|pin"),
        ("mean median", "E2 expected mean plain|weighted"),
        (
            "estimator robust",
            "E6 unknown estimator, try help estimator",
        ),
        (
            "region 0 62",
            "E3 out of range, expected region all|0..4095 0..4095",
        ),
        (
            "region 3585 4095",
            "E22 region 3585 4095, but the sensor has 3648 pixels: take 64 of them or more",
        ),
        ("peak second", "E2 expected peak strongest|first|last"),
        ("frobnicate", "E1 unknown command, try help"),
    ] {
        assert_eq!(sensor.ask(line), error);
        assert_eq!(sensor.actions.apply, None);
    }
    assert_eq!(
        *sensor.session.settings(),
        settings,
        "an error changes nothing"
    );
}

#[test]
fn help_info_and_status_are_answered() {
    let mut sensor = Sensor::new();
    assert_eq!(sensor.ask(""), "");
    assert_eq!(sensor.ask("help"), Help.to_string());
    assert_eq!(sensor.ask("help estimator"), Estimators.to_string());
    let nominal = Record::nominal();
    for (line, on) in [("calibration on", true), ("calibration off", false)] {
        sensor.set(line);
        let info = Info {
            hardware: &HARDWARE,
            geometry: &tcd1304dg(),
            settings: &Settings::default(),
            record: nominal.as_ref(),
            is_calibration_on: on,
            pixels: PixelErrors::TCD1304DG,
        };
        assert_eq!(sensor.ask("info"), info.to_string());
    }
    sensor.set("calibration on");
    sensor.take(Event::Frame(Ok(frame(1800.0))));
    sensor.take(Event::Frame(Ok(frame(1800.0))));
    sensor.take(Event::Frame(Err(TOO_DIM)));
    sensor.take(Event::Frame(Ok(frame(1.0))));
    let mut faults = [0; Fault::KINDS];
    faults[TOO_DIM.kind()] = 1;
    let out_of_range = Fault::OutOfRange {
        centre: Pixels::from_int(1),
    };
    faults[out_of_range.kind()] = 1;
    let status = Status {
        started_by: StartCause::PowerOn,
        vitals: &vitals(),
        readings: 2,
        faults,
        is_within_limits: false,
    };
    assert_eq!(sensor.ask("status"), status.to_string());
    assert_eq!(sensor.ask("uptime"), "status uptime 61.005 s");
    assert!(
        status
            .to_string()
            .contains("\r\nstatus uptime 61.005 s\r\n")
    );
    let errors = sensor.ask("errors");
    assert!(status.to_string().ends_with(&format!("\r\n{errors}")));
    assert!(errors.starts_with("status rows lost 0\r\nstatus rows failed 0\r\n"));
    assert!(
        errors.contains("\r\nstatus fault too dim 1\r\n"),
        "{errors}"
    );
}

#[test]
fn a_trigger_starts_each_frame_that_a_command_asks_for() {
    let mut sensor = Sensor::new();
    let started = |sensor: &Sensor| sensor.actions.trigger;
    let line = sensor.take(Event::Frame(Ok(frame(1800.0))));
    assert!(
        sensor.ask("measure").starts_with("E24 "),
        "frames start by themselves"
    );
    sensor.ask("distance");
    assert!(!started(&sensor));
    // The frame of a command that still waits.
    sensor.set("trigger serial");
    assert!(started(&sensor));
    sensor.take(Event::Frame(Ok(frame(1800.0))));
    for trigger in ["trigger serial", "trigger pin"] {
        sensor.set(trigger);
        assert!(!started(&sensor));
        for command in ["distance", "centre", "uncertainty", "zero", "measure"] {
            assert_eq!(sensor.ask(command), "");
            assert!(started(&sensor), "{command}");
            // Only once, whatever is asked meanwhile.
            sensor.ask("status");
            assert!(!started(&sensor));
            sensor.take(Event::Frame(Ok(frame(1800.0))));
        }
        sensor.set("zero off");
    }
    // The result is one of the stream, in its format, whatever the stream and its rate are.
    for setting in ["stream off", "rate 1"] {
        sensor.set(setting);
        for _ in 0..3 {
            sensor.ask("measure");
            assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), line);
            assert!(sensor.actions.may_drop);
        }
    }
    // Results of edges follow the setting `stream`.
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), "");
    sensor.set("stream on");
    for _ in 0..3 {
        assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), line);
    }
    sensor.set("format binary");
    sensor.set("pixels rows");
    assert!(!sensor.session.streams_rows(), "frames have results");
    sensor.ask("measure");
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), "");
    assert!(sensor.actions.result.is_some());
    sensor.set("trigger continuous");
    assert!(sensor.session.streams_rows());
}

#[test]
fn selftest_asks_for_a_row_and_answers_with_it() {
    let mut sensor = Sensor::new();
    assert_eq!(sensor.ask("selftest"), "");
    assert!(sensor.actions.test);
    let answer = sensor.take(Event::Tested(None));
    assert!(!sensor.actions.test && !sensor.actions.may_drop);
    assert_eq!(
        answer,
        "selftest flash pass nothing was saved\r\nselftest rows fail f sensor silent\r\n\
         selftest start pass power-on\r\nselftest fail 1"
    );
    let geometry = tcd1304dg();
    let words = vec![3795; geometry.words];
    let row = geometry.row(&words).expect("a row");
    let row = RowTest::of(&row, &Err(Fault::LaserOff));
    let answer = sensor.take(Event::Tested(row));
    // 10,700 rows in 61.005 s.
    assert!(answer.contains("\r\nselftest rows pass 175.4 Hz\r\n"));
    assert!(answer.contains("\r\nselftest light fail f laser off\r\n"));
}

/// A Modbus request with its checksum.
fn request(body: &[u8]) -> Vec<u8> {
    let sum = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS).checksum(body);
    [body, &sum.to_le_bytes()].concat()
}

impl Sensor {
    /// The answer to a Modbus request, without its checksum.
    fn ask_modbus(&mut self, body: &[u8]) -> Vec<u8> {
        let answer = self
            .session
            .answer_modbus(&request(body), &vitals(), &mut self.actions);
        assert_eq!(self.actions.text.as_str(), "");
        let mut bytes = answer.bytes.to_vec();
        bytes.truncate(bytes.len().saturating_sub(2));
        bytes
    }
}

#[test]
fn with_modbus_only_requests_are_answered() {
    let mut sensor = Sensor::new();
    let line = sensor.take(Event::Frame(Ok(frame(1800.0))));
    sensor.set("format modbus");
    assert!(sensor.session.speaks_modbus());
    // Nothing is sent unasked, and no line is answered.
    for result in [Ok(frame(1801.0)), Err(TOO_DIM)] {
        assert_eq!(sensor.take(Event::Frame(result)), "");
    }
    assert_eq!(sensor.take(Event::Line(parse(b"help"))), "");
    // Without an address the sensor is station 1. The latest result is a fault.
    let number = TOO_DIM.kind() as u8 + 1;
    assert_eq!(sensor.ask_modbus(&[1, 4, 0, 0, 0, 1]), [1, 4, 2, 0, number]);
    assert_eq!(sensor.ask_modbus(&[17, 4, 0, 0, 0, 1]), [0; 0]);
    sensor.take(Event::Frame(Ok(frame(1800.0))));
    let answer = sensor.ask_modbus(&[1, 4, 0, 4, 0, 2]);
    let distance = i32::from_be_bytes(answer[3..].try_into().expect("two registers"));
    let shown: f64 = (line.split(' ').nth(1))
        .and_then(|it| it.parse().ok())
        .expect("mm");
    assert_eq!(f64::from(distance), (shown * 1e4).round());
    // Several settings at once are applied together.
    let rows_and_exposure = [1, 16, 0, 0, 0, 2, 4, 0, 4, 0, 187];
    assert_eq!(
        sensor.ask_modbus(&rows_and_exposure),
        rows_and_exposure[..6]
    );
    let applied = sensor.actions.apply.clone().expect("settings to apply");
    assert_eq!(applied.settings, *sensor.session.settings());
    assert_eq!(applied.settings.rows, 4);
    // The answer to a new address comes from the old one.
    assert_eq!(sensor.ask_modbus(&[1, 6, 0, 5, 0, 17]), [1, 6, 0, 5, 0, 17]);
    assert_eq!(sensor.ask_modbus(&[1, 3, 0, 5, 0, 1]), [0; 0]);
    assert_eq!(sensor.ask_modbus(&[17, 3, 0, 5, 0, 1]), [17, 3, 2, 0, 17]);
    // A save is answered by its request, and the format is saved with the address.
    assert_eq!(sensor.ask_modbus(&[17, 6, 0, 6, 0, 1]), [17, 6, 0, 6, 0, 1]);
    assert!(sensor.actions.save);
    let saved = sensor
        .session
        .configuration()
        .map(Configuration::cloned)
        .expect("something to save");
    assert_eq!(sensor.take(Event::Saved(Ok(()))), "");
    let mut session = Session::new(HARDWARE, tcd1304dg(), StartCause::PowerOn);
    let mut actions = Actions::default();
    session.start(&Stored::Newest(saved), &mut actions);
    assert_eq!(actions.text.as_str(), "");
    assert!(session.speaks_modbus());
    // No result yet.
    let answer = session.answer_modbus(&request(&[17, 4, 0, 0, 0, 1]), &vitals(), &mut actions);
    assert_eq!(answer.bytes[..5], [17, 4, 2, 0xFF, 0xFF]);
    // The way back to text.
    sensor.ask_modbus(&[0, 6, 0, 4, 0, 0]);
    assert!(!sensor.session.speaks_modbus());
    assert_eq!(sensor.ask("format"), "format text");
}

#[test]
fn over_modbus_a_calibration_is_not_replaced_by_the_nominal_one() {
    let stored = Stored::Newest(Configuration {
        settings: Settings::default(),
        record: Some(own_record().record().clone()),
    });
    let mut sensor = Sensor::comb_started(stored);
    sensor.set("defaults");
    sensor.set("format modbus");
    assert_eq!(sensor.ask_modbus(&[1, 6, 0, 6, 0, 1]), [1, 0x86, 4]);
    assert!(!sensor.actions.save);
}

#[test]
fn a_sensor_with_an_address_sends_nothing_unasked() {
    let mut sensor = Sensor::new();
    let line = sensor.take(Event::Frame(Ok(frame(1800.0))));
    for_all(&mut sensor, "address 17");
    assert_eq!(sensor.actions.address, 0);
    assert_eq!(sensor.ask("address"), "address 17");
    assert_eq!(sensor.actions.address, 17);
    sensor.set("address 247");
    // The answer is still that of the old address.
    assert_eq!(sensor.actions.address, 17);
    for result in [Ok(frame(1800.0)), Err(TOO_DIM)] {
        assert_eq!(sensor.take(Event::Frame(result)), "");
    }
    // Packets have no address.
    sensor.set("format binary");
    sensor.set("pixels rows");
    assert!(!sensor.session.sends_packets() && !sensor.session.streams_rows());
    sensor.ask("distance");
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), line);
    assert_eq!(sensor.actions.address, 247);
    sensor.set("trigger serial");
    sensor.ask("measure");
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), line);
    assert!(!sensor.actions.may_drop, "an answer must arrive");
    // For all sensors: what is answered at once is done, without an answer.
    for_all(&mut sensor, "rows 7");
    assert_eq!(
        sensor.actions.apply.as_ref().map(|it| it.settings.rows),
        Some(7)
    );
    for line in [
        "distance",
        "status",
        "row",
        "flat dark",
        "measure",
        "frobnicate",
        "rows 99",
    ] {
        for_all(&mut sensor, line);
        assert!(
            !sensor.actions.trigger
                && sensor.actions.row.is_none()
                && sensor.actions.flat.is_none()
        );
        assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), "");
    }
    for_all(&mut sensor, "save");
    assert!(sensor.actions.save);
    assert_eq!(sensor.take(Event::Saved(Ok(()))), "");
    // The next save is answered.
    let saved = sensor.save();
    assert_eq!((saved.settings.address, saved.settings.rows), (247, 7));
    sensor.set("defaults");
    assert_eq!(sensor.ask("address"), "address 247");
    assert_eq!(sensor.ask("rows"), "rows 16");
    // Started with an address: no banner, and the address is known.
    let mut session = Session::new(HARDWARE, tcd1304dg(), StartCause::PowerOn);
    let mut actions = Actions::default();
    session.start(&Stored::Newest(saved), &mut actions);
    assert_eq!(actions.text.as_str(), "");
    for_all(&mut sensor, "reset");
    assert!(sensor.actions.reset);
    assert_eq!(
        sensor.ask("address 248"),
        "E3 out of range, expected address 0..247"
    );
}

/// A line for all sensors, which has no answer.
fn for_all(sensor: &mut Sensor, line: &str) {
    let event = Event::LineForAll(parse(line.as_bytes()));
    assert_eq!(sensor.take(event), "", "{line}");
}

#[test]
fn reset_is_answered_and_asked_of_the_owner_once() {
    let mut sensor = Sensor::new();
    sensor.set("reset");
    assert!(sensor.actions.reset);
    sensor.ask("uptime");
    assert!(!sensor.actions.reset);
    for line in ["reset now", "errors 1", "uptime s"] {
        let name = line.split(' ').next().expect("a name");
        assert_eq!(sensor.ask(line), format!("E2 expected {name}"));
        assert!(!sensor.actions.reset);
    }
}

#[test]
fn in_binary_results_are_packets_and_answers_stay_text() {
    let mut sensor = Sensor::new();
    let as_text = sensor.take(Event::Frame(Ok(frame(1800.0))));
    assert_eq!(sensor.actions.result, None);
    sensor.set("format binary");
    // A result that answers a command is no packet.
    sensor.ask("distance");
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), as_text);
    assert_eq!(sensor.actions.result, None);
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), "");
    assert!(sensor.actions.may_drop);
    let result = sensor.actions.result.expect("a result");
    let Vitals {
        results, result_us, ..
    } = vitals();
    assert_eq!((result.counter, result.time_us), (results, result_us));
    assert!(!result.is_difference);
    assert_eq!(
        ReadingLine(&result.result.expect("a reading")).to_string(),
        as_text
    );
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), "");
    let fault = sensor.actions.result.expect("a result");
    assert_eq!((fault.counter, fault.result), (results, Err(TOO_DIM)));
    sensor.ask("zero");
    sensor.take(Event::Frame(Ok(frame(1800.0))));
    sensor.take(Event::Frame(Ok(frame(1801.0))));
    let difference = sensor.actions.result.expect("a result");
    assert!(difference.is_difference);
    let line = ReadingLine(&difference.result.expect("a reading")).to_string();
    let of_the_core = line.replacen("d ", "z ", 1);
    // Rows have results of their own, and wait while a command waits for a frame.
    assert!(!sensor.session.streams_windows());
    sensor.set("pixels window");
    assert!(sensor.session.streams_windows() && !sensor.session.streams_rows());
    sensor.set("pixels rows");
    assert!(sensor.session.streams_rows() && !sensor.session.streams_windows());
    sensor.take(Event::Frame(Ok(frame(1801.0))));
    assert_eq!(sensor.actions.result, None);
    for command in ["distance", "centre", "uncertainty", "zero"] {
        sensor.ask(command);
        assert!(!sensor.session.streams_rows(), "{command}");
        sensor.take(Event::Frame(Ok(frame(1800.0))));
        assert!(sensor.session.streams_rows(), "{command}");
    }
    sensor.set("stream off");
    assert!(!sensor.session.streams_rows());
    sensor.set("pixels none");
    sensor.take(Event::Frame(Ok(frame(1801.0))));
    assert_eq!(sensor.actions.result, None);
    sensor.set("stream on");
    // A reader of text took the packets for a line, which must end before the answer.
    assert_eq!(sensor.ask("format text"), "\r\nformat text");
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1801.0)))), of_the_core);
    sensor.set("format text");
}

#[test]
fn frames_stream_and_may_be_dropped_answers_may_not() {
    let mut sensor = Sensor::new();
    let calibration = Calibration::nominal();
    let reading = frame(1800.0)
        .reading(
            calibration.as_ref(),
            &CalibrationErrors::Nominal,
            Surface::Auto,
        )
        .expect("a distance");
    assert_eq!(
        sensor.take(Event::Frame(Ok(frame(1800.0)))),
        ReadingLine(&reading).to_string()
    );
    assert!(sensor.actions.may_drop);
    assert_eq!(
        sensor.take(Event::Frame(Err(TOO_DIM))),
        FaultLine(&TOO_DIM).to_string()
    );
    assert!(sensor.actions.may_drop);

    // Asked for, a frame is an answer, and a fault comes with advice.
    assert_eq!(sensor.ask("distance"), "");
    assert_eq!(
        sensor.take(Event::Frame(Ok(frame(1800.0)))),
        ReadingLine(&reading).to_string()
    );
    assert!(!sensor.actions.may_drop);
    assert_eq!(sensor.ask("centre"), "");
    assert_eq!(
        sensor.take(Event::Frame(Ok(frame(1.0)))),
        CentreLine(&frame(1.0)).to_string()
    );
    assert_eq!(sensor.ask("distance"), "");
    assert_eq!(sensor.ask("centre"), "");
    let both = format!(
        "{}\r\n{}",
        ReadingLine(&reading),
        CentreLine(&frame(1800.0))
    );
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), both);
    assert_eq!(sensor.ask("distance"), "");
    let advised = format!("{}\r\n({})", FaultLine(&TOO_DIM), advice(&TOO_DIM));
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), advised);
    assert!(!sensor.actions.may_drop);

    sensor.set("stream off");
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), "");
    assert_eq!(sensor.ask("distance"), "");
    assert_eq!(
        sensor.take(Event::Frame(Ok(frame(1800.0)))),
        ReadingLine(&reading).to_string()
    );
    assert_eq!(
        sensor.take(Event::Frame(Ok(frame(1800.0)))),
        "",
        "one frame is one answer"
    );
}

/// The columns come in the order of the line, whatever order was typed. Number and time come before a fault,
/// too.
#[test]
fn a_line_has_the_columns_that_output_sets() {
    let mut sensor = Sensor::new();
    let all = "output counter time distance u r centre height rows width exposure flags";
    let default = "output distance u r centre height rows exposure flags";
    let exposed = Measured {
        frame: FrameCentre {
            exposure: Exposure::from_us(187),
            ..frame(1800.0).frame
        },
        ..frame(1800.0)
    };
    let usual = sensor.take(Event::Frame(Ok(exposed)));
    assert!(usual.ends_with(" n 16/16 t 187 g"), "{usual}");
    let width = exposed.frame.width;
    let with_width = usual.replace(" t 187", &format!(" w {width} t 187"));
    let fault = FaultLine(&TOO_DIM).to_string();
    for (typed, answer, line, fault) in [
        (
            "output flags exposure width rows height centre r u distance time counter",
            all,
            format!("# 1234 @ 12345678 {with_width}"),
            format!("# 1234 @ 12345678 {fault}"),
        ),
        (
            "output distance counter",
            "output counter distance",
            "# 1234 d 788.8397 mm".to_owned(),
            format!("# 1234 {fault}"),
        ),
        (
            "output time time",
            "output time",
            "@ 12345678 d mm".to_owned(),
            format!("@ 12345678 {fault}"),
        ),
        (
            "output u r",
            "output u r",
            "d mm u 16.75 r 0.0008".to_owned(),
            fault.clone(),
        ),
        (
            "output rows flags",
            "output rows flags",
            "d mm n 16/16 g".to_owned(),
            fault.clone(),
        ),
        (default, default, usual.clone(), fault.clone()),
    ] {
        assert_eq!(sensor.ask(typed), answer);
        assert_eq!(sensor.actions.apply, None, "the frame goes on");
        assert_eq!(sensor.ask("output"), answer);
        let saved = Stored::Newest(sensor.save());
        let mut again = Sensor::started(saved);
        for sensor in [&mut sensor, &mut again] {
            assert_eq!(sensor.take(Event::Frame(Ok(exposed))), line);
            assert!(sensor.actions.may_drop);
            assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), fault);
            // An answer has the same columns. `centre` has its own.
            sensor.ask("distance");
            assert_eq!(sensor.take(Event::Frame(Ok(exposed))), line);
            sensor.ask("centre");
            let centre = sensor.take(Event::Frame(Ok(exposed)));
            assert_eq!(centre, CentreLine(&exposed).to_string());
        }
    }
    let listed = "E2 expected output NAMES, some of counter time distance u r centre height rows width \
                  exposure flags";
    for line in ["output none", "output distance, u", "output x"] {
        assert_eq!(sensor.ask(line), listed, "{line}");
    }
    for more in ["u", "u x"] {
        assert_eq!(sensor.ask(&format!("{all} {more}")), listed);
    }
    sensor.set("defaults");
    assert_eq!(sensor.ask("output"), default);
    sensor.ask("zero");
    sensor.take(Event::Frame(Ok(exposed)));
    sensor.set("output distance");
    assert_eq!(sensor.take(Event::Frame(Ok(exposed))), "z 0.0000 mm");
}

/// Each line has as many columns as the header. An empty one is a value that is not there.
#[test]
fn comma_separated_values_have_the_columns_of_their_header() {
    let mut sensor = Sensor::new();
    let default = "distance,u,r,centre,height,used,rows,slits,exposure,m,c,g,s,z,h,fault";
    assert_eq!(sensor.ask("format csv"), format!("format csv\r\n{default}"));
    assert_eq!(sensor.ask("format"), "format csv");
    let exposed = Measured {
        frame: FrameCentre {
            exposure: Exposure::from_us(187),
            misfits: 3,
            correlated: Some(4),
            ..frame(1800.0).frame
        },
        ..frame(1800.0)
    };
    let reading = "788.8397,16.75,0.0008,1800.0000,1993,16,16,1,187,3,4,1,0,0,0,";
    let plain = "788.8397,16.74,0.0008,1800.0000,1993,16,16,1,,0,,1,0,0,0,";
    let fault = ",,,,,,,,,,,,,,,too dim";
    let stream = |sensor: &mut Sensor, result| {
        let line = sensor.take(Event::Frame(result));
        assert!(sensor.actions.may_drop && sensor.actions.result.is_none());
        line
    };
    assert_eq!(stream(&mut sensor, Ok(exposed)), reading);
    assert_eq!(stream(&mut sensor, Ok(frame(1800.0))), plain);
    assert_eq!(stream(&mut sensor, Err(TOO_DIM)), fault);
    // An answer has the columns, too, and no advice, which is no value.
    sensor.ask("distance");
    assert_eq!(sensor.take(Event::Frame(Ok(exposed))), reading);
    sensor.ask("distance");
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), fault);
    let all = "counter time distance u r centre height rows width exposure flags";
    let header =
        "number,us,distance,u,r,centre,height,used,rows,slits,width,exposure,m,c,g,s,z,h,fault";
    let width = exposed.frame.width;
    for (names, header, of_reading, of_fault) in [
        (
            all,
            header,
            format!(
                "1234,12345678,788.8397,16.75,0.0008,1800.0000,1993,16,16,1,{width},187,3,4,1,0,0,0,"
            ),
            "1234,12345678,,,,,,,,,,,,,,,,,too dim",
        ),
        (
            "time",
            "us,z,h,fault",
            "12345678,0,0,".to_owned(),
            "12345678,,,too dim",
        ),
        (
            "rows",
            "used,rows,slits,z,h,fault",
            "16,16,1,0,0,".to_owned(),
            ",,,,,too dim",
        ),
        (
            "flags",
            "m,c,g,s,z,h,fault",
            "3,4,1,0,0,0,".to_owned(),
            ",,,,,,too dim",
        ),
        (
            "distance",
            "distance,z,h,fault",
            "788.8397,0,0,".to_owned(),
            ",,,too dim",
        ),
    ] {
        let set = format!("output {names}");
        assert_eq!(sensor.ask(&set), format!("{set}\r\n{header}"));
        let lines = [
            stream(&mut sensor, Ok(exposed)),
            stream(&mut sensor, Err(TOO_DIM)),
        ];
        assert_eq!(lines, [of_reading.as_str(), of_fault]);
        let commas = |line: &str| line.matches(',').count();
        assert!(
            lines.iter().all(|line| commas(line) == commas(header)),
            "{lines:?}"
        );
    }
    // Relative to a master, held, and in the other unit.
    sensor.set("hold 2");
    sensor.set("units um");
    sensor.ask("master -0.5");
    assert_eq!(sensor.take(Event::Frame(Ok(exposed))), "788839.7,0,0,");
    assert_eq!(stream(&mut sensor, Ok(exposed)), "-0.5,1,0,");
    assert_eq!(stream(&mut sensor, Err(TOO_DIM)), "-0.5,1,1,");
    assert_eq!(stream(&mut sensor, Err(TOO_DIM)), "-0.5,1,2,");
    assert_eq!(stream(&mut sensor, Err(TOO_DIM)), ",,,too dim");
    // The columns of the factory come back, and the format stays.
    assert_eq!(sensor.ask("defaults"), format!("defaults\r\n{default}"));
    assert_eq!(stream(&mut sensor, Ok(frame(1800.0))), plain);
    sensor.set("format text");
    sensor.set("output distance");
    assert_eq!(stream(&mut sensor, Ok(frame(1800.0))), "d 788.8397 mm");
    sensor.set("format binary");
    // A reader of text took the packets for a line, which must end before the answer.
    assert_eq!(
        sensor.ask("format csv"),
        "\r\nformat csv\r\ndistance,z,h,fault"
    );
}

/// Four readings of a target at rest: r is half of one reading's, and u keeps what they share.
#[test]
fn readings_are_averaged_until_something_that_they_share_changes() {
    let mut sensor = Sensor::new();
    for (line, error) in [
        ("average moving 1", "E3 out of range, expected"),
        ("average median 65", "E3 out of range, expected"),
        ("average recursive 0", "E3 out of range, expected"),
        ("average moving", "E2 expected"),
        ("average none 2", "E2 expected"),
        ("average mean 2", "E2 expected"),
    ] {
        let form = "average none|moving 2..64|median 2..64|recursive 2..64";
        assert_eq!(sensor.ask(line), format!("{error} {form}"));
    }
    for line in [
        "average moving 64",
        "average median 2",
        "average recursive 64",
        "average none",
    ] {
        sensor.set(line);
        assert_eq!(sensor.actions.apply, None, "the frame goes on");
    }
    let noisy = Measured {
        frame: FrameCentre {
            uncertainty: Pixels::from_f32(0.2),
            ..frame(1800.0).frame
        },
        ..frame(1800.0)
    };
    sensor.set("average moving 4");
    let repeatability = |sensor: &mut Sensor| -> f64 {
        let line = sensor.take(Event::Frame(Ok(noisy)));
        println!("{line}");
        assert!(line.starts_with("d 788.8397 mm u 16.74 r "), "{line}");
        let (_, rest) = line.split_once(" r ").expect("r");
        let (r, _) = rest.split_once(" x ").expect("r");
        r.parse().expect("a number")
    };
    // Lines have a tenth of a micrometre.
    let is_near = |r: f64, of: f64| (r - of).abs() < 1e-4;
    let alone = repeatability(&mut sensor);
    for count in 2..=5 {
        let r = repeatability(&mut sensor);
        assert!(is_near(r, alone / f64::from(count.min(4)).sqrt()), "{r}");
    }
    // A fault is put out, and takes a place.
    assert_eq!(
        sensor.take(Event::Frame(Err(TOO_DIM))),
        FaultLine(&TOO_DIM).to_string()
    );
    assert!(is_near(repeatability(&mut sensor), alone / 3f64.sqrt()));
    for end in [
        "estimator adaptive",
        "black shielded",
        "slits one",
        "rows 7",
        "region all",
        "peak strongest",
        "calibration on",
        "average moving 5",
    ] {
        sensor.set(end);
        assert!(is_near(repeatability(&mut sensor), alone), "{end}");
    }
    sensor.set("rate 0");
    assert!(is_near(repeatability(&mut sensor), alone / 2f64.sqrt()));
    // `zero` takes an average. The readings that are relative to it are averages, too.
    sensor.ask("zero");
    sensor.take(Event::Frame(Ok(noisy)));
    let line = sensor.take(Event::Frame(Ok(noisy)));
    assert!(line.starts_with("z 0.0000 mm "), "{line}");
    sensor.set("defaults");
    assert_eq!(sensor.ask("average"), "average none");
}

/// A held reading has the flag `h` whatever the columns are. It is no answer, no zero and no reading of
/// `status`.
#[test]
fn the_last_reading_is_held_after_faults_and_flagged() {
    let mut sensor = Sensor::new();
    let fault = FaultLine(&TOO_DIM).to_string();
    for line in ["hold 1001", "hold 99999999999"] {
        let error = "E3 out of range, expected hold 0..1000";
        assert_eq!(sensor.ask(line), error);
    }
    for line in ["hold -1", "hold 2 2"] {
        assert_eq!(sensor.ask(line), "E2 expected hold 0..1000");
    }
    sensor.set("hold 2");
    assert_eq!(sensor.actions.apply, None, "the frame goes on");
    // There is no reading yet.
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), fault);
    let reading = sensor.take(Event::Frame(Ok(frame(1800.0))));
    for _ in 0..2 {
        for age in 1..=2 {
            let held = sensor.take(Event::Frame(Err(TOO_DIM)));
            assert_eq!(held, format!("{reading} h {age}"));
            assert!(sensor.actions.may_drop);
        }
        for _ in 0..2 {
            assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), fault);
        }
        assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), reading);
    }
    sensor.ask("distance");
    let advised = format!("{}\r\n({})", FaultLine(&TOO_DIM), advice(&TOO_DIM));
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), advised);
    sensor.ask("zero");
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), advised);
    let status = sensor.ask("status");
    assert!(status.contains("\r\nstatus readings 3\r\n"), "{status}");
    assert!(
        status.contains("\r\nstatus fault too dim 11\r\n"),
        "{status}"
    );
    sensor.set("output distance");
    sensor.ask("zero");
    assert_eq!(
        sensor.take(Event::Frame(Ok(frame(1800.0)))),
        "d 788.8397 mm"
    );
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), "z 0.0000 mm h 1");
    // A reading of before a change of the calibration is not held.
    sensor.set("estimator centroid");
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), fault);
    sensor.set("hold 1000");
    sensor.take(Event::Frame(Ok(frame(1800.0))));
    for age in 1..=1000 {
        let held = sensor.take(Event::Frame(Err(TOO_DIM)));
        assert_eq!(held, format!("d 788.8397 mm h {age}"));
    }
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), fault);
    sensor.take(Event::Frame(Ok(frame(1800.0))));
    sensor.set("hold 0");
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), fault);
}

#[test]
fn distances_are_in_the_unit_that_is_set() {
    let mut sensor = Sensor::new();
    for line in ["units m", "units mm um"] {
        assert_eq!(sensor.ask(line), "E2 expected units mm|um");
    }
    let mm = sensor.take(Event::Frame(Ok(frame(1800.0))));
    sensor.set("units um");
    assert_eq!(sensor.actions.apply, None, "the frame goes on");
    let um = sensor.take(Event::Frame(Ok(frame(1800.0))));
    // u is above 10 mm, and has fewer digits in both units.
    let start = "d 788839.7 um u 16739 r 0.8 x ";
    assert!(um.starts_with(start), "{um}");
    let rest = |line: &str| line.split_once(" x ").map(|(_, rest)| rest.to_owned());
    assert_eq!(rest(&um), rest(&mm));
    sensor.ask("uncertainty");
    let parts = sensor.take(Event::Frame(Ok(frame(1800.0))));
    assert!(
        parts.contains("\r\nuncertainty noise 0.8 um\r\n"),
        "{parts}"
    );
    sensor.ask("zero");
    sensor.take(Event::Frame(Ok(frame(1800.0))));
    let line = sensor.take(Event::Frame(Ok(frame(1800.0))));
    assert!(line.starts_with("z 0.0 um u 1.1 r 1.1 x "), "{line}");
    sensor.set("units mm");
    sensor.set("zero off");
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1800.0)))), mm);
}

/// A line that is not due is left out. The filter sees its reading, and an answer comes at once.
#[test]
fn lines_are_left_out_down_to_the_rate_that_is_set() {
    let mut sensor = Sensor::new();
    for (line, error) in [
        ("rate 1001", "E3 out of range, expected rate 0..1000 Hz"),
        ("rate 0.5", "E2 expected rate 0..1000 Hz"),
    ] {
        assert_eq!(sensor.ask(line), error);
    }
    let mut us = 12_345_678;
    let mut next = |sensor: &mut Sensor| {
        // A frame of 16 rows.
        us += 91_200;
        let vitals = Vitals {
            result_us: us,
            ..vitals()
        };
        let frame = Event::Frame(Ok(frame(1800.0)));
        sensor.session.take(frame, &vitals, &mut sensor.actions);
        !sensor.actions.text.as_str().is_empty()
    };
    for (rate, expected) in [(0, 1000), (1, 91), (5, 456), (1000, 1000)] {
        sensor.set(&format!("rate {rate}"));
        next(&mut sensor);
        let sent = (0..1000).filter(|_| next(&mut sensor)).count();
        println!("rate {rate}: {sent} lines in 91.2 s");
        assert!(sent.abs_diff(expected) <= 1, "{rate}: {sent}");
    }
    sensor.set("rate 1");
    while !next(&mut sensor) {}
    sensor.ask("distance");
    assert!(next(&mut sensor) && !sensor.actions.may_drop);
    assert!(!next(&mut sensor));
}

#[test]
fn the_parts_of_one_reading_are_shown() {
    let mut sensor = Sensor::new();
    assert_eq!(sensor.ask("uncertainty"), "");
    let answer = sensor.take(Event::Frame(Ok(frame(1800.0))));
    println!("{answer}");
    let lines: Vec<&str> = answer.split("\r\n").collect();
    assert!(lines[0].starts_with("d 788.8397 mm u 16.74 r 0.0008 x "));
    let part = |name: &str| -> f64 {
        let start = format!("uncertainty {name} ");
        let line = lines.iter().find_map(|line| line.strip_prefix(&start));
        let value = line.and_then(|line| line.strip_suffix(" mm"));
        value.expect("a part").parse().expect("a number")
    };
    let names = [
        "noise",
        "shape",
        "pixels",
        "calibration",
        "surface",
        "geometry",
        "motion",
    ];
    let squares: f64 = names.map(|name| part(name).powi(2)).iter().sum();
    assert!((squares.sqrt() - 16.74).abs() < 0.01);
    assert_eq!(lines.len(), 1 + names.len());
    assert!(!sensor.actions.may_drop);

    assert_eq!(sensor.ask("surface off"), "surface off");
    sensor.ask("uncertainty");
    let answer = sensor.take(Event::Frame(Ok(frame(1800.0))));
    assert!(
        answer.contains("\r\nuncertainty surface 0.0000 mm\r\n"),
        "{answer}"
    );
    sensor.set("surface 437");
    sensor.ask("uncertainty");
    let answer = sensor.take(Event::Frame(Ok(frame(1800.0))));
    // 1993 counts, where 1000 are usual.
    assert!(
        answer.contains("\r\nuncertainty surface 0.3095 mm\r\n"),
        "{answer}"
    );
}

/// The nominal calibration marks each line, and so do settings that are not the calibration's.
#[test]
fn lines_are_marked_if_the_calibration_is_not_for_them() {
    let mut sensor = Sensor::new();
    let flags = |sensor: &mut Sensor| {
        let line = sensor.take(Event::Frame(Ok(frame(1800.0))));
        let (_, flags) = line.split_once(" n 16/16").expect("a reading");
        flags.to_owned()
    };
    assert_eq!(flags(&mut sensor), " g");
    // The nominal calibration is no one's: other settings add nothing.
    sensor.set("estimator centroid");
    assert_eq!(flags(&mut sensor), " g");
    let mut own = own_record().record().clone();
    own.errors = CalibrationErrors::Unknown;
    sensor.upload(&EncodedRecord::new(own).expect("a record"));
    assert_eq!(flags(&mut sensor), "");
    sensor.set("estimator phase-table");
    assert_eq!(flags(&mut sensor), " s");
    sensor.set("estimator adaptive");
    sensor.set("black shielded");
    assert_eq!(flags(&mut sensor), " s");
    sensor.set("black frame");
    assert_eq!(flags(&mut sensor), "");
}

/// The difference loses what both readings share: here all but the noise, because nothing has moved.
#[test]
fn distances_are_relative_to_zero() {
    let mut sensor = Sensor::new();
    assert_eq!(sensor.ask("zero"), "");
    let zero = sensor.take(Event::Frame(Ok(frame(1800.0))));
    assert!(
        zero.starts_with("d 788.8397 mm u 16.74 r 0.0008 "),
        "{zero}"
    );
    assert!(!sensor.actions.may_drop);
    let same = sensor.take(Event::Frame(Ok(frame(1800.0))));
    assert!(
        same.starts_with("z 0.0000 mm u 0.0011 r 0.0011 x 1800.0000 "),
        "{same}"
    );
    let far = sensor.take(Event::Frame(Ok(frame(1700.0))));
    println!("{far}");
    assert!(far.starts_with("z 39.6"), "{far}");
    sensor.ask("distance");
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1700.0)))), far);
    sensor.ask("uncertainty");
    let parts = sensor.take(Event::Frame(Ok(frame(1700.0))));
    assert!(
        parts.starts_with(&far) && parts.contains("\r\nuncertainty noise "),
        "{parts}"
    );
    // A fault leaves the zero as it was.
    sensor.ask("zero");
    let advised = format!("{}\r\n({})", FaultLine(&TOO_DIM), advice(&TOO_DIM));
    assert_eq!(sensor.take(Event::Frame(Err(TOO_DIM))), advised);
    assert_eq!(sensor.take(Event::Frame(Ok(frame(1700.0)))), far);
    for end in ["zero off", "defaults", "estimator adaptive"] {
        sensor.ask("zero");
        sensor.take(Event::Frame(Ok(frame(1800.0))));
        sensor.ask(end);
        let line = sensor.take(Event::Frame(Ok(frame(1700.0))));
        assert!(line.starts_with("d "), "{end}: {line}");
    }
}

/// `master` is `zero` with another value: it moves all distances by the value, and nothing else.
#[test]
fn the_place_of_a_reading_has_the_distance_that_master_sets() {
    let mut sensor = Sensor::new();
    assert_eq!(sensor.ask("master"), "zero off");
    let shown = |sensor: &mut Sensor, centre| sensor.take(Event::Frame(Ok(frame(centre))));
    let of_zero = {
        sensor.ask("zero");
        let from_the_laser = shown(&mut sensor, 1800.0);
        assert!(
            from_the_laser.starts_with("d 788.8397 mm "),
            "{from_the_laser}"
        );
        [shown(&mut sensor, 1800.0), shown(&mut sensor, 1700.0)]
    };
    let distance = |line: &str| -> (f64, String) {
        let rest = line.strip_prefix("z ").expect("relative");
        let (number, rest) = rest.split_once(' ').expect("a distance");
        (number.parse().expect("a number"), rest.to_owned())
    };
    for (typed, value) in [
        ("master 500.000", 500.0),
        ("master 0", 0.0),
        ("master -4000", -4000.0),
        ("master 4000", 4000.0),
        ("MASTER 0.0001", 0.0001),
    ] {
        assert_eq!(sensor.ask(typed), "");
        assert_eq!(sensor.actions.apply, None, "the frame goes on");
        // The answer is the reading from the laser, as that of `zero`.
        assert!(shown(&mut sensor, 1800.0).starts_with("d 788.8397 mm "));
        assert!(!sensor.actions.may_drop);
        for (centre, zero) in [(1800.0, &of_zero[0]), (1700.0, &of_zero[1])] {
            let ((found, rest), (zero, rest_of_zero)) =
                (distance(&shown(&mut sensor, centre)), distance(zero));
            // Both are rounded to a tenth of a micrometre.
            assert!((found - zero - value).abs() < 1.1e-4, "{typed}: {found}");
            assert_eq!(rest, rest_of_zero, "{typed}");
        }
    }
    assert_eq!(sensor.ask("master"), "master 0.0001");
    let before = shown(&mut sensor, 1700.0);
    for (line, error) in [
        (
            "master 1 2",
            "E2 expected master [VALUE], with four decimals at most",
        ),
        (
            "master 1e3",
            "E2 expected master [VALUE], with four decimals at most",
        ),
        (
            "master 4000.0001",
            "E23 out of range, expected master -4000..4000 mm, or -4000000..4000000 with units um",
        ),
        (
            "master -99999999999999999999",
            "E23 out of range, expected master -4000..4000 mm, or -4000000..4000000 with units um",
        ),
    ] {
        assert_eq!(sensor.ask(line), error);
        assert_eq!(shown(&mut sensor, 1700.0), before, "{line} changes nothing");
    }
    // A fault leaves the master as it was.
    sensor.ask("master 1");
    assert!(
        sensor
            .take(Event::Frame(Err(TOO_DIM)))
            .starts_with("f too dim")
    );
    assert_eq!(shown(&mut sensor, 1700.0), before);
    sensor.set("units um");
    sensor.ask("master 1234.5");
    assert!(shown(&mut sensor, 1800.0).starts_with("d 788839.7 um "));
    assert!(shown(&mut sensor, 1800.0).starts_with("z 1234.5 um "));
    assert!(sensor.ask("master 4000000.1").starts_with("E23 "));
    assert_eq!(sensor.ask("master"), "master 1234.5");
    sensor.set("zero off");
    assert!(shown(&mut sensor, 1800.0).starts_with("d 788839.7 um "));
}

/// Three readings in succession at the new place, and the third one is good. The limits of the setting are
/// inclusive.
#[test]
fn a_reading_that_jumps_is_a_fault_until_three_agree() {
    let mut sensor = Sensor::new();
    let form = "expected spike-filter off|1..100000";
    for (line, error) in [
        ("spike-filter 0", "E3 out of range, "),
        ("spike-filter 100001", "E3 out of range, "),
        ("spike-filter 99999999999", "E3 out of range, "),
        ("spike-filter -1", "E2 "),
        ("spike-filter on", "E2 "),
        ("spike-filter 1 2", "E2 "),
    ] {
        assert_eq!(sensor.ask(line), format!("{error}{form}"));
    }
    for line in ["spike-filter 1", "spike-filter 100000", "spike-filter off"] {
        sensor.set(line);
        assert_eq!(sensor.actions.apply, None, "the frame goes on");
    }
    let near = frame(1800.0);
    let far = frame(1700.0);
    let says = |sensor: &mut Sensor, measured| sensor.take(Event::Frame(Ok(measured)));
    let [of_near, of_far] = [near, far].map(|it| says(&mut sensor, it));
    assert!(of_near.starts_with("d 788.8397 mm ") && of_far.starts_with("d 828.4"));
    sensor.set("spike-filter 39000");
    assert_eq!(says(&mut sensor, near), of_near);
    let spike = "f spike: 396";
    for _ in 0..2 {
        let line = says(&mut sensor, far);
        assert!(
            line.starts_with(spike) && line.ends_with(" um from the last good reading"),
            "{line}"
        );
    }
    assert_eq!(says(&mut sensor, far), of_far);
    assert!(says(&mut sensor, near).starts_with(spike));
    // A fault is no reading, and ends the succession.
    assert!(says(&mut sensor, near).starts_with(spike));
    assert_eq!(
        sensor.take(Event::Frame(Err(TOO_DIM))),
        FaultLine(&TOO_DIM).to_string()
    );
    for _ in 0..2 {
        assert!(says(&mut sensor, near).starts_with(spike));
    }
    assert_eq!(says(&mut sensor, near), of_near);
    let status = sensor.ask("status");
    assert!(status.contains("\r\nstatus fault spike 6\r\n"), "{status}");
    // 39.7 mm is no jump for a filter of 40 mm.
    sensor.set("spike-filter 40000");
    assert_eq!(says(&mut sensor, far), of_far);
    sensor.set("spike-filter 39000");
    // The filter comes before `average`, `hold` and the limits: all three see a fault.
    sensor.set("average moving 2");
    sensor.set("hold 1");
    sensor.set("limits 828000 829000");
    assert_eq!(says(&mut sensor, far), of_far);
    assert_eq!(says(&mut sensor, near), format!("{of_far} h 1"));
    assert!(sensor.session.is_within_limits());
    assert!(says(&mut sensor, near).starts_with(spike));
    assert!(!sensor.session.is_within_limits());
    // `zero` takes no spike, and its answer says what to do.
    sensor.ask("zero");
    assert!(says(&mut sensor, far).starts_with("d 828.4"));
    sensor.ask("zero");
    let answer = says(&mut sensor, near);
    assert!(
        answer.starts_with(spike) && answer.ends_with(')'),
        "{answer}"
    );
    sensor.set("zero off");
    // A change of the measurement or the calibration forgets the last good reading.
    for end in ["rows 7", "estimator adaptive", "calibration on"] {
        says(&mut sensor, far);
        says(&mut sensor, far);
        says(&mut sensor, far);
        sensor.set(end);
        assert!(
            says(&mut sensor, near).starts_with("d 788.8397 mm "),
            "{end}"
        );
    }
    // Packets have the fault, too.
    sensor.set("format binary");
    says(&mut sensor, far);
    let result = sensor.actions.result.expect("a result").result;
    assert!(matches!(result, Err(Fault::Spike { .. })), "{result:?}");
    let saved = Stored::Newest(sensor.save());
    assert_eq!(
        Sensor::started(saved).ask("spike-filter"),
        "spike-filter 39000"
    );
}

/// The output follows what a line shows: a distance relative to the zero, an average, a held reading.
#[test]
fn a_distance_within_the_limits_switches_the_output_on() {
    let mut sensor = Sensor::new();
    let near = Ok(frame(1800.0)); // 788.8397 mm
    let far = Ok(frame(1700.0)); // 828.5 mm
    let is_on = |sensor: &mut Sensor, result| {
        sensor.take(Event::Frame(result));
        let is_on = sensor.session.is_within_limits();
        let line = if is_on {
            "status limits on"
        } else {
            "status limits off"
        };
        assert!(sensor.ask("status").lines().any(|it| it == line));
        is_on
    };
    assert!(!is_on(&mut sensor, near), "no limits");
    for line in [
        "limits -8000000 8000000 1000000",
        "limits 8000000 8000000",
        "limits -8000000 -8000000 1",
        "limits off",
        "limits 788000 789000",
    ] {
        sensor.set(line);
        assert_eq!(sensor.actions.apply, None, "the frame goes on");
        assert!(
            !sensor.session.is_within_limits(),
            "no distance yet: {line}"
        );
    }
    let form = "expected limits off|LOW HIGH [HYSTERESIS]";
    for (line, error) in [
        ("limits 0 8000001", "E3 out of range, "),
        ("limits -8000001 0", "E3 out of range, "),
        ("limits 2 1", "E3 out of range, "),
        ("limits 1 2 1000001", "E3 out of range, "),
        ("limits 1", "E2 "),
        ("limits 1 2 -3", "E2 "),
        ("limits 1.5 2", "E2 "),
    ] {
        assert_eq!(sensor.ask(line), format!("{error}{form}"));
    }
    assert!(is_on(&mut sensor, near));
    assert!(!is_on(&mut sensor, far));
    assert!(is_on(&mut sensor, near));
    assert!(!is_on(&mut sensor, Err(TOO_DIM)));
    // A step of 39.7 mm is within 40 mm of hysteresis: the output stays, but it does not switch on there.
    sensor.set("limits 788000 789000 40000");
    assert!(!is_on(&mut sensor, far));
    assert!(is_on(&mut sensor, near));
    assert!(is_on(&mut sensor, far));
    assert!(!is_on(&mut sensor, Err(TOO_DIM)));
    // A held reading counts for as long as it is held.
    sensor.set("hold 2");
    let with_fault = [near, Err(TOO_DIM), Err(TOO_DIM), Err(TOO_DIM)];
    assert_eq!(
        with_fault.map(|it| is_on(&mut sensor, it)),
        [true, true, true, false]
    );
    sensor.set("hold 0");
    // Lines that `rate` leaves out count, too, and so do those of a stream that is off.
    sensor.set("rate 1");
    sensor.set("stream off");
    assert!(is_on(&mut sensor, near));
    // A change of the measurement: off until the next reading.
    sensor.set("rows 8");
    assert!(!sensor.session.is_within_limits());
    assert!(is_on(&mut sensor, near));
    // Half of two readings: 808.7 mm.
    sensor.set("average moving 2");
    sensor.set("limits 800000 820000");
    assert_eq!([near, far].map(|it| is_on(&mut sensor, it)), [false, true]);
    sensor.set("average none");
    // The frame of the zero has the distance 0, although its answer is the reading from the laser.
    sensor.set("limits -1 1");
    sensor.ask("zero");
    assert!(is_on(&mut sensor, near) && !is_on(&mut sensor, far));
    sensor.set("limits -500001 -499999");
    sensor.ask("master -500");
    assert!(is_on(&mut sensor, far) && !is_on(&mut sensor, near));
    // Rows that are sent whole have no results.
    assert!(is_on(&mut sensor, far));
    for line in ["format binary", "stream on"] {
        sensor.set(line);
    }
    assert!(sensor.session.is_within_limits());
    sensor.set("pixels rows");
    assert!(!sensor.session.is_within_limits());
    sensor.set("pixels none");
    let saved = Stored::Newest(sensor.save());
    assert_eq!(
        Sensor::started(saved).ask("limits"),
        "limits -500001 -499999"
    );
    sensor.set("defaults");
    assert!(!is_on(&mut sensor, near));
}

/// Two readings with different maps do not share the errors of the pixels.
#[test]
fn another_map_of_the_pixels_ends_the_zero() {
    let mut sensor = Sensor::new();
    let errors = PixelErrors {
        response_q16: 38,
        offset: Counts::from_bits(66),
    };
    let without = frame(1800.0);
    let with = Measured {
        pixels: errors,
        ..without
    };
    let summary = MapSummary {
        errors,
        pattern: Counts::from_int(5),
        outside: 0,
    };
    let taken = Taken {
        mean: Counts::from_int(2300),
        map: Some(summary),
    };
    let taken = Event::Flat(Outcome::Taken(Kind::Lit, Ok(taken)));
    let loaded = Event::Flat(Outcome::Loaded(Ok(StoredMap::Newest), Some(summary)));
    let erased = Event::Flat(Outcome::Erased(Ok(())));
    let saved = Event::Flat(Outcome::Saved(Ok(())));
    // What happens after the zero, and whether the zero stays. `flat on` and `flat off` show in the frames.
    for (zero, event, now, stays) in [
        (without, None, without, true),
        (without, None, with, false),
        (with, None, without, false),
        (with, Some(saved), with, true),
        (with, Some(taken), with, false),
        (with, Some(loaded), with, false),
        (with, Some(erased), with, false),
    ] {
        sensor.ask("zero");
        sensor.take(Event::Frame(Ok(zero)));
        let what = format!("{event:?}");
        event.map(|event| sensor.take(event));
        let line = sensor.take(Event::Frame(Ok(now)));
        assert_eq!(line.starts_with("z "), stays, "{what}: {line}");
    }
}

#[test]
fn without_a_calibration_there_is_a_fault_and_no_distance() {
    let mut sensor = Sensor::new();
    sensor.set("calibration off");
    let fault = Fault::NotCalibrated {
        centre: Pixels::from_f32(1800.0),
        uncertainty: Pixels::from_f32(0.002),
    };
    assert_eq!(
        sensor.take(Event::Frame(Ok(frame(1800.0)))),
        FaultLine(&fault).to_string()
    );

    let mut sensor = Sensor::started(Stored::Unusable);
    assert_eq!(
        sensor.take(Event::Frame(Ok(frame(1800.0)))),
        FaultLine(&fault).to_string()
    );
    assert!(
        sensor
            .ask("calibration")
            .starts_with("calibration none\r\ncalibration fault ")
    );
    for line in ["calibration on", "calibration data 0", "save"] {
        assert_eq!(
            sensor.ask(line),
            "E15 there is no calibration: upload one, or defaults",
            "{line}"
        );
        assert!(!sensor.actions.save);
    }
    assert_eq!(sensor.session.configuration(), None);
    sensor.set("defaults");
    sensor.save();
    assert!(
        sensor
            .ask("calibration")
            .contains("\r\ncalibration stored same")
    );
}

/// `defaults` has no calibration for another sensor, so the refusals do not send the user there.
#[test]
fn another_sensor_takes_a_save_after_an_upload_only() {
    let geometry = Geometry {
        polarity: Polarity::Rising,
        ..tcd1304dg()
    };
    let mut sensor = Sensor::with_head(geometry.clone(), Stored::Nothing);
    for line in [
        "save",
        "save nominal",
        "calibration on",
        "calibration data 0",
    ] {
        sensor.set("defaults");
        assert_eq!(
            sensor.ask(line),
            "E15 there is no calibration: calibrate this sensor and upload the record; defaults has none",
            "{line}"
        );
        assert!(!sensor.actions.save);
    }
    let knots = [(500, 1_000_000), (1000, 800_000), (1500, 700_000)].map(|(x, um)| Knot {
        centre: Pixels::from_int(x),
        value: Micrometres::from_int(um),
    });
    let own = Record {
        geometry,
        calibration: Calibration::Table(Table::new(&knots).expect("a table")),
        errors: CalibrationErrors::Unknown,
        ..own_record().record().clone()
    };
    sensor.upload(&EncodedRecord::new(own).expect("a usable record"));
    sensor.save();
}

#[test]
fn an_upload_is_used_when_it_is_whole_with_the_settings_it_was_made_with() {
    let own = own_record();
    let mut sensor = Sensor::new();
    sensor.upload(&own);
    let applied = sensor.actions.apply.clone().expect("settings");
    assert_eq!(applied.settings.estimator, Estimator::Adaptive);
    assert_eq!(applied.settings.black_level, BlackLevel::Frame);
    assert_eq!(sensor.session.record(), Some(own.record()));
    let shown = sensor.ask("calibration");
    assert!(
        shown.contains("\r\ncalibration source uploaded\r\n"),
        "{shown}"
    );
    let mut read = Vec::new();
    while read.len() < own.bytes().len() {
        let line = sensor.ask(&format!("calibration data {}", read.len()));
        match parse(line.as_bytes()) {
            Ok(Command::Upload(Step::Piece(piece))) => read.extend_from_slice(piece.bytes()),
            other => panic!("{line}: {other:?}"),
        }
    }
    assert_eq!(read, own.bytes());
    let beyond = sensor.ask(&format!("calibration data {}", read.len()));
    assert!(beyond.starts_with("E14 "), "{beyond}");

    // Not whole: nothing changes.
    sensor.set("calibration begin 47");
    assert!(sensor.ask("calibration commit").starts_with("E11 0 of 47 "));
    sensor.set("calibration abort");
    assert!(sensor.ask("calibration commit").starts_with("E8 "));
    assert_eq!(sensor.session.record(), Some(own.record()));
}

/// The measurement compares rows with the sensor's own spot only while the calibration that learned it is on.
#[test]
fn the_measurement_learns_the_own_spot_from_an_upload_and_loses_it_with_the_calibration() {
    let profile = Profile {
        first: Pixels::from_int(1000),
        last: Pixels::from_int(2600),
        width: [Pixels::from_int(8); PLACES],
        width_deviation: Pixels::from_f32(0.01),
        components: [[Pixels::from_f32(0.125); PLACES]; COMPONENTS],
        deviation: Pixels::from_f32(0.001),
    };
    let record = Record {
        profile: Some(profile),
        ..own_record().record().clone()
    };
    let mut sensor = Sensor::new();
    sensor.upload(&EncodedRecord::new(record).expect("a record"));
    let settings = *sensor.session.settings();
    assert_eq!(settings.estimator, Estimator::Adaptive);
    assert_eq!(sensor.actions.apply, Some(applied(settings, Some(profile))));
    for (line, own) in [("calibration off", None), ("calibration on", Some(profile))] {
        sensor.set(line);
        assert_eq!(sensor.actions.apply, Some(applied(settings, own)), "{line}");
    }
    // A setting is applied with the own spot. The calibration of the factory knows none.
    sensor.set("mean plain");
    let settings = *sensor.session.settings();
    assert_eq!(sensor.actions.apply, Some(applied(settings, Some(profile))));
    sensor.set("defaults");
    let settings = *sensor.session.settings();
    assert_eq!(sensor.actions.apply, Some(applied(settings, None)));
}

/// A front end that differs from the one that the driver assumes.
fn front_end() -> FrontEnd {
    let counts = |value| Estimate {
        value: Counts::from_int(value),
        u: Counts::from_int(1),
    };
    FrontEnd {
        polarity: Polarity::Rising,
        gain: Estimate {
            value: Electrons::from_int(8),
            u: Electrons::from_f32(0.1),
        },
        read_noise: counts(5),
        saturation: Some(counts(2700)),
        black_level: counts(320),
    }
}

/// The front end is known on a sensor that nobody has calibrated, too. It stays over a save and a start, and
/// with the calibration off. `defaults` forgets it, and `save` then does not replace it unasked.
#[test]
fn a_measured_front_end_is_used_saved_and_kept() {
    for calibration in [
        Record::nominal().expect("a record"),
        own_record().record().clone(),
    ] {
        let record = Record {
            front_end: Some(front_end()),
            ..calibration
        };
        let measured = front_end().geometry(&tcd1304dg());
        assert_eq!(measured.polarity, Polarity::Rising);
        assert_eq!(measured.shot_variance_per_count_q16, 8192);
        assert_eq!(measured.saturation, 2680);
        let encoded = EncodedRecord::new(record.clone()).expect("a record");
        let mut sensor = Sensor::new();
        assert!(sensor.ask("info").contains("\r\ninfo front end assumed, "));
        assert!(
            sensor
                .ask("calibration")
                .contains("\r\ncalibration front-end assumed\r\n")
        );
        sensor.upload(&encoded);
        let geometry = |sensor: &mut Sensor| sensor.actions.apply.take().map(|it| it.geometry);
        assert_eq!(geometry(&mut sensor), Some(measured.clone()));
        assert_eq!(sensor.session.geometry(), measured);
        let info = sensor.ask("info");
        assert!(
            info.contains("\r\ninfo front end gain 8.00 electrons"),
            "{info}"
        );
        assert!(info.contains("counts that rise with light"), "{info}");
        assert!(
            sensor
                .ask("calibration")
                .contains("\r\ncalibration front-end measured\r\n")
        );
        sensor.set("calibration off");
        assert_eq!(geometry(&mut sensor), Some(measured.clone()));
        sensor.set("calibration on");

        let saved = sensor.save();
        assert_eq!(saved.record.as_ref(), Some(&record));
        let mut again = Sensor::comb_started(Stored::Newest(saved));
        assert_eq!(geometry(&mut again), Some(measured));
        assert_eq!(again.session.record(), Some(&record));

        again.set("defaults");
        assert_eq!(geometry(&mut again), Some(tcd1304dg()));
        let refusal = again.ask("save");
        assert!(refusal.starts_with("E17 "), "{refusal}");
        // A second measurement may be saved.
        let second = Record {
            front_end: Some(FrontEnd {
                saturation: None,
                ..front_end()
            }),
            ..record
        };
        again.upload(&EncodedRecord::new(second.clone()).expect("a record"));
        assert_eq!(again.save().record, Some(second));
    }
}

/// A record with a comb sets `slits comb`, and a record without one sets `slits one`.
#[test]
fn the_measurement_learns_the_slits_of_a_comb_from_an_upload() {
    let places = [-3000, -1000, 100, 1500, 2600];
    let slits = places.map(|place| SlitMap::nominal(place).corrected([Pixels::from_f32(0.5); 4]));
    let comb = Comb::new(&slits).expect("ascending");
    let with = Record {
        comb: Some(comb.clone()),
        errors: CalibrationErrors::Unknown,
        ..own_record().record().clone()
    };
    let with = EncodedRecord::new(with).expect("a record");
    let mut sensor = Sensor::new();
    sensor.upload(&with);
    let settings = *sensor.session.settings();
    assert_eq!(settings.slits, Slits::Comb);
    let expected = Applied {
        settings,
        geometry: tcd1304dg(),
        profile: None,
        comb: Some(comb),
    };
    assert_eq!(sensor.actions.apply, Some(expected.clone()));
    assert!(
        sensor
            .ask("calibration")
            .contains("\r\ncalibration slits 5\r\n")
    );

    // Frames of one slit are flagged: the record is of a comb.
    let combined = Combined {
        shift: Pixels::default(),
        surface: Pixels::from_f32(0.5),
        used: 5,
        centres: [None; MAX_SLITS],
    };
    let mut is_flagged = |comb| {
        let frame = Measured {
            comb,
            ..at_centre(1823.5)
        };
        let line = sensor.take(Event::Frame(Ok(frame)));
        assert!(line.starts_with("d "), "{line}");
        line.contains(" s")
    };
    assert!(!is_flagged(Some(combined)));
    assert!(is_flagged(None));
    sensor.set("slits one");
    sensor.set("slits comb");

    let saved = sensor.save();
    let again = Sensor::comb_started(Stored::Newest(saved));
    assert_eq!(again.session.record(), Some(with.record()));
    assert_eq!(again.actions.apply.map(|it| it.comb), Some(expected.comb));

    sensor.upload(&own_record());
    assert_eq!(sensor.session.settings().slits, Slits::One);
    let applied = sensor.actions.apply.clone().expect("settings");
    assert_eq!(applied.comb, None);
    assert!(!sensor.ask("calibration").contains("calibration slits"));
}

#[test]
fn a_save_comes_back_after_a_power_cycle() {
    let mut sensor = Sensor::new();
    sensor.upload(&own_record());
    for line in ["stream off", "rows 7", "mean plain", "black fixed 12"] {
        sensor.set(line);
    }
    let saved = sensor.save();
    assert!(
        sensor
            .ask("calibration")
            .contains("\r\ncalibration source stored\r\n")
    );

    let again = Sensor::started(Stored::Newest(saved.clone()));
    assert_eq!(again.session.record(), Some(own_record().record()));
    let expected = Settings {
        stream: sensor.session.settings().stream,
        ..*again.session.settings()
    };
    assert_eq!(*sensor.session.settings(), expected);

    let mut older = Sensor::started(Stored::Older(saved.clone()));
    let shown = older.ask("calibration");
    assert!(
        shown.contains("\r\ncalibration fault the last save is unusable, "),
        "{shown}"
    );
    assert!(shown.ends_with("\r\ncalibration stored same"), "{shown}");

    let other = Configuration {
        record: Some(of_another_head()),
        ..saved
    };
    let mut other = Sensor::started(Stored::Newest(other));
    assert_eq!(other.session.record(), None);
    let shown = other.ask("calibration");
    assert!(shown.contains("of another sensor head"), "{shown}");
}

#[test]
fn a_save_that_fails_is_an_error_and_changes_nothing() {
    let mut sensor = Sensor::new();
    let before = sensor.ask("calibration");
    assert_eq!(sensor.ask("save"), "save pauses the stream");
    let answer = sensor.take(Event::Saved(Err(StoreError::Worn)));
    assert!(answer.starts_with("E16 not saved: "), "{answer}");
    assert_eq!(sensor.ask("calibration"), before);
}

#[test]
fn defaults_are_those_of_the_factory_and_leave_the_stream() {
    let mut sensor = Sensor::new();
    sensor.upload(&own_record());
    for line in ["stream off", "rows 7", "mean plain", "calibration off"] {
        sensor.set(line);
    }
    sensor.set("defaults");
    let expected = Settings {
        stream: false,
        ..Settings::default()
    };
    assert_eq!(sensor.actions.apply, Some(applied(expected, None)));
    assert_eq!(sensor.session.record(), Record::nominal().as_ref());
    assert!(sensor.ask("calibration").starts_with("calibration on\r\n"));
}

#[test]
fn save_replaces_a_stored_calibration_by_the_nominal_one_only_if_told_so() {
    let mut sensor = Sensor::new();
    sensor.upload(&own_record());
    let own = sensor.save();
    let refusal = sensor.ask("save nominal");
    assert!(refusal.starts_with("E18 "), "{refusal}");
    sensor.set("defaults");
    let stored = [
        Stored::Newest(own.clone()),
        Stored::Older(own.clone()),
        Stored::Newest(Configuration {
            record: Some(of_another_head()),
            ..own
        }),
    ];
    for stored in stored {
        let mut sensor = Sensor::started(stored);
        sensor.set("defaults");
        let refusal = sensor.ask("save");
        assert!(refusal.starts_with("E17 "), "{refusal}");
        assert!(!sensor.actions.save);
        assert_eq!(sensor.ask("save nominal"), "save pauses the stream");
        assert!(sensor.actions.save);
        let saved = sensor
            .session
            .configuration()
            .map(Configuration::cloned)
            .expect("the nominal one");
        assert_eq!(saved.record, None);
        assert_eq!(sensor.take(Event::Saved(Ok(()))), "save");
        // Flash now holds the nominal calibration: nothing can be lost.
        sensor.save();
    }
    let mut new = Sensor::new();
    new.set("defaults");
    new.save();
}

proptest! {
    /// Any lines in any order: each line gets one answer, and the configuration can be saved and loaded.
    #[test]
    fn any_lines_are_answered_and_leave_a_configuration_that_loads(
        lines in prop::collection::vec(
            prop_oneof![
                concat!(
                    "(rows|mean|black|estimator|region|peak|stream|calibration|defaults|help|info|status|flat)",
                    "( [a-z0-9-]{1,8}){0,2}",
                ),
                "rows [0-9]{1,2}",
                "black fixed [0-9]{1,4}",
                "region [0-9]{1,4} [0-9]{1,4}",
                "calibration (begin|data) [0-9]{1,4}",
                "[ -~]{1,70}",
            ],
            1..20,
        )
    ) {
        let mut sensor = Sensor::new();
        for line in &lines {
            let answer = sensor.ask(line);
            let is_silent = matches!(
                parse(line.as_bytes()),
                Ok(Command::Nothing | Command::Distance | Command::Centre)
            );
            prop_assert_eq!(answer.is_empty(), is_silent, "{}: {}", line, answer);
        }
        let saved = sensor.session.configuration().map(Configuration::cloned).expect("the nominal calibration at least");
        let again = Sensor::started(Stored::Newest(saved));
        prop_assert_eq!(again.session.record(), sensor.session.record());
        let restarted = Settings {
            stream: sensor.session.settings().stream,
            ..*again.session.settings()
        };
        prop_assert_eq!(restarted, *sensor.session.settings());
    }
}

/// What a map says of a sensor.
fn map_summary() -> MapSummary {
    MapSummary {
        errors: PixelErrors {
            response_q16: 34,
            offset: Counts::from_bits(66),
        },
        pattern: Counts::from_int(5),
        outside: 2,
    }
}

#[test]
fn a_map_of_the_pixels_is_taken_used_saved_and_erased() {
    let mut sensor = Sensor::new();
    assert_eq!(sensor.ask("flat"), "flat none\r\nflat stored none");
    for line in ["flat on", "flat off", "flat save"] {
        assert_eq!(sensor.ask(line), Refusal::NoMap.to_string(), "{line}");
        assert_eq!(sensor.actions.flat, None, "{line}");
    }
    let no_dark = Refusal::NotTaken(TakeError::NoDark).to_string();
    assert_eq!(sensor.ask("flat lit"), no_dark);
    assert_eq!(sensor.ask("flat dark"), "flat dark pauses the stream");
    assert_eq!(sensor.actions.flat, Some(Job::Take(Kind::Dark)));
    let taken = |counts, map| Taken {
        mean: Counts::from_int(counts),
        map,
    };
    let outcome = Outcome::Taken(Kind::Dark, Ok(taken(300, None)));
    assert_eq!(sensor.take(Event::Flat(outcome)), "flat dark 300.0 counts");
    assert!(sensor.ask("flat").contains("then flat lit"));
    // Twice, because the first answer may be lost.
    for _ in 0..2 {
        assert_eq!(sensor.ask("flat lit"), "flat lit pauses the stream");
        let outcome = Outcome::Taken(Kind::Lit, Ok(taken(2300, Some(map_summary()))));
        let answer = "flat lit 2300.0 counts response 0.052 % offset 0.26 counts outside 2";
        assert_eq!(sensor.take(Event::Flat(outcome)), answer);
        assert!(sensor.session.is_map_on());
    }
    let lines = "flat on\r\n\
         flat remaining response 0.052 % offset 0.26 counts\r\n\
         flat outside 2 pixels\r\n\
         flat stored none";
    assert_eq!(sensor.ask("flat"), lines);
    sensor.set("flat off");
    assert_eq!(sensor.actions.flat, Some(Job::Use(false)));
    assert!(!sensor.session.is_map_on());
    assert_eq!(sensor.ask("flat save"), "flat save pauses the stream");
    assert_eq!(sensor.actions.flat, Some(Job::Save));
    let failed = Event::Flat(Outcome::Saved(Err(StoreError::Worn)));
    assert!(sensor.take(failed).starts_with("E21 "));
    assert!(sensor.ask("flat").ends_with("flat stored none"));
    assert_eq!(
        sensor.take(Event::Flat(Outcome::Saved(Ok(())))),
        "flat save"
    );
    assert!(sensor.ask("flat").ends_with("flat stored same"));
    // Dark rows take the place of the map, which comes back from flash.
    let outcome = Outcome::Taken(Kind::Dark, Ok(taken(300, None)));
    sensor.take(Event::Flat(outcome));
    assert!(sensor.ask("flat").ends_with("flat stored other"));
    assert_eq!(sensor.ask("flat on"), "");
    assert_eq!(sensor.actions.flat, Some(Job::Load));
    let loaded = Outcome::Loaded(Ok(StoredMap::Newest), Some(map_summary()));
    assert_eq!(sensor.take(Event::Flat(loaded)), "flat on");
    assert_eq!(sensor.ask("flat none"), "flat none pauses the stream");
    assert_eq!(sensor.actions.flat, Some(Job::Erase));
    assert_eq!(
        sensor.take(Event::Flat(Outcome::Erased(Ok(())))),
        "flat none"
    );
    assert_eq!(sensor.ask("flat"), "flat none\r\nflat stored none");
}

#[test]
fn a_map_in_flash_is_used_from_the_start_or_its_damage_is_reported() {
    let mut sensor = Sensor::new();
    let loaded = Outcome::Loaded(Ok(StoredMap::Older), Some(map_summary()));
    assert_eq!(sensor.take(Event::Flat(loaded)), "");
    assert!(sensor.session.is_map_on());
    let answer = sensor.ask("flat");
    assert!(answer.starts_with("flat on\r\n"), "{answer}");
    assert!(answer.contains("flat fault the last save"), "{answer}");
    for loaded in [Ok(StoredMap::Unusable), Err(StoreError::Flash)] {
        sensor.take(Event::Flat(Outcome::Loaded(loaded, None)));
        assert!(!sensor.session.is_map_on());
        let answer = sensor.ask("flat");
        assert!(answer.starts_with("flat none\r\nflat fault"), "{answer}");
        assert_eq!(sensor.ask("flat on"), Refusal::NoMap.to_string());
    }
}
