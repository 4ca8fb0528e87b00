//! What comes out of a frame: the centre as it was measured, and the distance that a calibration makes of it.

use crate::centre::Estimator;
use crate::distance::Calibration;
use crate::fault::Fault;
use crate::frame::FrameCentre;
use crate::units::{Counts, Micrometres, Pixels};

/// What a frame says of the spot: what there is to know without a calibration, and what one is made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measured {
    /// Where the spot is, and how certain that is.
    pub frame: FrameCentre,
    /// What an unlit pixel reads.
    pub black_level: Counts,
    /// How the rows' centres were found.
    pub estimator: Estimator,
}

impl Measured {
    /// The distance that the centre stands for.
    ///
    /// # Errors
    /// [`Fault::NotCalibrated`] without a calibration, [`Fault::OutOfRange`] where it is not valid.
    pub fn reading(&self, calibration: Option<&Calibration>) -> Result<Reading, Fault> {
        let Self {
            frame,
            black_level,
            estimator,
        } = *self;
        let calibration = calibration.ok_or(Fault::NotCalibrated {
            centre: frame.centre,
            uncertainty: frame.uncertainty,
        })?;
        let (distance, slope) = calibration.distance_at(frame.centre)?;
        Ok(Reading {
            distance,
            // Never zero: the finest step stands for less.
            uncertainty: Micrometres::from_f32(frame.uncertainty.to_f32() * slope.abs())
                .max(Micrometres::from_bits(1)),
            centre: frame.centre,
            centre_uncertainty: frame.uncertainty,
            amplitude: frame.amplitude,
            width: frame.width,
            rows_used: frame.rows_used,
            rows: frame.rows,
            black_level,
            estimator,
            misfits: frame.misfits,
            correlated: frame.correlated,
        })
    }
}

/// A distance with its uncertainty and how it came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// Distance to the target, of one that moves in the middle of the frame.
    pub distance: Micrometres,
    /// Standard uncertainty of the distance (one sigma): that of the centre through the slope of eq. (1).
    pub uncertainty: Micrometres,
    /// Centre of the spot on the light range.
    pub centre: Pixels,
    /// Standard uncertainty of the centre.
    pub centre_uncertainty: Pixels,
    /// The spot's height above the background, mean over the rows used.
    pub amplitude: Counts,
    /// The spot's width (a gaussian's sigma), mean over the rows used.
    pub width: Pixels,
    /// Rows whose centre went into the reading.
    pub rows_used: u16,
    /// Rows in the frame.
    pub rows: u16,
    /// What an unlit pixel reads.
    pub black_level: Counts,
    /// How the rows' centres were found.
    pub estimator: Estimator,
    /// Of the rows used, those whose pixels lie further from the fitted spot than their noise explains.
    /// See [`RowCentre::misfit`](crate::centre::RowCentre::misfit).
    pub misfits: u16,
    /// As how few independent rows the frame's may count, where neighbouring rows err alike and that is fewer
    /// than [`FEWEST_INDEPENDENT`](crate::frame::FEWEST_INDEPENDENT): the uncertainty is then an estimate
    /// from too few, and may be several times too small.
    ///
    /// `None` does not say that the rows are independent. Few rows say little about it: of 64 that are worth
    /// fewer than eight 96 % are flagged, of 16 that are worth four 18 %. And what all rows share is in none
    /// of their differences: speckle of a target at rest, or one that drifts steadily, makes a reading wrong
    /// by hundreds of times what it claims, and nothing in the frame tells. Only readings of other places on
    /// the surface do.
    pub correlated: Option<u16>,
}
