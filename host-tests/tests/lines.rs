//! A long stream of wrong and right lines into the core's session, with frames in between, as the firmware's
//! serial line brings them: no reading is lost, only exact commands change a setting, and each other line has
//! its error.

use crate::session::samples::HARDWARE;
use crate::support::*;
use rand::seq::IndexedRandom as _;
use slitrange::base::units::Units;
use slitrange_device::protocol::command::{Error, MAX_LINE};
use slitrange_device::protocol::flat::Flat;
use slitrange_device::session::flat::Job;
use slitrange_device::settings::serial_line::{Format, PixelStream};
use slitrange_device::settings::{Affects, Form, Value};
use std::collections::BTreeMap;

const KINDS: [&str; 9] = [
    "random bytes",
    "random text",
    "cut off",
    "too long",
    "interleaved",
    "one byte wrong",
    "wrong value",
    "blank",
    "command",
];

/// All bytes that a line is made of, without its end.
struct Lines {
    random: ChaCha8Rng,
    /// Each command, and each setting with many of its values.
    commands: Vec<String>,
    /// The first of them, which are no settings.
    others: usize,
    names: Vec<&'static str>,
}

impl Lines {
    fn new(seed: u64) -> Self {
        let others = "help|?|help estimator|info|status|distance|centre|uncertainty|zero|zero off|row|\
                      row window|row 1700 1839|calibration|calibration on|calibration off|\
                      calibration data 0|calibration begin 600|calibration commit|calibration abort|\
                      save|save nominal|defaults|flat|flat dark|flat lit|flat save|flat on|flat off|\
                      flat erase|calibration data 0 00 1d0f|measure|errors|uptime|selftest|reset|\
                      master|master 500|master 0.5|master 4001|master -1.5 um";
        let mut commands: Vec<String> = others.split('|').map(str::to_owned).collect();
        let others = commands.len();
        for &setting in Setting::ALL {
            let name = setting.name();
            commands.push(name.to_owned());
            commands.push(Settings::default().get(setting).to_string());
            let values: Vec<String> = match setting.form().in_units(Units::Micrometres) {
                Form::Number { least, most, .. } => {
                    let number = |i: u32| (least + (most - least) / 7 * i).to_string();
                    (0..8).map(number).collect()
                }
                Form::Words(words) | Form::Lengths { um: words, .. } => {
                    words.split('|').flat_map(of_form).collect()
                }
                Form::Several(names) => {
                    let some = |i| names.split(' ').skip(i).step_by(2).collect::<Vec<_>>();
                    (0..8).map(|i| some(i).join(" ")).collect()
                }
                Form::Listed => Estimator::ALL.iter().map(|it| it.name().into()).collect(),
            };
            let lines = values.iter().map(|value| format!("{name} {value}"));
            // Lines are no commands with Modbus.
            let lines = lines.filter(|line| !line.ends_with("modbus"));
            commands.extend(lines.filter(|line| parse(line.as_bytes()).is_ok()));
        }
        Self {
            random: random(seed),
            names: Setting::ALL.iter().map(|it| it.name()).collect(),
            commands,
            others,
        }
    }

    /// As often a setting as another command.
    fn command(&mut self) -> Vec<u8> {
        let (others, settings) = self.commands.split_at(self.others);
        let commands = [settings, others][usize::from(self.random.random::<bool>())];
        let command = commands.choose(&mut self.random).expect("commands");
        command.clone().into_bytes()
    }

    fn text(&mut self, most: usize) -> Vec<u8> {
        let length = self.random.random_range(0..=most);
        let random = &mut self.random;
        let letters = (0..length).map(|_| random.random_range(b' '..=b'~'));
        letters.collect()
    }

