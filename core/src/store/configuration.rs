//! What is kept, as bytes:
//!
//! ```text
//! format version | rows | mean | estimator | black level | its value | the record's own bytes, or none
//! 1 byte         | 2    | 1    | 1         | 1           | 4         | up to 1361
//! ```
//!
//! Numbers are little endian; mean, estimator and black level are letters. What checks the bytes as a whole is not among them: the
//! store does that.

use core::fmt;

use crate::black_level::BlackLevel;
use crate::centre::Estimator;
use crate::frame::{MAX_ROWS, Mean};
use crate::measurement::Settings;
use crate::record::{self, Record, RecordError};
use crate::row::LARGEST_COUNT;
use crate::units::Counts;

/// What `save` keeps: the settings, and the calibration's record where the sensor has one of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Configuration {
    /// What was set.
    pub settings: Settings,
    /// The sensor's own calibration. Without it the nominal one holds.
    pub record: Option<Record>,
}

/// The format that is written and read.
pub const VERSION: u8 = 1;

/// Bytes of the settings, version included.
const SETTINGS: usize = 10;

/// The most bytes there can be.
pub const MAX_ENCODED: usize = SETTINGS + record::MAX_ENCODED;

const WEIGHTED: u8 = b'w';
const PLAIN: u8 = b'p';

const SHIELDED: u8 = b's';
const FRAME: u8 = b'f';
const FIXED: u8 = b'x';

/// Writes to the front of a buffer, which [`MAX_ENCODED`] bytes are always enough for, and gives what was written.
///
/// # Errors
/// [`ConfigurationError::NoRoom`], or what [`decode`] would say of it.
pub fn encode<'a>(
    saved: &Configuration,
    buffer: &'a mut [u8],
) -> Result<&'a [u8], ConfigurationError> {
    check(&saved.settings)?;
    let no_room = ConfigurationError::NoRoom {
        bytes: buffer.len(),
    };
    let (settings, rest) = buffer.split_first_chunk_mut().ok_or(no_room)?;
    *settings = settings_to_bytes(&saved.settings);
    let record = match &saved.record {
        Some(record) => record::encode(record, rest)?.len(),
        None => 0,
    };
    buffer.get(..SETTINGS.saturating_add(record)).ok_or(no_room)
}

/// Reads what was kept.
///
/// # Errors
/// [`ConfigurationError`] says why the bytes are none that could be used.
pub fn decode(bytes: &[u8]) -> Result<Configuration, ConfigurationError> {
    let short = ConfigurationError::Short { bytes: bytes.len() };
    match bytes.first() {
        None => return Err(short),
        Some(&VERSION) => {}
        Some(&version) => return Err(ConfigurationError::Version { version }),
    }
    let (settings, record) = bytes.split_first_chunk().ok_or(short)?;
    let settings = settings_from_bytes(*settings)?;
    check(&settings)?;
    let record = match record {
        [] => None,
        record => Some(record::decode(record)?),
    };
    Ok(Configuration { settings, record })
}

/// What the settings' types leave open.
fn check(settings: &Settings) -> Result<(), ConfigurationError> {
    let rows = settings.rows;
    if !(1..=MAX_ROWS).contains(&u32::from(rows)) {
        return Err(ConfigurationError::Rows { rows });
    }
    match settings.black_level {
        BlackLevel::Fixed(level)
            if !(0..=i32::from(LARGEST_COUNT) * (1 << Counts::FRACTION))
                .contains(&level.to_bits()) =>
        {
            Err(ConfigurationError::BlackLevel { level })
        }
        _ => Ok(()),
    }
}

fn settings_to_bytes(settings: &Settings) -> [u8; SETTINGS] {
    let [rows_low, rows_high] = settings.rows.to_le_bytes();
    let mean = match settings.mean {
        Mean::Weighted => WEIGHTED,
        Mean::Plain => PLAIN,
    };
    // An ASCII letter.
    let estimator = settings.estimator.letter() as u8;
    let (black_level, value) = match settings.black_level {
        BlackLevel::Shielded => (SHIELDED, 0),
        BlackLevel::Frame => (FRAME, 0),
        BlackLevel::Fixed(level) => (FIXED, level.to_bits()),
    };
    let [a, b, c, d] = value.to_le_bytes();
    [
        VERSION,
        rows_low,
        rows_high,
        mean,
        estimator,
        black_level,
        a,
        b,
        c,
        d,
    ]
}

fn settings_from_bytes(bytes: [u8; SETTINGS]) -> Result<Settings, ConfigurationError> {
    let [
        _,
        rows_low,
        rows_high,
        mean,
        estimator,
        black_level,
        value @ ..,
    ] = bytes;
    Ok(Settings {
        rows: u16::from_le_bytes([rows_low, rows_high]),
        mean: match mean {
            WEIGHTED => Mean::Weighted,
            PLAIN => Mean::Plain,
            letter => return Err(ConfigurationError::Letter { letter }),
        },
        estimator: Estimator::ALL
            .into_iter()
            .find(|known| known.letter() == char::from(estimator))
            .ok_or(ConfigurationError::Letter { letter: estimator })?,
        black_level: match (black_level, i32::from_le_bytes(value)) {
            (SHIELDED, 0) => BlackLevel::Shielded,
            (FRAME, 0) => BlackLevel::Frame,
            (FIXED, level) => BlackLevel::Fixed(Counts::from_bits(level)),
            (letter, _) => return Err(ConfigurationError::Letter { letter }),
        },
    })
}

/// Why bytes are nothing that was kept, or something cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigurationError {
    /// The buffer is too short.
    NoRoom {
        /// What it holds.
        bytes: usize,
    },
    /// Fewer bytes than the settings alone have.
    Short {
        /// How many there are.
        bytes: usize,
    },
    /// The format is one that this firmware does not know.
    Version {
        /// What the first byte says.
        version: u8,
    },
    /// No frame has so many rows.
    Rows {
        /// How many.
        rows: u16,
    },
    /// A mean, estimator or black level that there is not.
    Letter {
        /// Its letter.
        letter: u8,
    },
    /// A black level that no pixel has.
    BlackLevel {
        /// That level.
        level: Counts,
    },
    /// The record is none that could be used.
    Record(RecordError),
}

impl From<RecordError> for ConfigurationError {
    fn from(error: RecordError) -> Self {
        Self::Record(error)
    }
}

impl fmt::Display for ConfigurationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRoom { bytes } => write!(
                f,
                "a buffer of {bytes} bytes is too short for settings and record: {MAX_ENCODED} are enough for any"
            ),
            Self::Short { bytes } => {
                write!(f, "{bytes} bytes are too few for settings: save again")
            }
            Self::Version { version } => write!(
                f,
                "what was saved has format {version}, and this firmware knows {VERSION}: save again"
            ),
            Self::Rows { rows } => write!(
                f,
                "a frame of {rows} rows cannot be: set rows to 1 to {MAX_ROWS}"
            ),
            Self::Letter { letter } => write!(
                f,
                "setting '{}' is none that this firmware knows: set it and save again",
                letter.escape_ascii()
            ),
            Self::BlackLevel { level } => write!(
                f,
                "a black level of {level} counts is none that a pixel has: set it to 0 to {LARGEST_COUNT}"
            ),
            Self::Record(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for ConfigurationError {}
