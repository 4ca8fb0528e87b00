//! Every command, fault and start of a sensor, through the session, without hardware and without an emulator.
//!
//! Each script, `session/NAME.snap`, is what happens to a sensor that has just started:
//!
//! | line | what it is |
//! |---|---|
//! | `# three agree` | the reason for what follows |
//! | `> rows 7` | a line that comes in |
//! | `* frame 1800` | another event: see [`Sensor::event`] |
//! | `< rows 7` | an answer, which must arrive |
//! | `< ...` | a long answer like the one before, without its `-` and with its `+` lines |
//! | `~ d 788.8397 mm ...` | a line that may be dropped |
//! | `! apply` | what else the owner of the session must do |
//! | `= limits` | what holds from now on: see [`Sensor::note`] |
//!
//! The test takes lines of the first three kinds from the script, and compares the others. To change a
//! script, edit those three, run the test with `INSTA_UPDATE=always`, and read what else has changed.

use crate::support::*;
use samples::{HARDWARE, fault, frame, map_summary, record, row_test};
use slitrange::base::units::Units;
use slitrange::row::pixels::flat_field::Kind;
use slitrange_device::protocol::MAX_ANSWER;
use slitrange_device::protocol::help;
use slitrange_device::protocol::info::VERSION;
use slitrange_device::protocol::line::FaultLine;
use slitrange_device::protocol::piece::{PIECE, Piece};
use slitrange_device::session::Applied;
use slitrange_device::settings::{Form, split_words};
use slitrange_device::store::configuration;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;

pub mod samples;

struct Sensor {
    session: Session,
    actions: Actions,
    saved: Option<Configuration>,
    /// The geometry that the driver assumes.
    head: Geometry,
    /// What holds since the latest note of it.
    held: String,
    /// The latest long answers by their first words.
    answers: BTreeMap<String, Vec<String>>,
    log: String,
}

impl Sensor {
    fn new() -> Self {
        Self::started(tcd1304dg(), StartCause::PowerOn, Stored::Nothing)
    }

    fn started(geometry: Geometry, cause: StartCause, stored: Stored) -> Self {
        let mut sensor = Self {
            session: Session::new(HARDWARE, geometry.clone(), cause),
            actions: Actions::default(),
            saved: None,
            head: geometry,
            held: String::new(),
            answers: BTreeMap::new(),
            log: String::new(),
        };
        sensor.session.start(&stored, &mut sensor.actions);
        sensor.note();
        sensor
    }

    fn take(&mut self, event: Event) {
        self.session.take(event, &vitals(), &mut self.actions);
        self.note();
    }