    fn line(&mut self, kind: &str) -> Vec<u8> {
        let mut line = self.command();
        match kind {
            "random bytes" => {
                let length = self.random.random_range(0..=120);
                line = (0..length).map(|_| self.random.random()).collect();
            }
            "random text" => line = self.text(100),
            "cut off" => {
                let left = self.random.random_range(0..line.len());
                // The begin or the end is missing.
                if self.random.random() {
                    line.truncate(left);
                } else {
                    line.drain(..left);
                }
            }
            "too long" => {
                let length = self.random.random_range(MAX_LINE + 1..300);
                let fill = *b" 0x\t".choose(&mut self.random).expect("one");
                line.resize(length, fill);
            }
            "interleaved" => {
                let (first, second) = (line, self.command());
                let (mut rest, mut other) = (&first[..], &second[..]);
                line = vec![];
                while !rest.is_empty() || !other.is_empty() {
                    let count = self.random.random_range(0..=rest.len());
                    line.extend_from_slice(&rest[..count]);
                    rest = &rest[count..];
                    std::mem::swap(&mut rest, &mut other);
                }
            }
            "one byte wrong" => {
                let place = self.random.random_range(0..line.len());
                match self.random.random_range(0..4) {
                    0 => line[place] ^= 1 << self.random.random_range(0..8),
                    1 => drop(line.remove(place)),
                    2 => line.insert(place, line[place]),
                    _ => line.swap(place, (place + 1) % self.random.random_range(1..=place + 1)),
                }
            }
            "wrong value" => {
                let name = self.names.choose(&mut self.random).expect("names");
                line = name.as_bytes().to_vec();
                line.push(b' ');
                let value = match self.random.random_range(0..3) {
                    0 => self.text(12),
                    1 => self.random.random::<u32>().to_string().into_bytes(),
                    _ => format!("-{}", self.random.random::<u8>()).into_bytes(),
                };
                line.extend(value);
            }
            "blank" => {
                let length = self.random.random_range(0..MAX_LINE);
                line = vec![*b" \t".choose(&mut self.random).expect("one"); length];
            }
            _ => {
                // Blanks and upper case do not matter.
                let most = MAX_LINE - line.len();
                let before = self.random.random_range(0..=most.min(4));
                line.splice(..0, vec![b' '; before]);
                if self.random.random() {
                    line.make_ascii_uppercase();
                }
            }
        }
        line
    }
}

/// Values that a part of a form stands for: the words, with numbers in place of their ranges.
fn of_form(words: &str) -> Vec<String> {
    let at = |share: u32| -> Vec<String> {
        let number = |word: &str| {
            let (least, most) = word.split_once("..")?;
            let (least, most): (u32, u32) = (least.parse().ok()?, most.parse().ok()?);
            Some((least + (most - least) / 4 * share).to_string())
        };
        let words = words.split(' ');
        words
            .map(|it| number(it).unwrap_or(it.to_owned()))
            .collect()
    };
    (0..5).map(|share| at(share).join(" ")).collect()
}

/// Cuts bytes into lines: what [`Input`] is to do, written once more.
#[derive(Default)]
struct Reference(Vec<u8>);

impl Reference {
    /// The line that a byte ends, or an error for one that is too long.
    fn take(&mut self, byte: u8) -> Option<Result<Vec<u8>, Error>> {
        if byte == b'\r' || byte == b'\n' {
            let line = std::mem::take(&mut self.0);
            return (line.len() <= MAX_LINE).then_some(Ok(line));
        }
        // A break before a line.
        if byte == 0 && self.0.is_empty() {
            return None;
        }
        self.0.push(byte);
        (self.0.len() == MAX_LINE + 1).then_some(Err(Error::TooLong))
    }
}

/// Words in lower case, and numbers without zeros before them.
fn words(line: &str) -> Vec<String> {
    let word = |word: &str| {
        let number = word.bytes().all(|byte| byte.is_ascii_digit());
        let digits = word.trim_start_matches('0');
        match (number, digits) {
            (true, "") => "0".to_owned(),
            (true, digits) => digits.to_owned(),
            (false, _) => word.to_ascii_lowercase(),
        }
    };
    let words = line.split([' ', '\t']).filter(|it| !it.is_empty());
    words.map(word).collect()
}

/// Writes lengths in tenths of a micrometre, in place of those in the unit that the words end with, or in
/// `units`.
fn in_tenths(words: &mut Vec<String>, units: Units) {
    let tenths = match (words.last().map(String::as_str), units) {
        (Some("um"), _) => 10.0,
        (Some("mm"), _) | (_, Units::Millimetres) => 10_000.0,
        (_, Units::Micrometres) => 10.0,
    };
    words.retain(|word| word != "um" && word != "mm");
    for word in words {
        if let Ok(length) = word.parse::<f64>() {
            *word = ((length * tenths).round() as i64).to_string();
        }
    }
}

