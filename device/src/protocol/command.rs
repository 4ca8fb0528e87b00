//! Reads commands from lines that a person or a program typed, and writes them as such lines.
//!
//! `NAME` shows a setting, `NAME VALUE` sets it. Upper case counts as lower case. Words are separated by
//! blanks or tabs.

use core::fmt;

use super::flat::Flat;
use super::help;
use super::nearest::nearest;
use super::piece::{Piece, PieceError};
use super::row_lines::RowPart;
use super::upload::Step;
use crate::filters::zero::Zero;
use crate::record::MAX_ENCODED;
use crate::settings::lengths::{read_length, split_unit, write_lengths};
use crate::settings::{Form, Setting, Value, ValueError, read_number, split_words};
use slitrange::base::units::{Micrometres, Units};
use slitrange::centre::Estimator;
use slitrange::row::pixels::flat_field::Kind;

/// The longest line that is read, in bytes, without its end.
pub const MAX_LINE: usize = 80;

/// What the sensor is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Nothing: an empty line.
    Nothing,
    /// The list of commands.
    Help,
    /// The list of estimators, with what each is for.
    HelpEstimator,
    /// What this sensor is.
    Info,
    /// What has been counted since the start.
    Status,
    /// The errors among these counts.
    Errors,
    /// The time since the start.
    Uptime,
    /// Start again, as if the power came back.
    Reset,
    /// Check what the sensor can check by itself.
    Selftest,
    /// One reading.
    Distance,
    /// A frame, and its result as one of the stream.
    Measure,
    /// One centre, calibrated or not.
    Centre,
    /// One reading with the parts of its uncertainty.
    Uncertainty,
    /// One row, as the sensor sees it.
    Row(RowPart),
    /// Make the next reading the zero of distances, or give distances from the laser again.
    Zero(bool),
    /// Show the distance that the zero has, or give the next reading's place this one.
    Master(Option<Micrometres>),
    /// Show a setting.
    Show(Setting),
    /// Set a setting.
    Set(Value),
    /// Show the calibration in use, or switch between distances and centres only.
    Calibration(Option<bool>),
    /// Show the piece of the calibration's record that begins at an offset.
    Data(u16),
    /// A step of an upload of another record.
    Upload(Step),
    /// Write settings and calibration to flash, unless that would replace a calibration by the nominal one.
    Save,
    /// Write settings and the nominal calibration to flash, over the calibration that flash holds.
    SaveNominal,
    /// Settings and calibration as they left the factory.
    Defaults,
    /// Take, use, save or erase the map of the pixels.
    Flat(Flat),
}

impl Command {
    /// Whether the command may be sent to all sensors of a line. Its answer, which nobody sends, needs no
    /// frame and no row.
    pub const fn is_for_all(self) -> bool {
        matches!(
            self,
            Self::Set(_)
                | Self::Zero(false)
                | Self::Calibration(Some(_))
                | Self::Save
                | Self::Defaults
                | Self::Reset
        )
    }
}

/// Why a line is not a command. `Display` is the answer, without its line end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The first word is no command. Holds the command or the setting whose name is nearest, if one is near.
    #[error("E1 unknown command, try {}{}", .0.unwrap_or("help"), .0.map_or("", |_| " or help"))]
    Unknown(Option<&'static str>),
    /// A value is missing, is not understood, or is one too many. Holds the expected form.
    #[error("E2 expected {0}")]
    Form(&'static str),
    /// The value of a setting is not understood, out of range, or not in its list.
    #[error(fmt = write_value_error)]
    Value(Setting, ValueError, Units),
    /// The value of `master` is too large.
    #[error("E23 out of range, expected master -4000..4000 mm, or -4000000..4000000 um")]
    MasterRange,
    /// The pixels of a row that are asked for are not understood, or are no pixels of a row.
    #[error("{} {}", start(*.0), RowPart::FORM)]
    Row(ValueError),
    /// An offset or a length that no record has.
    #[error("{} {}", start(*.1), .0)]
    Record(RecordForm, ValueError),
    /// The line is longer than [`MAX_LINE`].
    #[error("E4 line longer than {MAX_LINE} characters")]
    TooLong,
    /// The line has bytes that are not printable ASCII.
    #[error("E5 not ASCII text")]
    NotText,
    /// The line does not have the checksum that it ends with.
    #[error("E7 checksum {written:02x}, of what came {computed:02x}: send it again")]
    LineChecksum {
        /// The checksum that was sent.
        written: u32,
        /// The exclusive or of what came.
        computed: u32,
    },
    /// Characters of the line were lost, because too many came at once.
    #[error("E7 characters were lost, so this line was not taken: send it again")]
    Cut,
    /// A piece of a record does not have the checksum that was sent with it.
    #[error("E7 checksum {written:04x}, of what came {computed:04x}: send it again")]
    Checksum {
        /// The checksum that was sent.
        written: u16,
        /// The checksum of what came.
        computed: u16,
    },
}

/// The commands whose form contains the length of the longest record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordForm {
    /// `calibration begin`
    Begin,
    /// `calibration data`
    Data,
}

