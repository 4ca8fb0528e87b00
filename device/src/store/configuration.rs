//! A configuration, settings and calibration, as the bytes that flash holds:
//!
//! ```text
//! format version | length of the lines | lines that set the settings | the record's own bytes, or none
//! 1 byte: 1      | 2, little endian    | up to 512                    | up to record::MAX_ENCODED
//! ```
//!
//! The lines are those that a person would type, each with a line feed behind it: `rows 16`. So a setting has
//! one text form, and a firmware that knows more or fewer settings reads the ones that it knows. The store
//! adds a CRC-32.

use core::fmt::Write as _;

use thiserror::Error;

use crate::record::{self, Record, RecordError};
use crate::settings::{Setting, Settings, split_words};
use crate::text::Text;

/// What `save` writes to flash: the settings, and the calibration's record if the sensor has its own. A
/// record has 3 KB, so a configuration to be written borrows its record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration<R = Record> {
    /// The settings. Those that affect the session only are not written.
    pub settings: Settings,
    /// The sensor's own calibration. Without it the nominal one holds.
    pub record: Option<R>,
}

impl Configuration {
    /// To be written.
    pub const fn as_ref(&self) -> Configuration<&Record> {
        Configuration {
            settings: self.settings,
            record: self.record.as_ref(),
        }
    }
}

impl Configuration<&Record> {
    /// With a record of its own.
    pub fn cloned(self) -> Configuration {
        Configuration {
            settings: self.settings,
            record: self.record.cloned(),
        }
    }
}

/// The version of the format.
pub const VERSION: u8 = 1;

/// The most bytes of the settings' lines.
const MAX_LINES: usize = 512;

/// The most bytes of a configuration.
pub const MAX_ENCODED: usize = 3 + MAX_LINES + record::MAX_ENCODED;

/// Writes a configuration to the front of a buffer, and returns the bytes written. [`MAX_ENCODED`] bytes are
/// always enough.
///
/// # Errors
/// [`ConfigurationError::NoRoom`], or the record's error.
pub fn encode<'a>(
    configuration: &Configuration<&Record>,
    buffer: &'a mut [u8],
) -> Result<&'a [u8], ConfigurationError> {
    let no_room = ConfigurationError::NoRoom {
        bytes: buffer.len(),
    };
    let lines = lines(&configuration.settings).ok_or(no_room)?;
    let lines = lines.as_bytes();
    let (head, rest) = buffer.split_first_chunk_mut().ok_or(no_room)?;
    let length = u16::try_from(lines.len()).map_err(|_| no_room)?;
    let [low, high] = length.to_le_bytes();
    *head = [VERSION, low, high];
    let (place, rest) = rest.split_at_mut_checked(lines.len()).ok_or(no_room)?;
    place.copy_from_slice(lines);
    let record = match configuration.record {
        Some(record) => record::encode(record, rest)?.len(),
        None => 0,
    };
    let written = head.len().saturating_add(lines.len());
    buffer.get(..written.saturating_add(record)).ok_or(no_room)
}

/// The lines that set the settings. `None` if they do not fit; a test ensures that they do.
fn lines(settings: &Settings) -> Option<Text<MAX_LINES>> {
    let mut lines = Text::default();
    for &setting in Setting::ALL {
        let value = settings.get(setting);
        if value.is_saved() {
            writeln!(lines, "{}", value.stored()).ok()?;
        }
    }
    Some(lines)
}

/// Reads settings and calibration. A setting that the bytes do not name has its default.
///
/// # Errors
/// [`ConfigurationError`] says why the bytes cannot be used.
pub fn decode(bytes: &[u8]) -> Result<Configuration, ConfigurationError> {
    let (settings, record) = split(bytes)?;
    let record = match record {
        [] => None,
        record => Some(record::decode(record)?),
    };
    Ok(Configuration { settings, record })
}

/// Whether [`decode`] takes these bytes. Not inlined, so that it uses the stack only while it runs.
///
/// # Errors
/// As [`decode`].
#[inline(never)]
pub(super) fn check(bytes: &[u8]) -> Result<(), ConfigurationError> {
    match split(bytes)? {
        (_, []) => Ok(()),
        (_, record) => Ok(record::decode(record).map(|_| ())?),
    }
}