/// Whether a line is a command word by word, and not only understood as one.
fn is_exactly(line: &[u8], command: Command, units: Units) -> bool {
    let mut found = words(&String::from_utf8_lossy(line));
    let mut exact = words(&command.to_string());
    match command {
        Command::Help if found == ["?"] => return true,
        // The columns have an order of their own.
        Command::Set(Value::Output(_)) => {
            for words in [&mut found, &mut exact] {
                words.sort();
                words.dedup();
            }
        }
        // A checksum, and not a number.
        Command::Upload(Step::Piece(_)) => return true,
        Command::Master(_)
        | Command::Set(Value::Limits(_) | Value::SpikeFilter(_) | Value::Surface(_)) => {
            for words in [&mut found, &mut exact] {
                in_tenths(words, units);
            }
        }
        _ => {}
    }
    found == exact
}

/// The firmware without hardware.
struct Sensor {
    session: Session,
    actions: Actions,
    vitals: Vitals,
    input: Input,
    reference: Reference,
    /// The settings as they must be.
    settings: Settings,
    /// A command waits for the next frame.
    is_asked: bool,
    /// `zero` waits for the next frame, unless `zero off` comes first.
    is_zero_asked: bool,
    counts: BTreeMap<&'static str, u64>,
}

/// A line without its checksum, if it ends with one.
fn checked(line: &[u8]) -> Result<&[u8], Error> {
    let place = line.len().saturating_sub(3);
    let sum = line[place..]
        .strip_prefix(b"*")
        .filter(|it| it.len() == 2 && it[0] != b'+');
    let sum = sum.and_then(|it| str::from_utf8(it).ok());
    let Some(written) = sum.and_then(|it| u32::from_str_radix(it, 16).ok()) else {
        return Ok(line);
    };
    let computed = line[..place]
        .iter()
        .copied()
        .fold(0, core::ops::BitXor::bitxor)
        .into();
    match written == computed {
        true => Ok(&line[..place]),
        false => Err(Error::LineChecksum { written, computed }),
    }
}

impl Sensor {
    fn new() -> Self {
        let mut sensor = Self {
            session: Session::new(HARDWARE, tcd1304dg(), StartCause::PowerOn),
            actions: Actions::default(),
            vitals: Vitals::default(),
            input: Input::new(),
            reference: Reference::default(),
            settings: Settings::default(),
            is_asked: false,
            is_zero_asked: false,
            counts: BTreeMap::new(),
        };
        sensor.session.start(&Stored::Nothing, &mut sensor.actions);
        sensor
    }

    fn count(&mut self, what: &'static str) {
        *self.counts.entry(what).or_insert(0) += 1;
    }

    fn event(&mut self, event: Event) -> &str {
        self.session.take(event, &self.vitals, &mut self.actions);
        self.actions.text.as_str()
    }

