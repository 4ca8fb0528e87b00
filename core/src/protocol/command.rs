//! A line that a person or a program typed becomes a command.
//!
//! `NAME` reads, `NAME value` sets. Names are lower case; words are separated by blanks.

use core::fmt;
use core::ops::RangeInclusive;

use super::piece::{Piece, PieceError};
use super::upload::Step;
use crate::black_level::BlackLevel;
use crate::centre::Estimator;
use crate::frame::{MAX_ROWS, Mean};
use crate::record::MAX_ENCODED;
use crate::units::Counts;

/// The longest line that is read, in bytes, without its end.
pub const MAX_LINE: usize = 64;

/// The largest black level that can be fixed, in counts: that of a 12-bit converter.
const MAX_BLACK: u32 = 4095;

/// What the sensor is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Nothing: an empty line.
    Nothing,
    /// The list of commands.
    Help,
    /// The list of estimators, with what each costs and gives.
    HelpEstimator,
    /// What this sensor is.
    Info,
    /// How it fares.
    Status,
    /// One reading.
    Distance,
    /// One centre, calibrated or not.
    Centre,
    /// Show whether readings stream, or set it.
    Stream(Option<bool>),
    /// Show how the black level is found, or set it.
    Black(Option<BlackLevel>),
    /// Show the rows in a frame, or set them.
    Rows(Option<u16>),
    /// Show how the rows' centres become one, or set it.
    Mean(Option<Mean>),
    /// Show how the centre of a row is found, or set it.
    Estimator(Option<Estimator>),
    /// Show the calibration in use, or switch between distances and centres only.
    Calibration(Option<bool>),
    /// Show the piece of the calibration's record that begins at an offset.
    Data(u16),
    /// A step of an upload of another record.
    Upload(Step),
    /// Keep settings and calibration over a power cycle.
    Save,
    /// Settings and calibration as they left the factory.
    Defaults,
}

/// Why a line is no command. `Display` is the answer, without its line end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The first word is no command.
    Unknown,
    /// A value is missing, not understood or one too many. Names the form that is.
    Form(&'static str),
    /// A number is too small or too large. Names the form and the range.
    Range(&'static str),
    /// The line is longer than [`MAX_LINE`].
    TooLong,
    /// The line has bytes that are not printable ASCII.
    NotText,
    /// No estimator has that name.
    NoEstimator,
    /// A piece of a record does not have the checksum that was sent with it.
    Checksum {
        /// What was sent.
        written: u16,
        /// What it is.
        computed: u16,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("E1 unknown command, try help"),
            Self::Form(form) => write!(f, "E2 expected {form}"),
            Self::Range(range) => write!(f, "E3 out of range, expected {range}"),
            Self::TooLong => write!(f, "E4 line longer than {MAX_LINE} characters"),
            Self::NotText => f.write_str("E5 not ASCII text"),
            Self::NoEstimator => f.write_str("E6 unknown estimator, try help estimator"),
            Self::Checksum { written, computed } => {
                write!(
                    f,
                    "E7 checksum {written:04x}, of what came {computed:04x}: send it again"
                )
            }
        }
    }
}

impl core::error::Error for Error {}

const BLACK: &str = "black fixed 0..4095|shielded|frame";
const ROWS: &str = "rows 1..64";
const MEAN: &str = "mean plain|weighted";
const STREAM: &str = "stream on|off";
const HELP: &str = "help [estimator]";
const ESTIMATOR: &str = "estimator NAME, try help estimator";
const CALIBRATION: &str = "calibration on|off|begin|data|commit|abort";
const BEGIN: &str = "calibration begin 1..1361";
const DATA: &str = "calibration data 0..1360 [HEX CRC16]";

/// Reads a line (without its end).
///
/// # Errors
/// The line is no command; [`Error`] says why.
pub fn parse(line: &[u8]) -> Result<Command, Error> {
    if line.len() > MAX_LINE {
        return Err(Error::TooLong);
    }
    if !line.iter().all(|byte| matches!(byte, b' '..=b'~' | b'\t')) {
        return Err(Error::NotText);
    }
    let line = core::str::from_utf8(line).map_err(|_| Error::NotText)?;
    let mut words = line.split_ascii_whitespace();
    let Some(name) = words.next() else {
        return Ok(Command::Nothing);
    };
    let values = [(); MOST_VALUES + 1].map(|()| words.next());
    match name {
        "help" => help(values),
        "info" => alone(values, Command::Info, "info"),
        "status" => alone(values, Command::Status, "status"),
        "distance" => alone(values, Command::Distance, "distance"),
        "centre" => alone(values, Command::Centre, "centre"),
        "save" => alone(values, Command::Save, "save"),
        "defaults" => alone(values, Command::Defaults, "defaults"),
        "stream" => switch(values, STREAM).map(Command::Stream),
        "calibration" => calibration(values),
        "black" => black(values).map(Command::Black),
        "rows" => rows(values).map(Command::Rows),
        "mean" => mean(values).map(Command::Mean),
        "estimator" => estimator(values).map(Command::Estimator),
        _ => Err(Error::Unknown),
    }
}

