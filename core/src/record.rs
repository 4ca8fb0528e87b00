//! What is kept of a calibration, as bytes: for flash, for a file, for the serial line.
//!
//! ```text
//! format version | postcard of the record | CRC-32 (ISO-HDLC, as in zip and PNG) of all before it, little endian
//! 1 byte         | up to 2636 bytes       | 4 bytes
//! ```
//!
//! A record that is read is made anew by the constructors of its parts: what they refuse, [`decode`] does. What the sensor's
//! distances range over is not written: it is what the calibration gives at the ends of its centres.

pub mod date;
pub mod encoded;

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc};
use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::black_level::BlackLevel;
use crate::centre::Estimator;
use crate::distance::Calibration;
use crate::distance::eq1::{Eq1, Eq1Error};
use crate::distance::knots::{Interpolation, Knot, Knots, MAX_CUBIC, MAX_LINEAR};
use crate::distance::residuals::{Corrected, CorrectedError};
use crate::distance::table::{Table, TableError};
use crate::row::{Geometry, LARGEST_COUNT, MAX_PIXELS, Polarity};
use crate::sensor_heads;
use crate::units::{Counts, Micrometres, Pixels};
use date::Date;

/// A sensor's calibration, with what it holds for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// The sensor's serial number.
    pub serial_number: u32,
    /// The day on which it was calibrated.
    pub date: Date,
    /// What its rows are.
    pub geometry: Geometry,
    /// How centres were found, and so with which profile and which width tables: another way finds the same spot elsewhere,
    /// where its profile is another.
    pub estimator: Estimator,
    /// How the black level was found; where it was fixed, at what.
    pub black_level: BlackLevel,
    /// What the centres mean.
    pub calibration: Calibration,
}

/// The format that is written and read.
pub const VERSION: u8 = 1;

/// The longest record in bytes: eq. (1) with 257 residuals, each number at its longest.
pub const MAX_ENCODED: usize = 2641;

/// Without a table of its own: a record is read once at the start.
const CRC: Crc<u32, crc::Table<0>> = Crc::<u32, crc::Table<0>>::new(&CRC_32_ISO_HDLC);

/// Writes a record to the front of a buffer, which [`MAX_ENCODED`] bytes are always enough for, and gives what was written.
///
/// # Errors
/// [`RecordError::NoRoom`], or what [`decode`] would say of the record.
pub fn encode<'a>(record: &Record, buffer: &'a mut [u8]) -> Result<&'a [u8], RecordError> {
    record.check()?;
    let stored = FlashStatus::of(record)?;
    let no_room = RecordError::NoRoom {
        bytes: buffer.len(),
    };
    let (version, rest) = buffer.split_first_mut().ok_or(no_room)?;
    *version = VERSION;
    let body = postcard::to_slice(&stored, rest).map_err(|_| no_room)?;
    let summed = body.len().saturating_add(1);
    let (before, after) = buffer.split_at_mut_checked(summed).ok_or(no_room)?;
    let sum = after.first_chunk_mut().ok_or(no_room)?;
    *sum = CRC.checksum(before).to_le_bytes();
    buffer.get(..summed.saturating_add(SUM)).ok_or(no_room)
}

/// Bytes of the CRC.
const SUM: usize = size_of::<u32>();

/// Reads a record.
///
/// # Errors
/// [`RecordError`] says why the bytes are none that could be used.
pub fn decode(bytes: &[u8]) -> Result<Record, RecordError> {
    let (before, sum) = bytes
        .split_last_chunk()
        .ok_or(RecordError::Short { bytes: bytes.len() })?;
    let (written, computed) = (u32::from_le_bytes(*sum), CRC.checksum(before));
    if written != computed {
        return Err(RecordError::Checksum { written, computed });
    }
    let (&version, body) = before
        .split_first()
        .ok_or(RecordError::Short { bytes: bytes.len() })?;
    if version != VERSION {
        return Err(RecordError::Version { version });
    }
    match &FlashStatus::read(body) {
        Ok(stored) => stored.record(),
        Err(error) => Err(*error),
    }
}

impl Record {
    /// That of the nominal calibration, which holds until a sensor has its own: of no serial number and no day, which are 0 and
    /// the first of all.
    pub fn nominal() -> Option<Self> {
        Some(Self {
            serial_number: 0,
            date: Date::new(1, 1, 1)?,
            geometry: sensor_heads::tcd1304dg(),
            estimator: Estimator::default(),
            black_level: BlackLevel::Shielded,
            calibration: Calibration::nominal()?,
        })
    }

    /// Whether it is that one.
    pub fn is_nominal(&self) -> bool {
        Self::nominal().as_ref() == Some(self)
    }