    fn byte(&mut self, byte: u8, random: &mut ChaCha8Rng) {
        // Lines with an address have tests of their own.
        if byte == b'@' && self.reference.0.is_empty() {
            return;
        }
        let units = self.settings.units;
        self.input.set_units(units);
        let taken = self.input.take(byte);
        let line = self.reference.take(byte);
        let expected = (line.as_ref()).map(|line| match line {
            Ok(line) => checked(line).and_then(|line| parse_in(units, line)),
            Err(error) => Err(*error),
        });
        assert_eq!(taken, expected, "{line:?}");
        let (Some(taken), Some(line)) = (taken, line) else {
            return;
        };
        let line = line.unwrap_or_default();
        let shown = line.escape_ascii();
        let answer = self.event(Event::Line(taken)).to_owned();
        assert!(!self.actions.may_drop, "{shown}");
        let is_error = answer.starts_with('E')
            && answer[1..].starts_with(|first: char| first.is_ascii_digit())
            && answer.find("\r\n") == Some(answer.len() - 2);
        let command = match taken {
            Err(_) => {
                assert!(is_error, "{shown}: {answer:?}");
                self.count("errors");
                assert_eq!(self.session.settings(), &self.settings, "{shown}");
                return;
            }
            Ok(Command::Nothing) => {
                assert!(words(&String::from_utf8_lossy(&line)).is_empty(), "{shown}");
                assert_eq!(answer, "", "{shown}");
                self.count("blank lines");
                assert_eq!(self.session.settings(), &self.settings, "{shown}");
                return;
            }
            Ok(command) => command,
        };
        assert!(
            is_exactly(&line, command, units),
            "{shown} is taken for {command}"
        );
        self.count(["commands", "refused commands"][usize::from(is_error)]);
        match command {
            // The next frame answers, or something else than text.
            Command::Distance | Command::Centre | Command::Uncertainty => self.is_asked = true,
            Command::Zero(is_asked) => self.is_zero_asked = is_asked,
            Command::Master(Some(_)) if !is_error => self.is_zero_asked = true,
            Command::Row(_) | Command::Selftest | Command::Flat(Flat::Use(true)) => {}
            _ => assert!(answer.ends_with("\r\n"), "{shown}: {answer:?}"),
        }
        match command {
            Command::Set(value) if !is_error => self.settings.set(value),
            Command::Defaults => {
                for &setting in Setting::ALL {
                    if matches!(setting.affects(), Affects::Measurement | Affects::Lines) {
                        self.settings.set(Settings::default().get(setting));
                    }
                }
            }
            // These never succeed: no record comes whole.
            Command::Upload(Step::Commit) => assert!(is_error, "{shown}: {answer}"),
            _ => {}
        }
        assert_eq!(self.session.settings(), &self.settings, "{shown}");
        self.carry_out(random);
        assert_eq!(self.session.settings(), &self.settings, "{shown}");
        // What is typed would be edited, and not taken as it is. With an address or a trigger, frames have no
        // lines unasked.
        let default = Settings::default();
        for setting in [Setting::Echo, Setting::Address, Setting::Trigger] {
            let value = default.get(setting);
            if self.settings.get(setting) != value {
                self.settings.set(value);
                self.event(Event::Line(Ok(Command::Set(value))));
            }
        }
    }

    /// Reports what the actions ask for. Flash fails now and then.
    fn carry_out(&mut self, random: &mut ChaCha8Rng) {
        let saved = match random.random_range(0..4) {
            0 => Err(StoreError::Flash),
            _ => Ok(()),
        };
        if self.actions.save {
            let answer = self.event(Event::Saved(saved)).to_owned();
            assert!(answer.ends_with("\r\n"), "{answer:?}");
        }
        if self.actions.test {
            let answer = self.event(Event::Tested(None)).to_owned();
            assert!(answer.ends_with("\r\n"), "{answer:?}");
        }
        let outcome = match self.actions.flat.take() {
            Some(Job::Load) => Outcome::Loaded(Ok(StoredMap::Nothing), None),
            Some(Job::Take(kind)) => Outcome::Taken(kind, Err(TakeError::Silent)),
            Some(Job::Save) => Outcome::Saved(saved),
            Some(Job::Erase) => Outcome::Erased(saved),
            Some(Job::Use(_)) | None => return,
        };
        let answer = self.event(Event::Flat(outcome)).to_owned();
        assert!(answer.ends_with("\r\n"), "{answer:?}");
    }

    /// Settings that leave each frame its line, whatever they are. Others may thin the stream.
    fn leaves_each_line(&self) -> bool {
        let default = Settings::default();
        let mut settings = self.settings;
        for &setting in Setting::ALL {
            use Setting::{Average, Baud, Bits, Format, Output, Pixels, Plain, Stream, Units};
            let any = [
                Stream, Format, Pixels, Units, Output, Average, Baud, Bits, Plain,
            ];
            if any.contains(&setting) || setting.affects() == Affects::Measurement {
                settings.set(default.get(setting));
            }
        }
        settings == default
    }

