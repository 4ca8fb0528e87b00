//! All that a person can set. Each setting is declared once, in [the list](#the-list) below.
//!
//! The struct [`Settings`], the commands that show and set a value, their answers, `help`, the error
//! messages, what flash holds and the table in docs/serial-line.md follow from the declaration. To add a
//! setting, add its lines to the list. A value of a new type also implements [`ValueText`]. A setting by
//! which the core measures also needs a field in [`slitrange::Options`], and a line in [`Settings::options`].
//!
//! miniconf and serial-settings declare settings once too. Their lines are JSON paths (`/rows 16`), and they
//! know no ranges, units or help, so they would not make this file smaller.

pub mod columns;
pub mod lengths;
pub mod serial_line;
pub mod trigger;
mod value_texts;

use core::fmt;

use heapless::Vec;

use crate::filters::average::Average;
use crate::filters::{Limits, SpikeFilter};
use crate::settings::columns::Columns;
use crate::settings::serial_line::{Baud, Bits, Connection, Format, PixelStream};
use crate::settings::trigger::Trigger;
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::base::units::Units;
use slitrange::frame::comb::Slits;
use slitrange::frame::{MAX_ROWS, Mean};
use slitrange::light::ambient::AmbientMode;
use slitrange::spot::choice::SpotChoice;
use slitrange::spot::region::Region;
use slitrange::{BlackLevel, Estimator, Options, Surface};

/// # The list
///
/// For each setting: its help, a name for Rust, the name that a person types, the field, its type and
/// default; then how its value is typed, and what a change affects.
macro_rules! list {
    ($declare:ident) => {
        $declare! {
            /// a line for every frame
            Stream "stream" stream: bool = true, Form::Words("on|off"), Affects::Session;

            /// how the sensor writes what it sends; commands stay lines, but for modbus
            Format "format" format: Format = Format::Text,
                Form::Words("text|csv|binary|modbus"), Affects::Connection;

            /// bits a second; the answer is at the old rate
            Baud "baud" baud: Baud = Baud::B115200,
                Form::Words("9600|19200|115200|230400|460800|921600"), Affects::Connection;

            /// data bits, parity and stop bits of a character
            Bits "bits" bits: Bits = Bits::N1, Form::Words("8n1|8e1|8n2"), Affects::Connection;

            /// until the next start, text at 115200 8n1 without the address
            Plain "plain" plain: bool = false, Form::Words("on|off"), Affects::Session;

            /// with `format binary`, the pixels sent too: the spot's, or whole rows
            Pixels "pixels" pixels: PixelStream = PixelStream::None,
                Form::Words("none|window|rows"), Affects::Session;

            /// this sensor's number on a line with others; 0 if it is alone
            Address "address" address: u16 = 0,
                Form::Number { least: 0, most: 247, unit: "" }, Affects::Connection;

            /// show what is typed, and let it be corrected; readings wait
            Echo "echo" echo: bool = false, Form::Words("on|off"), Affects::Session;

            /// what starts a frame: the end of the last one, `measure`, or an edge too
            Trigger "trigger" trigger: Trigger = Trigger::Continuous,
                Form::Words("continuous|serial|pin"), Affects::Measurement;

            /// rows in a frame
            Rows "rows" rows: u16 = 16,
                Form::Number { least: 1, most: MAX_ROWS, unit: "" }, Affects::Measurement;

            /// how the rows' centres are averaged
            Mean "mean" mean: Mean = Mean::Weighted, Form::Words("plain|weighted"), Affects::Measurement;

            /// for how long the laser is on in a row, in us
            Exposure "exposure" exposure: ExposureMode = ExposureMode::Auto,
                Form::Words("auto|10..5600"), Affects::Measurement;

            /// the longest exposure, whatever `exposure` says
            ExposureLimit "exposure limit" exposure_limit: Exposure = Exposure::LONGEST,
                Form::Number {
                    least: Exposure::SHORTEST.us() as u32,
                    most: Exposure::LONGEST.us() as u32,
                    unit: "us",
                },
                Affects::Measurement;

            /// whether the laser may be on
            Laser "laser" laser: bool = true, Form::Words("on|off"), Affects::Measurement;

            /// what is done about ambient light
            Ambient "ambient" ambient: AmbientMode = AmbientMode::Off,
                Form::Words("subtract|off"), Affects::Measurement;

            /// how the black level is found
            Black "black" black_level: BlackLevel = BlackLevel::Shielded,
                Form::Words("fixed 0..4095|shielded|frame"), Affects::Measurement;

            /// how the centre of a row is found
            Estimator "estimator" estimator: Estimator = Estimator::Adaptive,
                Form::Listed, Affects::Measurement;

            /// what is before the sensor
            Slits "slits" slits: Slits = Slits::One, Form::Words("one|comb"), Affects::Measurement;

            /// the pixels in which the spot is searched, with one slit
            Region "region" region: Region = Region::ALL,
                Form::Words("all|0..4095 0..4095"), Affects::Measurement;

            /// which of several spots is measured, with one slit
            SpotChoice "peak" peak: SpotChoice = SpotChoice::Strongest,
                Form::Words("strongest|first|last"), Affects::Measurement;

            /// how far speckle moves a distance
            Surface "surface" surface: Surface = Surface::Auto,
                Form::Lengths { mm: "auto|off|0..50 mm", um: "auto|off|0..50000 um" },
                Affects::Measurement;

            /// a reading that jumps by more is a fault until three agree
            SpikeFilter "spike-filter" spike_filter: SpikeFilter = SpikeFilter::Off,
                Form::Lengths { mm: "off|0.001..100 mm", um: "off|1..100000 um" }, Affects::Lines;

            /// what is made of the last N results
            Average "average" average: Average = Average::None,
                Form::Words("none|moving 2..64|median 2..64|recursive 2..64"), Affects::Lines;

            /// after a fault, give the last reading for so many results, flagged h
            Hold "hold" hold: u16 = 0, Form::Number { least: 0, most: 1000, unit: "" }, Affects::Lines;

            /// switch an output on from LOW to HIGH
            Limits "limits" limits: Limits = Limits::Off,
                Form::Lengths {
                    mm: "off|LOW HIGH [HYSTERESIS 0..1000] mm, -8000..8000, LOW first",
                    um: "off|LOW HIGH [HYSTERESIS 0..1000000] um, -8000000..8000000, LOW first",
                },
                Affects::Lines;

            /// the most lines a second, whatever the frames are; 0 is a line for each
            Rate "rate" rate: u16 = 0, Form::Number { least: 0, most: 1000, unit: "Hz" }, Affects::Lines;

            /// the unit of lengths, sent and typed; a typed value may end with its own
            Units "units" units: Units = Units::Millimetres, Form::Words("mm|um"), Affects::Lines;

            /// the columns of a line; `output ?` lists them
            Output "output" output: Columns = Columns::default(),
                Form::Several(Columns::NAMES), Affects::Lines;
        }
    };
}