    /// What the types of its parts leave open.
    fn check(&self) -> Result<(), RecordError> {
        let Geometry {
            words,
            shielded,
            light,
            bits,
            ..
        } = &self.geometry;
        let sensible = |part: &core::ops::Range<usize>| {
            part.start <= part.end && part.end <= *words && part.len() <= MAX_PIXELS
        };
        if !sensible(shielded) || !sensible(light) || light.is_empty() || !matches!(bits, 1..=12) {
            return Err(RecordError::Geometry);
        }
        if let BlackLevel::Fixed(level) = self.black_level
            && !(0..=i32::from(LARGEST_COUNT) * (1 << Counts::FRACTION)).contains(&level.to_bits())
        {
            return Err(RecordError::BlackLevel { level });
        }
        // Pixel 0 begins half a pixel before 0.
        const HALF: i32 = 1 << (Pixels::FRACTION - 1);
        let end = Pixels::from_int(light.len() as i32)
            .to_bits()
            .saturating_sub(HALF);
        let (first, last) = self.calibration.valid();
        if first.to_bits() < -HALF || last.to_bits() > end {
            return Err(RecordError::OffTheSensor { first, last });
        }
        Ok(())
    }
}

/// A record as it is written. It keeps its shape when the core's types change theirs, or [`VERSION`] counts on.
#[derive(Serialize, Deserialize)]
struct FlashStatus {
    serial_number: u32,
    year: u16,
    month: u8,
    day: u8,
    words: u16,
    shielded: (u16, u16),
    light: (u16, u16),
    falling: bool,
    bits: u8,
    shot_variance_per_count_q16: u16,
    /// Its letter.
    estimator: u8,
    black_level: StoredBlackLevel,
    calibration: StoredCalibration,
}

#[derive(Serialize, Deserialize)]
enum StoredBlackLevel {
    Fixed(Counts),
    Shielded,
    Frame,
}

#[derive(Serialize, Deserialize)]
enum StoredCalibration {
    Eq1(StoredEq1),
    Table(StoredKnots),
    Corrected(StoredEq1, StoredKnots),
}

#[derive(Serialize, Deserialize)]
struct StoredEq1 {
    d: Micrometres,
    k: i64,
    pole: Pixels,
    first: Pixels,
    last: Pixels,
}

#[derive(Serialize, Deserialize)]
struct StoredKnots {
    interpolation: Interpolation,
    knots: Vec<Knot, MAX_LINEAR>,
}

// Knots of either kind have room.
const _: () = assert!(MAX_CUBIC <= MAX_LINEAR);

impl FlashStatus {
    fn of(record: &Record) -> Result<Self, RecordError> {
        let Record {
            serial_number,
            geometry,
            ..
        } = record;
        let (year, month, day) = record.date.parts();
        let word = |index: usize| u16::try_from(index).map_err(|_| RecordError::Geometry);
        Ok(Self {
            serial_number: *serial_number,
            year,
            month,
            day,
            words: word(geometry.words)?,
            shielded: (word(geometry.shielded.start)?, word(geometry.shielded.end)?),
            light: (word(geometry.light.start)?, word(geometry.light.end)?),
            falling: geometry.polarity == Polarity::Falling,
            bits: geometry.bits,
            shot_variance_per_count_q16: geometry.shot_variance_per_count_q16,
            // An ASCII letter.
            estimator: record.estimator.letter() as u8,
            black_level: match record.black_level {
                BlackLevel::Fixed(level) => StoredBlackLevel::Fixed(level),
                BlackLevel::Shielded => StoredBlackLevel::Shielded,
                BlackLevel::Frame => StoredBlackLevel::Frame,
            },
            calibration: match &record.calibration {
                Calibration::Eq1(curve) => StoredCalibration::Eq1(StoredEq1::of(curve)),
                Calibration::Table(table) => {
                    StoredCalibration::Table(StoredKnots::of(table.knots()))
                }
                Calibration::Corrected(corrected) => StoredCalibration::Corrected(
                    StoredEq1::of(corrected.curve()),
                    StoredKnots::of(corrected.residuals()),
                ),
            },
        })
    }

    /// Not inlined, as what makes a calibration of it: each moves kilobytes, which would all be on the chip's stack at once.
    #[inline(never)]
    fn read(body: &[u8]) -> Result<Self, RecordError> {
        match postcard::take_from_bytes(body) {
            Ok((stored, [])) => Ok(stored),
            _ => Err(RecordError::Shape),
        }
    }

    /// Made anew, as far as it can be used.
    #[inline(never)]
    fn record(&self) -> Result<Record, RecordError> {
        let estimator = Estimator::ALL
            .into_iter()
            .find(|estimator| estimator.letter() == char::from(self.estimator))
            .ok_or(RecordError::Estimator {
                letter: self.estimator,
            })?;
        let range = |(start, end): (u16, u16)| usize::from(start)..usize::from(end);
        let record = Record {
            serial_number: self.serial_number,
            date: Date::new(self.year, self.month, self.day).ok_or(RecordError::Date)?,
            geometry: Geometry {
                words: usize::from(self.words),
                shielded: range(self.shielded),
                light: range(self.light),
                polarity: if self.falling {
                    Polarity::Falling
                } else {
                    Polarity::Rising
                },
                bits: self.bits,
                shot_variance_per_count_q16: self.shot_variance_per_count_q16,
            },
            estimator,
            black_level: match self.black_level {
                StoredBlackLevel::Fixed(level) => BlackLevel::Fixed(level),
                StoredBlackLevel::Shielded => BlackLevel::Shielded,
                StoredBlackLevel::Frame => BlackLevel::Frame,
            },
            calibration: self.calibration.calibration()?,
        };
        record.check()?;
        Ok(record)
    }
}