    /// Takes a frame, and asserts that its result has its line or its packet.
    fn frame(&mut self, random: &mut ChaCha8Rng) {
        self.vitals.results += 1;
        self.vitals.result_us += 5700;
        // Sixteenths have four decimals, as lines have.
        let centre = f64::from(random.random_range(19_200..38_400)) / 16.0;
        let result = match random.random_range(0..8) {
            0 => Err(Fault::LaserOff),
            _ => Ok(at_centre(centre)),
        };
        let text = self.event(Event::Frame(result)).to_owned();
        let [asked, zero_asked] = [&mut self.is_asked, &mut self.is_zero_asked].map(std::mem::take);
        let packet = self.actions.result.map(|packet| packet.counter);
        self.count("frames");
        let (stream, format) = (self.settings.stream, self.settings.connection().format);
        if asked || zero_asked {
            // An answer, which must arrive. It has the reading.
            assert!(!self.actions.may_drop && text.ends_with("\r\n"), "{text:?}");
            self.count("frames that answered");
        } else if !stream || (format, self.settings.pixels) == (Format::Binary, PixelStream::Rows) {
            assert!(text.is_empty() && packet.is_none(), "{text:?}");
            self.count("frames without a stream");
        } else if !self.leaves_each_line() {
            self.count("frames of a thinned stream");
        } else if format == Format::Binary {
            assert_eq!((text.as_str(), packet), ("", Some(self.vitals.results)));
            self.count("packets");
        } else {
            assert!(self.actions.may_drop && packet.is_none(), "{text:?}");
            // Every hundredth line of comma-separated values has one before that names the columns.
            let is_headed = format == Format::Csv && text.contains("fault\r\n");
            assert_eq!(
                text.matches("\r\n").count(),
                1 + usize::from(is_headed),
                "{text:?}"
            );
            assert!(text.ends_with("\r\n"), "{text:?}");
            self.count("lines of readings and faults");
            let default = Settings::default();
            let is_of_frame =
                (self.settings.output, self.settings.average) == (default.output, default.average);
            if format == Format::Text && is_of_frame {
                // The reading is that of this frame.
                let shown = match result {
                    Ok(_) => format!(" x {centre:.4}"),
                    Err(_) => "f laser off".to_owned(),
                };
                assert!(text.contains(&shown), "{shown}: {text}");
                self.count("of them with the frame's own centre");
            }
        }
        assert_eq!(self.session.settings(), &self.settings);
    }
}

fn send(seed: u64, count: u64) {
    let mut lines = Lines::new(seed);
    let mut random = random(seed + 1);
    let mut sensor = Sensor::new();
    let mut kinds = BTreeMap::new();
    let mut next_frame = 0;
    for number in 0..count {
        let kind = KINDS.choose(&mut random).expect("kinds");
        *kinds.entry(kind).or_insert(0) += 1;
        let mut line = lines.line(kind);
        let end = ["\r", "\n", "\r\n"][random.random_range(0..3)];
        line.extend_from_slice(end.as_bytes());
        // Every hundred lines, the settings are those of a start again.
        if number % 100 == 99 {
            line.extend(b"calibration on\nzero off\n");
            for &setting in Setting::ALL {
                line.extend(format!("{}\n", Settings::default().get(setting)).bytes());
            }
        }
        for byte in line {
            sensor.byte(byte, &mut random);
            // Frames end within lines too.
            if next_frame == 0 {
                sensor.frame(&mut random);
                next_frame = random.random_range(1..120);
            }
            next_frame -= 1;
        }
    }
    println!("{count} lines: {kinds:?}");
    println!("{:#?}", sensor.counts);
    let of = |what| sensor.counts.get(what).copied().unwrap_or_default();
    // Six of nine kinds are hardly ever a command, and one is always one.
    assert!(of("errors") > count / 2, "{:#?}", sensor.counts);
    assert!(of("commands") > count / 20, "{:#?}", sensor.counts);
    assert!(of("blank lines") > count / 20, "{:#?}", sensor.counts);
    let own = "of them with the frame's own centre";
    for what in ["frames that answered", "packets", "refused commands", own] {
        assert!(of(what) > count / 1000, "{what}: {:#?}", sensor.counts);
    }
}

#[test]
fn ten_thousand_lines_lose_no_reading_and_change_no_setting_unasked() {
    send(41_000, 10_000);
}

#[test]
#[ignore = "12 s; .ci/run runs it"]
fn a_million_lines_lose_no_reading_and_change_no_setting_unasked() {
    send(42_000, 1_000_000);
}