/// The settings, and the bytes of the record.
fn split(bytes: &[u8]) -> Result<(Settings, &[u8]), ConfigurationError> {
    let short = ConfigurationError::Short { bytes: bytes.len() };
    match *bytes {
        [VERSION, low, high, ref rest @ ..] => {
            let length = u16::from_le_bytes([low, high]);
            let (lines, record) = rest.split_at_checked(length.into()).ok_or(short)?;
            Ok((read_lines(lines)?, record))
        }
        [] | [VERSION] | [VERSION, _] => Err(short),
        [version, ..] => Err(ConfigurationError::Version { version }),
    }
}

/// Skips the lines of settings that this firmware does not know: later firmware has more.
fn read_lines(lines: &[u8]) -> Result<Settings, ConfigurationError> {
    let lines = core::str::from_utf8(lines).map_err(|_| ConfigurationError::NotText)?;
    let mut settings = Settings::default();
    for line in lines.lines() {
        let words = split_words(line);
        let Some((setting, values)) = Setting::of_words(&words) else {
            continue;
        };
        match setting.read(values) {
            Ok(value) => settings.set(value),
            Err(_) => return Err(ConfigurationError::Setting(setting)),
        }
    }
    Ok(settings)
}

/// Why bytes are not a configuration, or why a configuration cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ConfigurationError {
    /// The buffer is too short.
    #[error(
        "a buffer of {bytes} bytes is too short for settings and record: {MAX_ENCODED} are enough for any"
    )]
    NoRoom {
        /// Its length.
        bytes: usize,
    },
    /// Fewer bytes than the settings have.
    #[error("{bytes} bytes are too few for settings: save again")]
    Short {
        /// How many there are.
        bytes: usize,
    },
    /// The format is one that this firmware does not know.
    #[error(
        "the save has version {version}, this firmware reads {VERSION}: update the firmware, or upload, then \
         save"
    )]
    Version {
        /// The first byte.
        version: u8,
    },
    /// The settings' lines are not text.
    #[error("the saved settings are not text: save again")]
    NotText,
    /// A setting has a value that this firmware does not know.
    #[error("the saved value of {} is not {}: set it and save again", .0.name(), .0.form())]
    Setting(Setting),
    /// The record cannot be used.
    #[error(transparent)]
    Record(#[from] RecordError),
}

impl ConfigurationError {
    /// The version of the settings' or the record's format, if this firmware does not know that version.
    pub const fn later_version(self) -> Option<u8> {
        match self {
            Self::Version { version } | Self::Record(RecordError::Version { version }) => {
                Some(version)
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flash_holds_the_lines_that_a_person_would_type() {
        let written = Configuration {
            settings: Settings::default(),
            record: None,
        };
        let mut buffer = [0; MAX_ENCODED];
        let [VERSION, low, high, lines @ ..] =
            encode(&written.as_ref(), &mut buffer).expect("room")
        else {
            panic!("another version");
        };
        assert_eq!(usize::from(u16::from_le_bytes([*low, *high])), lines.len());
        let lines = std::str::from_utf8(lines).expect("text");
        for line in [
            "rows 16",
            "mean weighted",
            "black shielded",
            "estimator adaptive",
        ] {
            assert!(lines.lines().any(|it| it == line), "{lines}");
        }
        let has_stream = lines.contains("stream");
        assert!(!has_stream && lines.ends_with('\n'), "{lines}");
    }

    #[test]
    fn lines_of_later_firmware_are_skipped_and_missing_ones_are_defaults() {
        let found = decode(b"\x01\x19\x00of-later 200\nrows 7\nlamp\n").expect("settings");
        let settings = Settings {
            rows: 7,
            ..Settings::default()
        };
        assert_eq!((found.settings, found.record), (settings, None));
    }

    #[test]
    fn wrong_bytes_are_refused() {
        let (setting, version) = (ConfigurationError::Setting, 2);
        let short = |bytes| ConfigurationError::Short { bytes };
        for (bytes, error) in [
            (&b""[..], short(0)),
            (b"\x01", short(1)),
            (b"\x01\x07", short(2)),
            (b"\x01\x08\x00rows 1\n", short(10)),
            (b"\x01\x01\x00\xff", ConfigurationError::NotText),
            (b"\x01\x07\x00rows 0\n", setting(Setting::Rows)),
            (b"\x01\x09\x00rows 1 2\n", setting(Setting::Rows)),
            (b"\x01\x08\x00mean on\n", setting(Setting::Mean)),
            (b"\x02", ConfigurationError::Version { version }),
        ] {
            assert_eq!(decode(bytes), Err(error), "{bytes:?}");
        }
    }
}