    /// Notes what an event brought, and what holds since: the output of `limits` is on, rows are corrected
    /// with the map, rows or windows are sent, results are packets, the line speaks Modbus.
    fn note(&mut self) {
        let Actions {
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
        } = &self.actions;
        let text = text.as_str();
        let is_of_lines = text.is_empty() || text.ends_with("\r\n");
        assert!(text.is_ascii() && is_of_lines, "{text:?}");
        let text = text.replace(VERSION, "VERSION");
        let lines: Vec<String> = text.lines().map(str::to_owned).collect();
        // The longest number has twenty digits.
        let digits = if text.starts_with("status ") { 20 } else { 0 };
        assert!(text.len() + digits * lines.len() <= MAX_ANSWER, "{text}");
        let is_wide = lines.iter().any(|line| line.len() > 110);
        let is_list = text.starts_with("info ") || text.starts_with("calibration ");
        assert!(!is_list || !is_wide, "{text}");
        let is_long = lines.len() > 5;
        let before = is_long.then(|| {
            let name = text.split(' ').next().expect("a word").to_owned();
            self.answers.insert(name, lines.clone())
        });
        let mark = if *may_drop { '~' } else { '<' };
        match before.flatten() {
            Some(before) => {
                self.log += "< ...\n";
                for line in before.iter().filter(|line| !lines.contains(line)) {
                    self.log += &format!("- {line}\n");
                }
                for line in lines.iter().filter(|line| !before.contains(line)) {
                    self.log += &format!("+ {line}\n");
                }
            }
            None => {
                for line in lines {
                    self.log += format!("{mark} {line}").trim_end();
                    self.log += "\n";
                }
            }
        }
        let session = &self.session;
        let record = session.record();
        let front_end = record.and_then(|record| record.front_end.as_ref());
        let applied = |it: &Applied| {
            assert_eq!(it.settings, *session.settings());
            let measured = front_end.map(|it| it.geometry(&self.head));
            assert_eq!(it.geometry, measured.clone().unwrap_or(self.head.clone()));
            assert_eq!(it.geometry, session.geometry());
            let mut text = "apply".to_owned();
            if let Some(measured) = measured {
                let noise = measured.shot_variance_per_count_q16;
                text += &format!(", {:?} {noise} {}", measured.polarity, measured.saturation);
            }
            if it.profile.is_some() {
                assert_eq!(it.profile, record.and_then(|record| record.profile));
                text += ", own spot";
            }
            if let Some(comb) = &it.comb {
                assert_eq!(Some(comb), record.and_then(|record| record.comb.as_ref()));
                text += &format!(", {} slits", comb.slits().len());
            }
            text
        };
        let asked = [
            (*address != 0).then(|| format!("@{address}")),
            result.map(packet),
            apply.as_ref().map(applied),
            save.then(|| "save".to_owned()),
            row.map(|part| Command::Row(part).to_string()),
            flat.map(|job| format!("{job:?}")),
            test.then(|| "test".to_owned()),
            trigger.then(|| "trigger".to_owned()),
            reset.then(|| "reset".to_owned()),
        ];
        for action in asked.iter().flatten() {
            self.log += &format!("! {action}\n");
        }
        let holds = [
            (session.is_within_limits(), "limits"),
            (session.is_map_on(), "map"),
            (session.streams_rows(), "rows"),
            (session.streams_windows(), "windows"),
            (session.sends_packets(), "packets"),
            (session.speaks_modbus(), "modbus"),
        ];
        let holds = holds.map(|(holds, name)| holds.then_some(name));
        let holds = holds.into_iter().flatten().collect::<Vec<_>>().join(" ");
        if holds != self.held {
            let shown = if holds.is_empty() { "nothing" } else { &holds };
            self.log += &format!("= {shown}\n");
            self.held = holds;
        }
    }

    /// The answer to a line. A command is written as it is read, is the setting's value from then on, or
    /// is refused and changes nothing.
    fn ask(&mut self, line: &str) -> String {
        let command = parse_in(self.session.settings().units, line.as_bytes());
        let before = *self.session.settings();
        self.take(Event::Line(command));
        let answer = self.actions.text.as_str();
        assert!(!self.actions.may_drop, "an answer must arrive: {line}");
        if answer.starts_with('E') {
            assert_eq!(*self.session.settings(), before, "{line}");
            assert!(self.actions.apply.is_none() && !self.actions.save, "{line}");
        } else if let Ok(Command::Set(value)) = command {
            assert_eq!(self.session.settings().get(value.setting()), value);
        }
        if let Ok(command) = command {
            assert_eq!(parse(command.to_string().as_bytes()), Ok(command));
        }
        answer.to_owned()
    }

    /// Sends a record as `slitrange calibrate write` does, and reads it back.
    fn upload(&mut self, record: &EncodedRecord) {
        let (bytes, log) = (record.bytes(), self.log.clone());
        self.ask(&format!("calibration begin {}", bytes.len()));
        for offset in (0..bytes.len()).step_by(PIECE) {
            let piece = Piece::of(bytes, offset as u16).expect("a piece");
            let line = Command::Upload(Step::Piece(piece)).to_string();
            assert_eq!(self.ask(&line), line + "\r\n");
        }
        self.log = log;
        if self.ask("calibration commit").starts_with('E') {
            return;
        }
        let (mut read, log) = (vec![], self.log.clone());
        while read.len() < bytes.len() {
            let line = self.ask(&format!("calibration data {}", read.len()));
            match parse(line.trim_end().as_bytes()) {
                Ok(Command::Upload(Step::Piece(piece))) => read.extend_from_slice(piece.bytes()),
                other => panic!("{line}: {other:?}"),
            }
        }
        assert_eq!(read, bytes);
        assert_eq!(self.session.record(), Some(record.record()));
        self.log = log;
    }