/// Values of the command that takes the most.
const MOST_VALUES: usize = 4;

/// The words behind a command's name. The last one is there only if there are too many.
type Values<'a> = [Option<&'a str>; MOST_VALUES + 1];

fn alone(values: Values<'_>, command: Command, form: &'static str) -> Result<Command, Error> {
    match values {
        [None, ..] => Ok(command),
        _ => Err(Error::Form(form)),
    }
}

fn help(values: Values<'_>) -> Result<Command, Error> {
    match values {
        [None, ..] => Ok(Command::Help),
        [Some("estimator"), None, ..] => Ok(Command::HelpEstimator),
        _ => Err(Error::Form(HELP)),
    }
}

fn switch(values: Values<'_>, form: &'static str) -> Result<Option<bool>, Error> {
    match values {
        [None, ..] => Ok(None),
        [Some("on"), None, ..] => Ok(Some(true)),
        [Some("off"), None, ..] => Ok(Some(false)),
        _ => Err(Error::Form(form)),
    }
}

fn black(values: Values<'_>) -> Result<Option<BlackLevel>, Error> {
    match values {
        [None, ..] => Ok(None),
        [Some("shielded"), None, ..] => Ok(Some(BlackLevel::Shielded)),
        [Some("frame"), None, ..] => Ok(Some(BlackLevel::Frame)),
        [Some("fixed"), Some(counts), None, ..] => {
            let counts = number(counts, 0..=MAX_BLACK, BLACK)?;
            Ok(Some(BlackLevel::Fixed(Counts::from_int(counts as i32))))
        }
        _ => Err(Error::Form(BLACK)),
    }
}

fn rows(values: Values<'_>) -> Result<Option<u16>, Error> {
    match values {
        [None, ..] => Ok(None),
        [Some(rows), None, ..] => Ok(Some(number(rows, 1..=MAX_ROWS, ROWS)? as u16)),
        _ => Err(Error::Form(ROWS)),
    }
}

fn mean(values: Values<'_>) -> Result<Option<Mean>, Error> {
    match values {
        [None, ..] => Ok(None),
        [Some(name), None, ..] => Mean::named(name).map(Some).ok_or(Error::Form(MEAN)),
        _ => Err(Error::Form(MEAN)),
    }
}

fn estimator(values: Values<'_>) -> Result<Option<Estimator>, Error> {
    match values {
        [None, ..] => Ok(None),
        [Some(name), None, ..] => Estimator::named(name).map(Some).ok_or(Error::NoEstimator),
        _ => Err(Error::Form(ESTIMATOR)),
    }
}

fn calibration(values: Values<'_>) -> Result<Command, Error> {
    match values {
        [Some("begin"), Some(bytes), None, ..] => {
            let bytes = number(bytes, 1..=MAX_ENCODED as u32, BEGIN)?;
            Ok(Command::Upload(Step::Begin(bytes as u16)))
        }
        [Some("begin"), ..] => Err(Error::Form(BEGIN)),
        [Some("data"), Some(offset), None, ..] => {
            let offset = number(offset, 0..=MAX_ENCODED as u32 - 1, DATA)?;
            Ok(Command::Data(offset as u16))
        }
        [
            Some("data"),
            Some(offset),
            Some(digits),
            Some(checksum),
            None,
        ] => match Piece::parse(offset, digits, checksum) {
            Ok(piece) => Ok(Command::Upload(Step::Piece(piece))),
            Err(PieceError::Form) => Err(Error::Form(DATA)),
            Err(PieceError::Checksum { written, computed }) => {
                Err(Error::Checksum { written, computed })
            }
        },
        [Some("data"), ..] => Err(Error::Form(DATA)),
        [Some("commit"), None, ..] => Ok(Command::Upload(Step::Commit)),
        [Some("abort"), None, ..] => Ok(Command::Upload(Step::Abort)),
        _ => switch(values, CALIBRATION).map(Command::Calibration),
    }
}