/// How a value is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// A whole number.
    Number {
        /// The smallest.
        least: u32,
        /// The largest.
        most: u32,
        /// Its unit, empty for a count.
        unit: &'static str,
    },
    /// One of these words, separated by `|`.
    Words(&'static str),
    /// Words and lengths, as [`Self::Words`] in either unit.
    Lengths {
        /// In millimetres.
        mm: &'static str,
        /// In micrometres.
        um: &'static str,
    },
    /// One of the names that `help` with the setting's name lists.
    Listed,
    /// Some of these words, separated by blanks.
    Several(&'static str),
}

/// What a change of a setting affects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Affects {
    /// The measurement: the frame under way starts again. `save` writes the setting to flash, `defaults` sets
    /// it back.
    Measurement,
    /// The lines of readings, and not the measurement. `save` and `defaults` as above.
    Lines,
    /// How the sensor is found on its line. `save` as above; `defaults` leaves the setting, so that a program
    /// does not lose the sensor, and the sensor does not begin to talk on a line that it shares.
    Connection,
    /// What this session sends. The setting holds until the next start.
    Session,
}

/// Why words do not give a value of a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValueError {
    /// The words are not understood, or are too many.
    Form,
    /// The number is too small or too large.
    Range,
    /// The list has no such name.
    Unlisted,
}

/// A type that a setting's value can have: how it is read and written.
pub trait ValueText: Copy {
    /// Reads a value from its words. Lengths without a unit are in `units`.
    ///
    /// # Errors
    /// [`ValueError`] says what is wrong with them.
    fn read(words: &[&str], form: Form, units: Units) -> Result<Self, ValueError>;

