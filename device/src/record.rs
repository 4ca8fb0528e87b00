//! Encodes a calibration, with all that belongs to it, as bytes: for flash, for a file, for the serial line.
//!
//! ```text
//! format version | the record, by postcard | CRC-32 of all before it, little endian
//! 1 byte: 1      | up to 2134 bytes        | 4 bytes
//! ```
//!
//! The first byte and the CRC-32 stay where they are in every version, so that [`decode`] can tell a later
//! version from damage.
//!
//! The CRC-32 is ISO-HDLC, as in zip and PNG.
//!
//! [`decode`] makes a record with the constructors of its parts, and refuses what they refuse. The range of
//! distances is not in the bytes: it follows from the calibration and the range of its centres.

pub mod date;
pub mod encoded;

use crc::{CRC_32_ISO_HDLC, Crc};
use heapless::Vec;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use date::Date;
use slitrange::check::own_spot::Profile;
use slitrange::distance::eq1::{Eq1, Eq1Error};
use slitrange::distance::knots::{Knot, Knots, MAX_KNOTS};
use slitrange::distance::residuals::{Corrected, CorrectedError};
use slitrange::distance::table::{Table, TableError};
use slitrange::frame::comb::{Comb, CombError, Slits};
use slitrange::row::front_end::FrontEnd;
use slitrange::row::{Geometry, LARGEST_COUNT, MAX_PIXELS, Polarity};
use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Counts, Estimator, Micrometres, Pixels,
    sensor_heads,
};

/// A sensor's calibration, and the sensor, day and settings that it belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// The sensor's serial number.
    pub serial_number: u32,
    /// The day on which it was calibrated.
    pub date: Date,
    /// The rows of the sensor. Other sensors may use the record if their geometry
    /// [is compatible](Geometry::is_compatible_with).
    pub geometry: Geometry,
    /// How centres were found. On a spot that is no gaussian, two estimators may find two centres.
    pub estimator: Estimator,
    /// How the black level was found; if it was fixed, at which level.
    pub black_level: BlackLevel,
    /// The distance for each centre.
    pub calibration: Calibration,
    /// The uncertainties of the calibration, if a fit found them.
    pub errors: CalibrationErrors,
    /// The sensor's own spot, if the calibration learned it.
    pub profile: Option<Profile>,
    /// The slits, if the sensor has a comb.
    pub comb: Option<Comb>,
    /// The front end, if it was measured.
    pub front_end: Option<FrontEnd>,
}

/// The version of the format.
pub const VERSION: u8 = 1;

/// The longest record in bytes: eq. (1) with [`MAX_KNOTS`] residuals, the uncertainties of a fit, the
/// sensor's own spot, 16 slits and the front end, each number at its longest.
pub const MAX_ENCODED: usize = 2139;

/// Computed bit by bit, without a table: a record is read once at the start.
const CRC: Crc<u32, crc::Table<0>> = Crc::<u32, crc::Table<0>>::new(&CRC_32_ISO_HDLC);

/// Writes a record to the front of a buffer and gives the bytes written. [`MAX_ENCODED`] bytes are enough for
/// any record.
///
/// # Errors
/// [`RecordError::NoRoom`], or the error with which [`decode`] would refuse the record.
pub fn encode<'a>(record: &Record, buffer: &'a mut [u8]) -> Result<&'a [u8], RecordError> {
    record.check()?;
    let fields = Fields::of(record)?;
    let no_room = RecordError::NoRoom {
        bytes: buffer.len(),
    };
    let (version, rest) = buffer.split_first_mut().ok_or(no_room)?;
    *version = VERSION;
    let fields = postcard::to_slice(&fields, rest).map_err(|_| no_room)?;
    let fields = fields.len();
    let rest = rest.get_mut(fields..).ok_or(no_room)?;
    let after = (
        &record.errors,
        &record.profile,
        &record.comb,
        &record.front_end,
    );
    let after = postcard::to_slice(&after, rest).map_err(|_| no_room)?.len();
    let summed = fields.saturating_add(after).saturating_add(1);
    let (before, after) = buffer.split_at_mut_checked(summed).ok_or(no_room)?;
    *after.first_chunk_mut().ok_or(no_room)? = CRC.checksum(before).to_le_bytes();
    buffer.get(..summed.saturating_add(SUM)).ok_or(no_room)
}

