//! The result of a frame: the centre as it was measured, and the distance that a calibration gives for it.

use crate::centre::Estimator;
use crate::distance::Calibration;
use crate::fault::Fault;
use crate::frame::FrameCentre;
use crate::pixels::PixelErrors;
use crate::units::{Counts, Micrometres, Pixels};

/// The result of a frame without a calibration. Calibrations are made from such results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measured {
    /// Where the spot is, and how certain that is.
    pub frame: FrameCentre,
    /// The counts of an unlit pixel.
    pub black_level: Counts,
    /// Counts of the background above the black level: ambient light.
    pub ambient: Counts,
    /// How the rows' centres were found.
    pub estimator: Estimator,
    /// How far the pixels differ, after the correction that the rows had.
    pub pixels: PixelErrors,
}

impl Measured {
    /// Converts the centre to a distance.
    ///
    /// # Errors
    /// [`Fault::NotCalibrated`] without a calibration, [`Fault::OutOfRange`] where it is not valid.
    pub fn reading(&self, calibration: Option<&Calibration>) -> Result<Reading, Fault> {
        let Self {
            frame,
            black_level,
            estimator,
            ..
        } = *self;
        let calibration = calibration.ok_or(Fault::NotCalibrated {
            centre: frame.centre,
            uncertainty: frame.uncertainty,
        })?;
        let (distance, slope) = calibration.distance_at(frame.centre)?;
        Ok(Reading {
            distance,
            // Never zero: if the true uncertainty is below the finest step, the step is reported.
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
    /// Distance to the target; to a moving target, in the middle of the frame.
    pub distance: Micrometres,
    /// Standard uncertainty of the distance (one sigma): that of the centre times the slope of the
    /// calibration.
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
    /// The counts of an unlit pixel.
    pub black_level: Counts,
    /// How the rows' centres were found.
    pub estimator: Estimator,
    /// Rows used whose pixels lie further from the fitted spot than their noise explains. See
    /// [`RowCentre::misfit`](crate::centre::RowCentre::misfit).
    pub misfits: u16,
    /// The number of independent rows that the frame's rows may be worth, if neighbouring rows have similar
    /// errors and the number is below [`FEWEST_INDEPENDENT`](crate::frame::FEWEST_INDEPENDENT). The
    /// uncertainty is then an estimate from too few rows, and may be several times too small.
    ///
    /// `None` does not say that the rows are independent. Few rows tell little about that: the flag marks
    /// 96 % of the frames of 64 rows that are worth fewer than eight, but only 18 % of the frames of 16 rows
    /// that are worth four. An error that all rows share does not show in their differences. If a
    /// target is at rest or drifts steadily, the error by speckle is hundreds of times the uncertainty.
    /// Nothing in the frame shows that error. Only readings of other places on the surface show it.
    pub correlated: Option<u16>,
}