impl fmt::Display for RecordForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Begin => write!(f, "calibration begin 1..{MAX_ENCODED}"),
            Self::Data => write!(f, "calibration data 0..{} [HEX CRC16]", MAX_ENCODED - 1),
        }
    }
}

/// What an answer to refused words begins with.
const fn start(error: ValueError) -> &'static str {
    match error {
        ValueError::Form => "E2 expected",
        ValueError::Range => "E3 out of range, expected",
        ValueError::Unlisted => "E6 unknown",
    }
}

fn write_value_error(
    setting: &Setting,
    error: &ValueError,
    units: &Units,
    f: &mut fmt::Formatter<'_>,
) -> fmt::Result {
    let (name, form) = (setting.name(), setting.form().in_units(*units));
    write!(f, "{} {name}", start(*error))?;
    if *error != ValueError::Unlisted {
        write!(f, " {form}")?;
    }
    match form {
        Form::Listed => {
            f.write_str(", one of")?;
            Estimator::ALL
                .iter()
                .try_for_each(|it| write!(f, " {}", it.name()))?;
            write!(f, "; try help {name}")
        }
        Form::Several(names) => write!(f, ", some of {names}"),
        Form::Number { .. } | Form::Words(_) | Form::Lengths { .. } => Ok(()),
    }
}

/// The commands without numbers, and the line of each.
static WITHOUT_NUMBERS: [(&str, Command); 33] = [
    ("help", Command::Help),
    ("?", Command::Help),
    ("help estimator", Command::HelpEstimator),
    ("info", Command::Info),
    ("status", Command::Status),
    ("errors", Command::Errors),
    ("uptime", Command::Uptime),
    ("reset", Command::Reset),
    ("selftest", Command::Selftest),
    ("distance", Command::Distance),
    ("measure", Command::Measure),
    ("centre", Command::Centre),
    ("uncertainty", Command::Uncertainty),
    ("row", Command::Row(RowPart::Whole)),
    ("row window", Command::Row(RowPart::Window)),
    ("zero", Command::Zero(true)),
    ("zero off", Command::Zero(false)),
    ("master", Command::Master(None)),
    ("calibration", Command::Calibration(None)),
    ("calibration on", Command::Calibration(Some(true))),
    ("calibration off", Command::Calibration(Some(false))),
    ("calibration commit", Command::Upload(Step::Commit)),
    ("calibration abort", Command::Upload(Step::Abort)),
    ("save", Command::Save),
    ("save nominal", Command::SaveNominal),
    ("defaults", Command::Defaults),
    ("flat", Command::Flat(Flat::Show)),
    ("flat dark", Command::Flat(Flat::Take(Kind::Dark))),
    ("flat lit", Command::Flat(Flat::Take(Kind::Lit))),
    ("flat save", Command::Flat(Flat::Save)),
    ("flat on", Command::Flat(Flat::Use(true))),
    ("flat off", Command::Flat(Flat::Use(false))),
    ("flat none", Command::Flat(Flat::Erase)),
];

/// As [`parse_in`], with the factory's unit. A sensor's answers and what `Display` writes name their unit.
///
/// # Errors
/// As [`parse_in`].
pub fn parse(line: &[u8]) -> Result<Command, Error> {
    parse_in(Units::default(), line)
}

/// Reads a line (without its end). Lengths without a unit are in `units`.
///
/// # Errors
/// The line is no command; [`Error`] says why.
pub fn parse_in(units: Units, line: &[u8]) -> Result<Command, Error> {
    if line.len() > MAX_LINE {
        return Err(Error::TooLong);
    }
    if !line.iter().all(|byte| matches!(byte, b' '..=b'~' | b'\t')) {
        return Err(Error::NotText);
    }
    // All names and words are lower case.
    let mut lower = [0; MAX_LINE];
    for (place, byte) in lower.iter_mut().zip(line) {
        *place = byte.to_ascii_lowercase();
    }
    let line = lower.get(..line.len()).unwrap_or_default();
    let words = split_words(core::str::from_utf8(line).unwrap_or_default());
    let Some((&name, values)) = words.split_first() else {
        return Ok(Command::Nothing);
    };
    if let Some((setting, values)) = Setting::of_words(&words) {
        return match values {
            [] => Ok(Command::Show(setting)),
            _ => match setting.read_in(units, values) {
                Ok(value) => Ok(Command::Set(value)),
                Err(error) => Err(Error::Value(setting, error, units)),
            },
        };
    }
    let mut known = WITHOUT_NUMBERS.iter();
    if let Some(&(_, command)) = known.find(|(line, _)| {
        (line.as_bytes().split(|&it| it == b' ')).eq(words.iter().map(|it| it.as_bytes()))
    }) {
        return Ok(command);
    }
    match name {
        "row" => RowPart::parse(values).map(Command::Row).map_err(Error::Row),
        "master" => {
            let most = Zero::MOST_UM;
            let value = match split_unit(values, units) {
                (&[word], units) => read_length(word, units, most.saturating_neg(), most),
                _ => Err(ValueError::Form),
            };
            value
                .map(|value| Command::Master(Some(value)))
                .map_err(|error| match error {
                    ValueError::Range => Error::MasterRange,
                    _ => Error::Form("master [VALUE [mm|um]], to 0.1 um"),
                })
        }
        "calibration" => calibration(values),
        "help" | "?" => Err(Error::Form("help [estimator]")),
        "zero" => Err(Error::Form("zero [off]")),
        "save" => Err(Error::Form("save [nominal]")),
        "flat" => Err(Error::Form("flat [dark|lit|save|on|off|none]")),
        name => match WITHOUT_NUMBERS.iter().find(|&&(line, _)| line == name) {
            // A value is too many.
            Some((line, _)) => Err(Error::Form(line)),
            None => Err(Error::Unknown(nearest(name, help::names()))),
        },
    }
}