/// Shows a record's bytes to a function: none if [`encode`] refuses the record. Not inlined, so that the
/// bytes are on the stack only meanwhile.
#[inline(never)]
pub fn with_bytes<T>(record: &Record, show: impl FnOnce(&[u8]) -> T) -> T {
    show(encode(record, &mut [0; MAX_ENCODED]).unwrap_or_default())
}

/// The CRC-32 at the end of a record's bytes.
pub fn sum(record: &Record) -> u32 {
    with_bytes(record, sum_of)
}

/// The CRC-32 at the end of these bytes of a record.
pub fn sum_of(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes.last_chunk().copied().unwrap_or_default())
}

/// Bytes of the CRC.
const SUM: usize = size_of::<u32>();

/// Reads a record.
///
/// # Errors
/// [`RecordError`] says why the bytes cannot be used.
pub fn decode(bytes: &[u8]) -> Result<Record, RecordError> {
    let short = RecordError::Short { bytes: bytes.len() };
    let (before, sum) = bytes.split_last_chunk().ok_or(short)?;
    let (written, computed) = (u32::from_le_bytes(*sum), CRC.checksum(before));
    if written != computed {
        return Err(RecordError::Checksum { written, computed });
    }
    let (&version, body) = before.split_first().ok_or(short)?;
    if version != VERSION {
        return Err(RecordError::Version { version });
    }
    match &Fields::read(body) {
        Ok((fields, rest)) => fields.record(AfterFields::read(rest)?),
        Err(error) => Err(*error),
    }
}

/// The uncertainties, the sensor's own spot, the slits and the front end, which follow the fields.
#[derive(Deserialize)]
struct AfterFields {
    errors: CalibrationErrors,
    profile: Option<Profile>,
    comb: Option<Comb>,
    front_end: Option<FrontEnd>,
}

impl AfterFields {
    #[inline(never)]
    fn read(rest: &[u8]) -> Result<Self, RecordError> {
        match postcard::take_from_bytes(rest) {
            Ok((after, [])) => Ok(after),
            _ => Err(RecordError::Shape),
        }
    }
}

impl Record {
    /// The record of the nominal calibration, which holds until a sensor has its own. Its serial number is 0,
    /// its day the first of the calendar.
    pub fn nominal() -> Option<Self> {
        Some(Self {
            serial_number: 0,
            date: Date::NEVER,
            geometry: sensor_heads::tcd1304dg(),
            estimator: Estimator::default(),
            black_level: BlackLevel::Shielded,
            calibration: Calibration::nominal()?,
            errors: CalibrationErrors::Nominal,
            profile: None,
            comb: None,
            front_end: None,
        })
    }

    /// What is before the sensor.
    pub const fn slits(&self) -> Slits {
        match self.comb {
            None => Slits::One,
            Some(_) => Slits::Comb,
        }
    }

    /// Whether the calibration is the nominal one. The front end may be measured or not.
    pub fn is_nominal(&self) -> bool {
        let nominal = Self::nominal().map(|nominal| Self {
            front_end: self.front_end,
            ..nominal
        });
        nominal.as_ref() == Some(self)
    }

    /// Whether the calibration is the nominal one and nobody measured the front end.
    pub fn is_of_factory(&self) -> bool {
        self.front_end.is_none() && self.is_nominal()
    }

    /// Checks what the types of the parts do not ensure.
    fn check(&self) -> Result<(), RecordError> {
        let (words, light) = (self.geometry.words, &self.geometry.light);
        let sensible = |part: &core::ops::Range<usize>| {
            part.start <= part.end && part.end <= words && part.len() <= MAX_PIXELS
        };
        let are_sensible = sensible(&self.geometry.shielded) && sensible(light);
        if !are_sensible || light.is_empty() || !matches!(self.geometry.bits, 1..=12) {
            return Err(RecordError::Geometry);
        }
        if let BlackLevel::Fixed(level) = self.black_level
            && !(0..=i32::from(LARGEST_COUNT) * (1 << Counts::FRACTION)).contains(&level.to_bits())
        {
            return Err(RecordError::BlackLevel { level });
        }
        // Pixel 0 begins half a pixel before 0.
        const HALF: i32 = 1 << (Pixels::FRACTION - 1);
        let end = Pixels::from_int(i32::try_from(light.len()).unwrap_or(i32::MAX));
        let end = end.to_bits().saturating_sub(HALF);
        let (first, last) = self.calibration.valid();
        if first.to_bits() < -HALF || last.to_bits() > end {
            return Err(RecordError::OffTheSensor { first, last });
        }
        let is_sensible = self.profile.as_ref().is_none_or(Profile::is_sensible);
        if !self.errors.are_sensible() || !is_sensible {
            return Err(RecordError::Errors);
        }
        if (self.front_end.as_ref()).is_some_and(|front_end| !front_end.is_sensible()) {
            return Err(RecordError::FrontEnd);
        }
        match &self.comb {
            None => Ok(()),
            Some(comb) => comb.check().map_err(RecordError::Comb),
        }
    }
}