impl StoredCalibration {
    #[inline(never)]
    fn calibration(&self) -> Result<Calibration, RecordError> {
        match self {
            Self::Eq1(curve) => Ok(Calibration::Eq1(curve.eq1()?)),
            Self::Table(stored) => stored.table(),
            Self::Corrected(curve, stored) => stored.corrected(curve),
        }
    }
}

impl StoredEq1 {
    fn of(curve: &Eq1) -> Self {
        let (first, last) = curve.valid();
        Self {
            d: curve.d(),
            k: curve.k(),
            pole: curve.pole(),
            first,
            last,
        }
    }

    fn eq1(&self) -> Result<Eq1, RecordError> {
        Eq1::new(self.d, self.k, self.pole, self.first..=self.last).map_err(RecordError::Eq1)
    }
}

impl StoredKnots {
    fn of(knots: &Knots) -> Self {
        let mut stored = Self {
            interpolation: knots.interpolation(),
            knots: Vec::new(),
        };
        for knot in knots.iter() {
            // There is room for all. Collecting would bring a panic for the case that there is not.
            let _ = stored.knots.push(knot);
        }
        stored
    }

    #[inline(never)]
    fn table(&self) -> Result<Calibration, RecordError> {
        match Table::new(self.interpolation, &self.knots) {
            Ok(table) => Ok(Calibration::Table(table)),
            Err(error) => Err(RecordError::Table(error)),
        }
    }

    #[inline(never)]
    fn corrected(&self, curve: &StoredEq1) -> Result<Calibration, RecordError> {
        match Corrected::new(curve.eq1()?, self.interpolation, &self.knots) {
            Ok(corrected) => Ok(Calibration::Corrected(corrected)),
            Err(error) => Err(RecordError::Corrected(error)),
        }
    }
}

/// Why bytes are no record, or a record cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordError {
    /// The buffer is too short for the record.
    NoRoom {
        /// What it holds.
        bytes: usize,
    },
    /// Fewer bytes than any record has.
    Short {
        /// How many there are.
        bytes: usize,
    },
    /// The CRC is not that of the bytes.
    Checksum {
        /// What stands at the end.
        written: u32,
        /// What the bytes give.
        computed: u32,
    },
    /// The CRC is right, but the format is one that this firmware does not know.
    Version {
        /// What the first byte says.
        version: u8,
    },
    /// The CRC is right, but the bytes are not those of a record.
    Shape,
    /// There is no such day.
    Date,
    /// The parts of a row do not lie within it, there are too many pixels or none, or the converter has not 1 to 12 bits.
    Geometry,
    /// There is no such estimator.
    Estimator {
        /// Its letter.
        letter: u8,
    },
    /// A black level that no pixel has.
    BlackLevel {
        /// That level.
        level: Counts,
    },
    /// Numbers that are no eq. (1).
    Eq1(Eq1Error),
    /// Knots that are no table.
    Table(TableError),
    /// Residuals that do not go with their curve.
    Corrected(CorrectedError),
    /// The calibration ranges over centres that the sensor cannot have.
    OffTheSensor {
        /// The first centre.
        first: Pixels,
        /// The last centre.
        last: Pixels,
    },
}

impl fmt::Display for RecordError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRoom { bytes } => write!(
                f,
                "a buffer of {bytes} bytes is too short for the record: {MAX_ENCODED} are enough for any"
            ),
            Self::Short { bytes } => {
                write!(f, "{bytes} bytes are no record: write the calibration again")
            }
            Self::Checksum { written, computed } => write!(
                f,
                "the record is damaged, its CRC is {written:08x} and not {computed:08x}: write the calibration again"
            ),
            Self::Version { version } => write!(
                f,
                "the record has format {version}, and this firmware knows {VERSION}: write it with the tool of this firmware"
            ),
            Self::Shape => f.write_str(
                "the bytes are whole but no record: write the calibration with the tool of this firmware",
            ),
            Self::Date => f.write_str("the record's date is no day: set it"),
            Self::Geometry => f.write_str(
                "the record's sensor is none that there could be: its parts must lie within a row, with 1 to 4096 pixels of \
                 1 to 12 bits",
            ),
            Self::Estimator { letter } => write!(
                f,
                "the record was made with estimator '{}', which this firmware does not know: calibrate anew",
                letter.escape_ascii()
            ),
            Self::BlackLevel { level } => write!(
                f,
                "the record's black level of {level} counts is none that a pixel has: it must be 0 to {LARGEST_COUNT}"
            ),
            Self::Eq1(error) => error.fmt(f),
            Self::Table(error) => error.fmt(f),
            Self::Corrected(error) => error.fmt(f),
            Self::OffTheSensor { first, last } => write!(
                f,
                "the record's centres, {first:.1} to {last:.1} px, reach beyond the sensor: take a smaller range"
            ),
        }
    }
}

impl core::error::Error for RecordError {}