    /// Writes it as [`ValueText::read`] reads it. Lengths have these units, with their name; without units
    /// they are in micrometres that are not named, as flash and recordings hold them.
    ///
    /// # Errors
    /// The formatter's.
    fn write(self, f: &mut fmt::Formatter<'_>, units: Option<Units>) -> fmt::Result;
}

macro_rules! declare {
    ($(
        $(#[doc = $help:literal])+
        $variant:ident $name:literal $field:ident: $type:ty = $default:expr, $form:expr, $affects:expr;
    )+) => {
        /// The value of every setting.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct Settings {
            $($(#[doc = $help])+ pub $field: $type,)+
        }

        impl Default for Settings {
            /// The settings of the factory.
            fn default() -> Self {
                Self { $($field: $default,)+ }
            }
        }

        /// Which setting.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Setting {
            $($(#[doc = $help])+ $variant,)+
        }

        /// A value, and of which setting. `Display` is the line that sets it, whatever `units` is.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Value {
            $($(#[doc = $help])+ $variant($type),)+
        }

        impl Settings {
            /// The value of a setting.
            pub const fn get(&self, setting: Setting) -> Value {
                match setting {
                    $(Setting::$variant => Value::$variant(self.$field),)+
                }
            }

            /// Sets a value.
            pub const fn set(&mut self, value: Value) {
                match value {
                    $(Value::$variant(value) => self.$field = value,)+
                }
            }
        }

        impl Setting {
            /// All settings, in the order in which `help` shows them.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];

            /// The name that a person types.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            /// What the setting does, in a few words.
            pub const fn help(self) -> &'static str {
                match self {
                    $(Self::$variant => const { concat!($($help),+).trim_ascii() },)+
                }
            }

            /// How its value is typed.
            pub const fn form(self) -> Form {
                match self {
                    $(Self::$variant => $form,)+
                }
            }

            /// What a change affects.
            pub const fn affects(self) -> Affects {
                match self {
                    $(Self::$variant => $affects,)+
                }
            }

            /// Reads a value of this setting. Lengths without a unit are in `units`.
            ///
            /// # Errors
            /// [`ValueError`] says what is wrong with the words.
            pub fn read_in(self, units: Units, words: &[&str]) -> Result<Value, ValueError> {
                match self {
                    $(Self::$variant => ValueText::read(words, $form, units).map(Value::$variant),)+
                }
            }
        }

        impl Value {
            /// Of which setting it is.
            pub const fn setting(self) -> Setting {
                match self {
                    $(Self::$variant(_) => Setting::$variant,)+
                }
            }

            fn write(self, f: &mut fmt::Formatter<'_>, units: Option<Units>) -> fmt::Result {
                write!(f, "{} ", self.setting().name())?;
                match self {
                    $(Self::$variant(value) => value.write(f, units),)+
                }
            }
        }
    };
}

list!(declare);

impl Settings {
    /// How the sensor speaks now: as on a line of its own while it is `plain`.
    pub fn connection(&self) -> Connection {
        if self.plain {
            return Connection::default();
        }
        Connection {
            format: self.format,
            baud: self.baud,
            bits: self.bits,
            address: self.address,
        }
    }

    /// Where the spot is searched: `region` counts with one slit only.
    pub const fn searched(&self) -> Region {
        match self.slits {
            Slits::One => self.region,
            Slits::Comb => Region::ALL,
        }
    }

    /// The settings that the core measures by.
    pub const fn options(&self) -> Options {
        Options {
            rows: self.rows,
            mean: self.mean,
            exposure: self.exposure,
            exposure_limit: self.exposure_limit,
            laser: self.laser,
            ambient: self.ambient,
            black_level: self.black_level,
            estimator: self.estimator,
            slits: self.slits,
            region: self.region,
            peak: self.peak,
        }
    }
}

impl Setting {
    /// Reads a value as flash and recordings hold it: lengths without a unit are in micrometres.
    ///
    /// # Errors
    /// As [`Self::read_in`].
    pub fn read(self, words: &[&str]) -> Result<Value, ValueError> {
        self.read_in(Units::Micrometres, words)
    }

    /// Finds a setting by the words of its [`name`](Self::name), at the front of a line. Returns it with the
    /// words that follow. A longer name goes first: `exposure limit` is not `exposure` with the value
    /// `limit`.
    pub fn of_words<'a, 'b>(words: &'a [&'b str]) -> Option<(Self, &'a [&'b str])> {
        let named = |length: usize| {
            let (name, values) = words.split_at_checked(length)?;
            let is_name = |it: &Self| {
                (it.name().as_bytes().split(|&it| it == b' '))
                    .eq(name.iter().map(|it| it.as_bytes()))
            };
            Some((Self::ALL.iter().copied().find(is_name)?, values))
        };
        named(2).or_else(|| named(1))
    }
}

impl Value {
    /// Whether `save` writes it to flash.
    pub fn is_saved(self) -> bool {
        self.setting().affects() != Affects::Session
    }

    /// The line that sets it, with lengths in a unit that the line names.
    pub fn in_units(self, units: Units) -> impl fmt::Display {
        fmt::from_fn(move |f| self.write(f, Some(units)))
    }

    /// The line as flash and recordings hold it: with lengths in micrometres, without a unit.
    pub fn stored(self) -> impl fmt::Display {
        fmt::from_fn(move |f| self.write(f, None))
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, Some(Units::default()))
    }
}

impl Form {
    /// The form of lengths in this unit.
    pub const fn in_units(self, units: Units) -> Self {
        match (self, units) {
            (Self::Lengths { mm, .. }, Units::Millimetres) => Self::Words(mm),
            (Self::Lengths { um, .. }, Units::Micrometres) => Self::Words(um),
            (form, _) => form,
        }
    }
}

impl fmt::Display for Form {
    /// What may be typed: `1..64`, `on|off`, or `NAME`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number { least, most, unit } => {
                let blank = if unit.is_empty() { "" } else { " " };
                write!(f, "{least}..{most}{blank}{unit}")
            }
            Self::Words(words) | Self::Lengths { mm: words, .. } => f.write_str(words),
            Self::Listed => f.write_str("NAME"),
            Self::Several(_) => f.write_str("NAMES"),
        }
    }
}