/// The fields of a record in the order of its bytes; [`Record::errors`] follows. A change of this type
/// changes the format: it needs a new [`VERSION`].
#[derive(Serialize, Deserialize)]
struct Fields {
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
    /// The estimator's letter.
    estimator: u8,
    #[serde(with = "BlackLevelFields")]
    black_level: BlackLevel,
    calibration: CalibrationFields,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "BlackLevel")]
enum BlackLevelFields {
    Fixed(Counts),
    Shielded,
    Frame,
}

#[derive(Serialize, Deserialize)]
enum CalibrationFields {
    Eq1(Eq1Fields),
    Table(KnotsFields),
    Corrected(Eq1Fields, KnotsFields),
}

#[derive(Serialize, Deserialize)]
struct Eq1Fields {
    d: Micrometres,
    k: i64,
    pole: Pixels,
    first: Pixels,
    last: Pixels,
}

#[derive(Serialize, Deserialize)]
struct KnotsFields(Vec<Knot, MAX_KNOTS>);

impl Fields {
    fn of(record: &Record) -> Result<Self, RecordError> {
        let geometry = &record.geometry;
        let (year, month, day) = record.date.parts();
        let word = |index: usize| u16::try_from(index).map_err(|_| RecordError::Geometry);
        Ok(Self {
            serial_number: record.serial_number,
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
            black_level: record.black_level,
            calibration: match &record.calibration {
                Calibration::Eq1(curve) => CalibrationFields::Eq1(Eq1Fields::of(curve)),
                Calibration::Table(table) => {
                    CalibrationFields::Table(KnotsFields::of(table.knots()))
                }
                Calibration::Corrected(corrected) => CalibrationFields::Corrected(
                    Eq1Fields::of(corrected.curve()),
                    KnotsFields::of(corrected.residuals()),
                ),
            },
        })
    }

    /// Reads the fields. This function and those that make a calibration of the fields each move kilobytes.
    /// They are not inlined, so that their copies are not all on the chip's stack at once.
    #[inline(never)]
    fn read(body: &[u8]) -> Result<(Self, &[u8]), RecordError> {
        postcard::take_from_bytes(body).map_err(|_| RecordError::Shape)
    }

    /// Makes the record with the constructors of its parts.
    #[inline(never)]
    fn record(&self, after: AfterFields) -> Result<Record, RecordError> {
        let letter = self.estimator;
        let estimator = (Estimator::ALL.into_iter()).find(|it| it.letter() == char::from(letter));
        let estimator = estimator.ok_or(RecordError::Estimator { letter })?;
        let range = |(start, end): (u16, u16)| usize::from(start)..usize::from(end);
        let record = Record {
            serial_number: self.serial_number,
            date: Date::new(self.year, self.month, self.day).ok_or(RecordError::Date)?,
            geometry: Geometry {
                words: usize::from(self.words),
                shielded: range(self.shielded),
                light: range(self.light),
                polarity: match self.falling {
                    true => Polarity::Falling,
                    false => Polarity::Rising,
                },
                bits: self.bits,
                shot_variance_per_count_q16: self.shot_variance_per_count_q16,
                // The record does not hold the saturation. This means full scale.
                saturation: LARGEST_COUNT,
            },
            estimator,
            black_level: self.black_level,
            calibration: self.calibration.calibration()?,
            errors: after.errors,
            profile: after.profile,
            comb: after.comb,
            front_end: after.front_end,
        };
        record.check()?;
        Ok(record)
    }
}