/// A whole number within a range.
fn number(word: &str, range: RangeInclusive<u32>, form: &'static str) -> Result<u32, Error> {
    if word.is_empty() || !word.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err(Error::Form(form));
    }
    word.parse()
        .ok()
        .filter(|number| range.contains(number))
        .ok_or(Error::Range(form))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_understood() {
        assert_eq!(parse(b""), Ok(Command::Nothing));
        assert_eq!(parse(b"  help "), Ok(Command::Help));
        assert_eq!(parse(b"stream"), Ok(Command::Stream(None)));
        assert_eq!(parse(b"stream off"), Ok(Command::Stream(Some(false))));
        assert_eq!(
            parse(b"black fixed 300"),
            Ok(Command::Black(Some(BlackLevel::Fixed(Counts::from_int(
                300
            )))))
        );
        assert_eq!(
            parse(b"black\tframe"),
            Ok(Command::Black(Some(BlackLevel::Frame)))
        );
        assert_eq!(parse(b"rows 64"), Ok(Command::Rows(Some(64))));
        assert_eq!(parse(b"mean"), Ok(Command::Mean(None)));
        assert_eq!(parse(b"mean plain"), Ok(Command::Mean(Some(Mean::Plain))));
        assert_eq!(
            parse(b"calibration on"),
            Ok(Command::Calibration(Some(true)))
        );
        assert_eq!(parse(b"calibration"), Ok(Command::Calibration(None)));
        assert_eq!(parse(b"calibration data 1360"), Ok(Command::Data(1360)));
        assert_eq!(
            parse(b"calibration begin 1361"),
            Ok(Command::Upload(Step::Begin(1361)))
        );
        assert_eq!(
            parse(b" calibration  commit"),
            Ok(Command::Upload(Step::Commit))
        );
        assert_eq!(
            parse(b"calibration abort"),
            Ok(Command::Upload(Step::Abort))
        );
        assert_eq!(parse(b"centre"), Ok(Command::Centre));
        assert_eq!(parse(b"save"), Ok(Command::Save));
        assert_eq!(parse(b"defaults"), Ok(Command::Defaults));
        assert_eq!(parse(b"help estimator"), Ok(Command::HelpEstimator));
        assert_eq!(parse(b"estimator"), Ok(Command::Estimator(None)));
        assert_eq!(
            parse(b"estimator  gauss-newton "),
            Ok(Command::Estimator(Some(Estimator::GaussNewton)))
        );
    }

    #[test]
    fn what_is_no_command_is_said() {
        assert_eq!(parse(b"Help"), Err(Error::Unknown));
        assert_eq!(parse(b"help me"), Err(Error::Form(HELP)));
        assert_eq!(parse(b"help estimator adaptive"), Err(Error::Form(HELP)));
        assert_eq!(parse(b"estimator Adaptive"), Err(Error::NoEstimator));
        assert_eq!(parse(b"estimator t"), Err(Error::NoEstimator));
        assert_eq!(
            parse(b"estimator gauss newton"),
            Err(Error::Form(ESTIMATOR))
        );
        assert_eq!(parse(b"mean Plain"), Err(Error::Form(MEAN)));
        assert_eq!(parse(b"mean plain weighted"), Err(Error::Form(MEAN)));
        assert_eq!(parse(b"rows 0"), Err(Error::Range(ROWS)));
        assert_eq!(parse(b"rows 65"), Err(Error::Range(ROWS)));
        assert_eq!(parse(b"rows 99999999999"), Err(Error::Range(ROWS)));
        assert_eq!(parse(b"black fixed -1"), Err(Error::Form(BLACK)));
        assert_eq!(parse(b"rows -1"), Err(Error::Form(ROWS)));
        assert_eq!(parse(b"rows 4 4"), Err(Error::Form(ROWS)));
        assert_eq!(parse(b"black fixed"), Err(Error::Form(BLACK)));
        assert_eq!(parse(b"black fixed 4096"), Err(Error::Range(BLACK)));
        assert_eq!(parse(b"stream on off"), Err(Error::Form(STREAM)));
        for (line, error) in [
            ("calibration begin", Error::Form(BEGIN)),
            ("calibration begin 0", Error::Range(BEGIN)),
            ("calibration begin 2642", Error::Range(BEGIN)),
            ("calibration begin 10 10", Error::Form(BEGIN)),
            ("calibration data", Error::Form(DATA)),
            ("calibration data -1", Error::Form(DATA)),
            ("calibration data 1361", Error::Range(DATA)),
            ("calibration data 0 00", Error::Form(DATA)),
            ("calibration data 0 00 1d0f 0", Error::Form(DATA)),
            ("calibration data 0 00 1d0f 0 0", Error::Form(DATA)),
            ("calibration commit now", Error::Form(CALIBRATION)),
            ("calibration abort 1", Error::Form(CALIBRATION)),
            ("calibration on off", Error::Form(CALIBRATION)),
            ("calibration start", Error::Form(CALIBRATION)),
            ("save it", Error::Form("save")),
            ("defaults on", Error::Form("defaults")),
            ("centre 3", Error::Form("centre")),
        ] {
            assert_eq!(parse(line.as_bytes()), Err(error), "{line}");
        }
        assert_eq!(parse(&[b'a'; MAX_LINE + 1]), Err(Error::TooLong));
        assert_eq!(parse(b"rows \xff"), Err(Error::NotText));
        assert_eq!(parse(b"rows\x001"), Err(Error::NotText));
        assert_eq!(
            Error::Range(ROWS).to_string(),
            "E3 out of range, expected rows 1..64"
        );
        assert_eq!(
            Error::Checksum {
                written: 0x1d0f,
                computed: 0xe
            }
            .to_string(),
            "E7 checksum 1d0f, of what came 000e: send it again"
        );
    }

    #[test]
    fn the_forms_name_the_longest_record() {
        assert_eq!(BEGIN, format!("calibration begin 1..{MAX_ENCODED}"));
        let last = MAX_ENCODED - 1;
        assert_eq!(DATA, format!("calibration data 0..{last} [HEX CRC16]"));
    }
}