fn calibration(values: &[&str]) -> Result<Command, Error> {
    #[expect(clippy::cast_possible_truncation, reason = "far below 2^32")]
    const MOST: u32 = MAX_ENCODED as u32;
    match *values {
        ["begin", bytes] => match read_number(bytes, 1, MOST) {
            Ok(bytes) => Ok(Command::Upload(Step::Begin(bytes))),
            Err(error) => Err(Error::Record(RecordForm::Begin, error)),
        },
        ["begin", ..] => Err(Error::Record(RecordForm::Begin, ValueError::Form)),
        ["data", offset] => match read_number(offset, 0, MOST - 1) {
            Ok(offset) => Ok(Command::Data(offset)),
            Err(error) => Err(Error::Record(RecordForm::Data, error)),
        },
        ["data", offset, digits, checksum] => match Piece::parse(offset, digits, checksum) {
            Ok(piece) => Ok(Command::Upload(Step::Piece(piece))),
            Err(PieceError::Form) => Err(Error::Record(RecordForm::Data, ValueError::Form)),
            Err(PieceError::Checksum { written, computed }) => {
                Err(Error::Checksum { written, computed })
            }
        },
        ["data", ..] => Err(Error::Record(RecordForm::Data, ValueError::Form)),
        _ => Err(Error::Form("calibration on|off|begin|data|commit|abort")),
    }
}

impl fmt::Display for Command {
    /// The line that [`parse`] reads as this command.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => Ok(()),
            Self::Row(RowPart::Range { first, last }) => write!(f, "row {first} {last}"),
            &Self::Master(Some(value)) => {
                f.write_str("master ")?;
                write_lengths(f, &[value], Some(Units::default()))
            }
            Self::Show(setting) => f.write_str(setting.name()),
            Self::Set(value) => value.fmt(f),
            Self::Data(offset) => write!(f, "calibration data {offset}"),
            Self::Upload(Step::Begin(bytes)) => write!(f, "calibration begin {bytes}"),
            Self::Upload(Step::Piece(piece)) => piece.fmt(f),
            command => {
                let line = WITHOUT_NUMBERS.iter().find(|(_, known)| known == command);
                f.write_str(line.map_or("", |(line, _)| line))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Scripts in host-tests/tests/session have all commands and errors. These are for Miri, and for bytes
    /// that no script can have.
    #[test]
    fn lines_are_commands_or_errors() {
        use ValueError::{Form, Range};
        let wrong = |setting, error| Err(Error::Value(setting, error, Units::Millimetres));
        for (line, command) in [
            (&b""[..], Ok("")),
            (b"  help ", Ok("help")),
            (b"STREAM\tOff", Ok("stream off")),
            (b"black fixed  300", Ok("black fixed 300")),
            (b"row 1700 1839", Ok("row 1700 1839")),
            (b"master -512.0625", Ok("master -512.0625 mm")),
            (b"limits 790.50 810 um", wrong(Setting::Limits, Form)),
            (b"limits 790000.5 810000 um", Ok("limits 790.0005 810 mm")),
            (b" calibration  commit", Ok("calibration commit")),
            (b"distanse", Err(Error::Unknown(Some("distance")))),
            (b"rows 0", wrong(Setting::Rows, Range)),
            (b"rows\0 1", Err(Error::NotText)),
            (b"rows \xff", Err(Error::NotText)),
            (&[b'a'; MAX_LINE + 1], Err(Error::TooLong)),
        ] {
            let found = parse(line).map(|command| command.to_string());
            let shown = line.escape_ascii();
            assert_eq!(found.as_deref(), command.as_ref().copied(), "{shown}");
        }
    }
}