impl CalibrationFields {
    #[inline(never)]
    fn calibration(&self) -> Result<Calibration, RecordError> {
        match self {
            Self::Eq1(curve) => Ok(Calibration::Eq1(curve.eq1()?)),
            Self::Table(knots) => knots.table(),
            Self::Corrected(curve, residuals) => residuals.corrected(curve),
        }
    }
}

impl Eq1Fields {
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

impl KnotsFields {
    fn of(knots: &Knots) -> Self {
        let mut fields = Vec::new();
        for knot in knots.iter() {
            // There is room for all. Collecting would bring a panic for the case that there is not.
            let _ = fields.push(knot);
        }
        Self(fields)
    }

    #[inline(never)]
    fn table(&self) -> Result<Calibration, RecordError> {
        match Table::new(&self.0) {
            Ok(table) => Ok(Calibration::Table(table)),
            Err(error) => Err(RecordError::Table(error)),
        }
    }

    #[inline(never)]
    fn corrected(&self, curve: &Eq1Fields) -> Result<Calibration, RecordError> {
        match Corrected::new(curve.eq1()?, &self.0) {
            Ok(corrected) => Ok(Calibration::Corrected(corrected)),
            Err(error) => Err(RecordError::Corrected(error)),
        }
    }
}

/// Why bytes are not a record, or why a record cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum RecordError {
    /// The buffer is too short for the record.
    #[error(
        "a buffer of {bytes} bytes is too short for the record: {MAX_ENCODED} are enough for any"
    )]
    NoRoom {
        /// The length of the buffer.
        bytes: usize,
    },
    /// Fewer bytes than any record has.
    #[error("{bytes} bytes are too few for a record: write the calibration again")]
    Short {
        /// How many there are.
        bytes: usize,
    },
    /// The CRC at the end does not fit the bytes before it.
    #[error(
        "the record is damaged, its CRC is {written:08x} and not {computed:08x}: write the calibration again"
    )]
    Checksum {
        /// The CRC at the end.
        written: u32,
        /// The CRC of the bytes before it.
        computed: u32,
    },
    /// The CRC is right, but this firmware does not know the format.
    #[error(
        "the record has version {version}, this firmware or tool reads {VERSION}: update both, or \
         calibrate again"
    )]
    Version {
        /// The format, which is the first byte.
        version: u8,
    },
    /// The CRC is right, but the bytes are not those of a record.
    #[error(
        "the CRC is right, but the bytes are not a record: write the calibration with the tool \
         of this firmware"
    )]
    Shape,
    /// The calendar has no such day.
    #[error("the record's date is not a day of the calendar: set the date")]
    Date,
    /// A part of the row reaches beyond the row, there are too many pixels or none, or the converter does not
    /// have 1 to 12 bits.
    #[error(
        "the record's sensor is impossible: its parts must lie within a row, with 1 to 4096 pixels of 1 \
         to 12 bits"
    )]
    Geometry,
    /// This firmware has no such estimator.
    #[error(
        "the record was made with estimator '{}', which this firmware does not know: calibrate anew",
        .letter.escape_ascii()
    )]
    Estimator {
        /// Its letter.
        letter: u8,
    },
    /// A black level outside a pixel's range.
    #[error(
        "the record's black level of {level} counts is outside a pixel's range: set it to 0 to \
         {LARGEST_COUNT}"
    )]
    BlackLevel {
        /// That level.
        level: Counts,
    },
    /// The numbers of eq. (1) cannot be used.
    #[error(transparent)]
    Eq1(Eq1Error),
    /// The knots of a table cannot be used.
    #[error(transparent)]
    Table(TableError),
    /// The residuals, or the curve below them, cannot be used.
    #[error(transparent)]
    Corrected(CorrectedError),
    /// An uncertainty below zero, or a usual height of the spot that is not above zero.
    #[error("the record's uncertainties are impossible: fit again from the points file")]
    Errors,
    /// The comb cannot be used.
    #[error(transparent)]
    Comb(CombError),
    /// A number of the front end is outside its range.
    #[error("the record's front end is impossible: measure it again (slitrange head measure)")]
    FrontEnd,
    /// The range of centres reaches beyond the sensor's pixels.
    #[error(
        "the record's centres, {first:.1} to {last:.1} px, reach beyond the sensor: take a smaller range"
    )]
    OffTheSensor {
        /// The first centre.
        first: Pixels,
        /// The last centre.
        last: Pixels,
    },
}
