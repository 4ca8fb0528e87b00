//! Refusals: why a command that was understood is not executed. Their numbers follow those of
//! [`super::command::Error`].

use thiserror::Error;

use crate::record::RecordError;
use crate::store::StoreError;
use slitrange::row::pixels::flat_field::TakeError;
use slitrange::spot::region::Region;

/// Why a command is not executed. Nothing has changed. `Display` is the answer, without its line end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Refusal {
    /// No upload is under way.
    #[error("E8 no upload under way: calibration begin BYTES first")]
    NoUpload,
    /// A piece that is not the next one.
    #[error("E9 offset {offset}, expected {expected}: go on from there")]
    WrongOffset {
        /// Where the piece begins.
        offset: usize,
        /// Where the next piece begins.
        expected: usize,
    },
    /// A piece that reaches beyond the record.
    #[error(
        "E10 the piece ends at {end}, the record at {announced}: calibration begin with its length"
    )]
    TooLong {
        /// Where the piece ends.
        end: usize,
        /// How many bytes were announced.
        announced: usize,
    },
    /// The record is not complete.
    #[error("E11 {came} of {announced} bytes came: go on from there, or calibration abort")]
    Incomplete {
        /// How many bytes came.
        came: usize,
        /// How many were announced.
        announced: usize,
    },
    /// The bytes are not a record that can be used.
    #[error("E12 {0}")]
    Record(RecordError),
    /// The record was made with a sensor head that has other rows.
    #[error("E13 the record is of another sensor head: calibrate this one, or take its own record")]
    OtherSensor,
    /// The record in use has no byte at that offset.
    #[error("E14 offset {offset}, but the record has {bytes} bytes")]
    NoPiece {
        /// The offset.
        offset: u16,
        /// How many bytes the record has.
        bytes: usize,
    },
    /// There is no calibration.
    #[error("E15 there is no calibration: {}", match .has_nominal {
        true => "upload one, or defaults",
        false => "calibrate this sensor and upload the record; defaults has none",
    })]
    NoCalibration {
        /// Whether `defaults` brings the nominal one.
        has_nominal: bool,
    },
    /// The configuration could not be saved.
    #[error("E16 not saved: {0}")]
    NotSaved(StoreError),
    /// Flash holds a calibration, and `save` would replace it by the nominal one.
    #[error(
        "E17 save would replace the stored calibration by the nominal one: save nominal does so"
    )]
    WouldReplace,
    /// `save nominal`, and the calibration in use is not the nominal one.
    #[error("E18 the calibration in use is not the nominal one: save, or defaults first")]
    NotNominal,
    /// There is no map of the pixels.
    #[error("E19 there is no map of the pixels: flat dark, then flat lit")]
    NoMap,
    /// The rows make no map.
    #[error("E20 {0}")]
    NotTaken(TakeError),
    /// The map could not be saved or erased.
    #[error(
        "E21 the flash does not hold what was written or erased: try again; if that does not help, replace \
         the sensor's board"
    )]
    MapNotSaved(StoreError),
    /// A region has too few of the sensor's pixels.
    #[error(
        "E22 region {} {}, but the sensor has {pixels} pixels: take {} of them or more",
        .region.first(), .region.last(), Region::FEWEST
    )]
    OffRow {
        /// The region.
        region: Region,
        /// How many pixels see light.
        pixels: usize,
    },
    /// `measure`, and each frame starts at the end of the one before.
    #[error("E24 frames start by themselves: send distance, or trigger serial before measure")]
    NotTriggered,
}