    /// Starts again: with what else is in flash, with another head, or for another reason.
    fn start(&mut self, words: &[&str]) {
        let saved = || self.saved.clone().expect("a save");
        let (mut geometry, mut stored) = (tcd1304dg(), Stored::Nothing);
        let mut cause = StartCause::PowerOn;
        match words {
            [] => {}
            ["supply", "dip"] => cause = StartCause::SupplyDip,
            ["reset", "pin"] => cause = StartCause::ResetPin,
            ["software"] => cause = StartCause::Software,
            ["watchdog"] => cause = StartCause::Watchdog,
            ["rising"] => geometry.polarity = Polarity::Rising,
            ["newest"] => stored = Stored::Newest(saved()),
            ["older"] => stored = Stored::Older(saved()),
            ["another", "head"] => {
                let mut saved = saved();
                saved.record.as_mut().expect("a record").geometry.light.end -= 1;
                stored = Stored::Newest(saved);
            }
            ["unusable"] => stored = Stored::Unusable,
            ["later", version] => stored = Stored::Later(version.parse().expect("a version")),
            other => panic!("no contents of flash: {other:?}"),
        }
        let mut started = Self::started(geometry, cause, stored);
        if let ["newest" | "older"] = words {
            let record = saved().record.or_else(Record::nominal);
            assert_eq!(started.session.record(), record.as_ref());
        }
        started.log.insert_str(0, &self.log);
        started.saved = self.saved.take();
        started.answers = std::mem::take(&mut self.answers);
        *self = started;
    }

    /// Answers a Modbus request without its checksum, in bytes.
    fn modbus(&mut self, words: &[&str]) {
        let body = words.iter().map(|it| it.parse().expect("a byte"));
        let body: Vec<u8> = body.collect();
        let crc = crc::Crc::<u16>::new(&crc::CRC_16_MODBUS);
        let request = [&body[..], &crc.checksum(&body).to_le_bytes()].concat();
        let before = *self.session.settings();
        let answer = (self.session).answer_modbus(&request, &vitals(), &mut self.actions);
        if let Some((body, sum)) = answer.bytes.split_last_chunk() {
            assert_eq!(crc.checksum(body), u16::from_le_bytes(*sum));
            let bytes: Vec<String> = body.iter().map(u8::to_string).collect();
            self.log += &format!("< {}\n", bytes.join(" "));
            let is_refused = body[1] & 0x80 != 0;
            assert!(!is_refused || *self.session.settings() == before && !self.actions.save);
        }
        self.note();
    }

    fn event(&mut self, words: &[&str]) {
        let outcome = match *words {
            ["dark" | "lit", counts] => {
                let lit = words[0] == "lit";
                let mean = Counts::from_int(counts.parse().expect("counts"));
                let (kind, map) = match lit {
                    true => (Kind::Lit, Some(map_summary())),
                    false => (Kind::Dark, None),
                };
                Outcome::Taken(kind, Ok(Taken { mean, map }))
            }
            ["loaded", "newest"] => Outcome::Loaded(Ok(StoredMap::Newest), Some(map_summary())),
            ["loaded", "older"] => Outcome::Loaded(Ok(StoredMap::Older), Some(map_summary())),
            ["loaded", "unusable"] => Outcome::Loaded(Ok(StoredMap::Unusable), None),
            ["loaded", "later"] => Outcome::Loaded(Ok(StoredMap::Later(2)), None),
            ["loaded", "nothing"] => Outcome::Loaded(Err(StoreError::Flash), None),
            ["map", "saved"] => Outcome::Saved(Ok(())),
            ["map", "worn"] => Outcome::Saved(Err(StoreError::Worn)),
            ["map", "erased"] => Outcome::Erased(Ok(())),
            ["map", "stays"] => Outcome::Erased(Err(StoreError::Worn)),
            ["start", ref stored @ ..] => return self.start(stored),
            ["upload", ref parts @ ..] => return self.upload(&record(parts)),
            ["modbus", ref bytes @ ..] => return self.modbus(bytes),
            ["for", "all", ref line @ ..] => {
                let units = self.session.settings().units;
                let event = Event::LineForAll(parse_in(units, line.join(" ").as_bytes()));
                return self.take(event);
            }
            ["frame", ref parts @ ..] => return self.take(Event::Frame(Ok(frame(parts)))),
            ["fault", ref name @ ..] => return self.take(Event::Frame(Err(fault(name)))),
            ["saved"] => {
                self.saved = self.session.configuration().map(through_flash);
                return self.take(Event::Saved(Ok(())));
            }
            ["worn"] => return self.take(Event::Saved(Err(StoreError::Worn))),
            ["tested", ref parts @ ..] => return self.take(Event::Tested(row_test(parts))),
            ref other => panic!("no event: {other:?}"),
        };
        self.take(Event::Flat(outcome));
    }