/// The most words of a line: those of the longest command, `output` with all columns, and one more to notice
/// that there are too many.
const MOST_WORDS: usize = 13;

/// The words of a line, separated by blanks.
pub fn split_words(line: &str) -> Vec<&str, MOST_WORDS> {
    let mut words = Vec::new();
    for word in line.split_ascii_whitespace() {
        // Words beyond the last place are dropped: the words before them are already too many.
        let _ = words.push(word);
    }
    words
}

/// Reads a whole number.
///
/// # Errors
/// [`ValueError::Form`] where the word has anything but digits, [`ValueError::Range`] beyond the range.
pub fn read_number<N: TryFrom<u32>>(word: &str, least: u32, most: u32) -> Result<N, ValueError> {
    N::try_from(read_u32(word, least, most)?).map_err(|_| ValueError::Range)
}

fn read_u32(word: &str, least: u32, most: u32) -> Result<u32, ValueError> {
    if word.is_empty() || !word.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err(ValueError::Form);
    }
    let number = word.parse().ok();
    let in_range = number.filter(|number| (least..=most).contains(number));
    in_range.ok_or(ValueError::Range)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_settings_of_the_factory_are_the_default_options_of_the_core() {
        assert_eq!(Settings::default().options(), Options::default());
    }

    /// Scripts in host-tests/tests/session have more values of each setting. Words in upper case or without
    /// a letter are not in a line.
    #[test]
    fn a_value_is_read_as_it_is_written_or_is_wrong() {
        for &setting in Setting::ALL {
            let default = Settings::default().get(setting);
            let line = default.to_string();
            let words = split_words(&line);
            let (found, values) = Setting::of_words(&words).expect("a setting");
            let read = (found, found.read(values));
            assert_eq!(read, (setting, Ok(default)), "{line}");
        }
        for (setting, word, error) in [
            (Setting::Rows, "", ValueError::Form),
            (Setting::Rows, "65", ValueError::Range),
            (Setting::Mean, "Plain", ValueError::Form),
            (Setting::Estimator, "Adaptive", ValueError::Unlisted),
        ] {
            assert_eq!(setting.read(&[word]), Err(error), "{setting:?} {word}");
        }
        assert_eq!(Setting::Output.read(&[]), Err(ValueError::Form));
    }
}
