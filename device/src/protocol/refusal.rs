//! Refusals: why a command that was understood is not executed. Their numbers follow those of
//! [`super::command::Error`].

use core::fmt;

use crate::record::RecordError;
use crate::store::StoreError;
use slitrange::row::pixels::flat_field::TakeError;
use slitrange::spot::region::Region;

/// Why a command is not executed. Nothing has changed. `Display` is the answer, without its line end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// No upload is under way.
    NoUpload,
    /// A piece that is not the next one.
    WrongOffset {
        /// Where the piece begins.
        offset: usize,
        /// Where the next piece begins.
        expected: usize,
    },
    /// A piece that reaches beyond the record.
    TooLong {
        /// Where the piece ends.
        end: usize,
        /// How many bytes were announced.
        announced: usize,
    },
    /// The record is not complete.
    Incomplete {
        /// How many bytes came.
        came: usize,
        /// How many were announced.
        announced: usize,
    },
    /// The bytes are not a record that can be used.
    Record(RecordError),
    /// The record was made with a sensor head that has other rows.
    OtherSensor,
    /// The record in use has no byte at that offset.
    NoPiece {
        /// The offset.
        offset: u16,
        /// How many bytes the record has.
        bytes: usize,
    },
    /// There is no calibration.
    NoCalibration {
        /// Whether `defaults` brings the nominal one.
        has_nominal: bool,
    },
    /// The configuration could not be saved.
    NotSaved(StoreError),
    /// Flash holds a calibration, and `save` would replace it by the nominal one.
    WouldReplace,
    /// `save nominal`, and the calibration in use is not the nominal one.
    NotNominal,
    /// There is no map of the pixels.
    NoMap,
    /// The rows make no map.
    NotTaken(TakeError),
    /// The map could not be saved or erased.
    MapNotSaved(StoreError),
    /// A region has too few of the sensor's pixels.
    OffRow {
        /// The region.
        region: Region,
        /// How many pixels see light.
        pixels: usize,
    },
    /// The value of `master` is too large.
    MasterRange,
    /// `measure`, and each frame starts at the end of the one before.
    NotTriggered,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoUpload => f.write_str("E8 no upload under way: calibration begin BYTES first"),
            Self::WrongOffset { offset, expected } => {
                write!(f, "E9 offset {offset}, expected {expected}: go on from there")
            }
            Self::TooLong { end, announced } => write!(
                f,
                "E10 the piece ends at {end}, the record at {announced}: calibration begin with its length"
            ),
            Self::Incomplete { came, announced } => write!(
                f,
                "E11 {came} of {announced} bytes came: go on from there, or calibration abort"
            ),
            Self::Record(error) => write!(f, "E12 {error}"),
            Self::OtherSensor => f.write_str(
                "E13 the record is of another sensor head: calibrate this one, or take its own record",
            ),
            Self::NoPiece { offset, bytes } => {
                write!(f, "E14 offset {offset}, but the record has {bytes} bytes")
            }
            Self::NoCalibration { has_nominal } => f.write_str(if *has_nominal {
                "E15 there is no calibration: upload one, or defaults"
            } else {
                "E15 there is no calibration: calibrate this sensor and upload the record; defaults has none"
            }),
            Self::NotSaved(error) => write!(f, "E16 not saved: {error}"),
            Self::WouldReplace => f.write_str(
                "E17 save would replace the stored calibration by the nominal one: save nominal does so",
            ),
            Self::NotNominal => {
                f.write_str("E18 the calibration in use is not the nominal one: save, or defaults first")
            }
            Self::NoMap => f.write_str("E19 there is no map of the pixels: flat dark, then flat lit"),
            Self::NotTaken(error) => write!(f, "E20 {error}"),
            Self::MapNotSaved(_) => f.write_str(
                "E21 the flash does not hold what was written or erased: try again; if that does not help, \
                 replace the sensor's board",
            ),
            Self::OffRow { region, pixels } => write!(
                f,
                "E22 region {} {}, but the sensor has {pixels} pixels: take {} of them or more",
                region.first(),
                region.last(),
                Region::FEWEST
            ),
            Self::MasterRange => f.write_str(
                "E23 out of range, expected master -4000..4000 mm, or -4000000..4000000 with units um",
            ),
            Self::NotTriggered => {
                f.write_str("E24 frames start by themselves: send distance, or trigger serial before measure")
            }
        }
    }
}

impl core::error::Error for Refusal {}