    fn replay(&mut self, line: &str) {
        let (kind, rest) = line.split_at_checked(2).unwrap_or((line, ""));
        if matches!(kind, "" | "# " | "> " | "* ") {
            self.log += &format!("{line}\n");
        }
        match kind {
            "> " => drop(self.ask(rest)),
            "* " => {
                let (times, event) = rest.split_once(" times ").unwrap_or(("1", rest));
                let log = self.log.clone();
                for _ in 0..times.parse().expect("a number") {
                    // Only the last one is noted.
                    self.log.clone_from(&log);
                    self.event(&event.split(' ').collect::<Vec<_>>());
                }
            }
            _ => {}
        }
    }
}

fn through_flash(configuration: Configuration<&Record>) -> Configuration {
    let mut buffer = [0; configuration::MAX_ENCODED];
    let bytes = configuration::encode(&configuration, &mut buffer).expect("room");
    configuration::decode(bytes).expect("a configuration")
}

fn packet(packet: FrameResult) -> String {
    let what = ["packet", "difference"][usize::from(packet.is_difference)];
    let result = match packet.result {
        Ok(reading) => ReadingLine(&reading).to_string(),
        Err(fault) => FaultLine(&fault, Region::ALL).to_string(),
    };
    format!("{what} {} {} {result}", packet.counter, packet.time_us)
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

fn scripts() -> Vec<(String, String)> {
    let files = fs::read_dir("tests/session").expect("scripts");
    let paths = files.map(|file| file.expect("a file").path());
    let scripts = paths.filter(|path| path.extension().is_some_and(|it| it == "snap"));
    let script = |path: std::path::PathBuf| {
        let text = fs::read_to_string(&path).expect("a script");
        let name = path.file_stem().expect("a name").to_string_lossy();
        // The lines of insta come before.
        let script = text.splitn(3, "---\n").nth(2).expect("a script");
        (name.into_owned(), script.to_owned())
    };
    scripts.map(script).collect()
}

/// Every command of `help` is in a script, and every error. A refusal says what to do.
#[test]
fn each_script_goes_as_it_is_written() {
    let (mut names, mut errors) = (BTreeSet::new(), BTreeSet::new());
    for (name, script) in scripts() {
        println!("{name}");
        let mut sensor = Sensor::new();
        sensor.log.clear();
        script.lines().for_each(|line| sensor.replay(line));
        for line in sensor.log.lines() {
            let first = line.get(2..).and_then(|rest| rest.split(' ').next());
            let first = first.filter(|_| line.starts_with("> "));
            names.extend(help::names().filter(|&name| first == Some(name)));
            let error = line.strip_prefix("< E");
            let error = error.and_then(|rest| rest.split(' ').next());
            if let Some(Ok(number)) = error.map(str::parse::<u32>) {
                assert!(number < 8 || line.contains([':', ',']), "{line}");
                errors.insert(number);
            }
        }
        insta::with_settings!({
            snapshot_path => "session",
            prepend_module_to_snapshot => false,
            omit_expression => true,
        }, {
            insta::assert_snapshot!(name, sensor.log);
        });
    }
    assert_eq!(names, help::names().collect());
    assert_eq!(errors, (1..=24).collect());
}

/// Each value that a script sets comes back from flash, unless it is of the session. The form of its setting
/// names its first word. Scripts set more than one value of each setting.
#[test]
fn values_are_named_by_their_forms_and_come_back_from_flash() {
    let mut seen = BTreeMap::<_, BTreeSet<_>>::new();
    for (_, script) in scripts() {
        for line in script.lines().filter_map(|line| line.strip_prefix("> ")) {
            let Ok(Command::Set(value)) = parse(line.as_bytes()) else {
                continue;
            };
            let (settings, record) = (with(Settings::default(), |it| it.set(value)), None);
            let read = through_flash(Configuration { settings, record }).settings;
            let expected = match value.is_saved() {
                true => settings,
                false => Settings::default(),
            };
            assert_eq!(read, expected, "{line}");
            let name = value.setting().name();
            let form = value.setting().form().in_units(Units::Millimetres);
            let value = value.to_string();
            let word = split_words(&value[name.len()..])[0];
            let is_number = word.parse::<f64>().is_ok();
            let is_named = |known: &str| {
                known.split(' ').next() == Some(word)
                    || is_number && (known.contains("..") || known.starts_with("LOW "))
            };
            if let Form::Words(words) = form {
                assert!(words.split('|').any(is_named), "{line}");
            }
            seen.entry(name).or_default().insert(value);
        }
    }
    assert_eq!(seen.len(), Setting::ALL.len());
    assert!(seen.values().all(|values| values.len() > 1), "{seen:?}");
}

#[test]
fn each_setting_of_the_factory_is_shown() {
    let mut sensor = Sensor::new();
    for &setting in Setting::ALL {
        let default = Settings::default().get(setting);
        assert_eq!(sensor.ask(setting.name()), format!("{default}\r\n"));
        assert_eq!(sensor.actions.apply, None, "{setting:?}");
    }
}

/// A line that is not due is left out. The filter sees its reading, and an answer comes at once.
#[test]
fn lines_are_left_out_down_to_the_rate_that_is_set() {
    let mut sensor = Sensor::new();
    let mut us = 12_345_678;
    let mut next = |sensor: &mut Sensor| {
        // A frame of 16 rows.
        us += 91_200;
        let vitals = with(vitals(), |it| it.result_us = us);
        let frame = Event::Frame(Ok(frame(&["1800"])));
        sensor.session.take(frame, &vitals, &mut sensor.actions);
        !sensor.actions.text.as_str().is_empty()
    };
    for (rate, expected) in [(0, 1000), (1, 91), (5, 456), (1000, 1000)] {
        sensor.ask(&format!("rate {rate}"));
        next(&mut sensor);
        let sent = (0..1000).filter(|_| next(&mut sensor)).count();
        println!("rate {rate}: {sent} lines in 91.2 s");
        assert!(sent.abs_diff(expected) <= 1, "{rate}: {sent}");
    }
    sensor.ask("rate 1");
    while !next(&mut sensor) {}
    sensor.ask("distance");
    assert!(next(&mut sensor) && !sensor.actions.may_drop);
    assert!(!next(&mut sensor));
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
            use Command::{Centre, Distance, Nothing};
            let is_silent = matches!(parse(line.as_bytes()), Ok(Nothing | Distance | Centre));
            prop_assert_eq!(answer.is_empty(), is_silent, "{}: {}", line, answer);
        }
        let saved = sensor.session.configuration().map(Configuration::cloned);
        let saved = saved.expect("the nominal calibration at least");
        let again = Sensor::started(tcd1304dg(), StartCause::PowerOn, Stored::Newest(saved));
        prop_assert_eq!(again.session.record(), sensor.session.record());
        let settings = *sensor.session.settings();
        let restarted = with(*again.session.settings(), |it| it.stream = settings.stream);
        prop_assert_eq!(restarted, settings);
    }
}
