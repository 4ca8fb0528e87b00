//! The result of a frame: the centre as it was measured, and the distance that a calibration gives for it.

pub mod relative;
pub mod uncertainty;

use serde::{Deserialize, Serialize};

use crate::base::{Counts, Exposure, Fault, Micrometres, Pixels};
use crate::centre::Estimator;
use crate::distance::Calibration;
use crate::frame::FrameCentre;
use crate::frame::comb::Combined;
use crate::reading::uncertainty::{CalibrationErrors, Parts, Place, Surface};
use crate::row::pixels::PixelErrors;

/// The result of a frame without a calibration. Calibrations are made from such results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Measured {
    /// Where the spot is, and how certain that is.
    pub frame: FrameCentre,
    /// The counts of an unlit pixel.
    pub black_level: Counts,
    /// Counts of the background above the black level: ambient light.
    pub ambient: Counts,
    /// How the rows' centres were found.
    pub estimator: Estimator,
    /// Standard uncertainty of the centre that comes from the spot's shape, beyond that of the sensor's own
    /// spot.
    pub by_shape: Pixels,
    /// How far the pixels differ, after the correction that the rows had.
    pub pixels: PixelErrors,
    /// What the slits of a comb say together. `None` for a sensor with one slit.
    pub comb: Option<Combined>,
}

impl Measured {
    /// Converts the centre to a distance, and computes the uncertainty of the distance.
    ///
    /// # Errors
    /// [`Fault::NotCalibrated`] without a calibration, [`Fault::OutOfRange`] where it is not valid.
    pub fn reading(
        &self,
        calibration: Option<&Calibration>,
        errors: &CalibrationErrors,
        surface: Surface,
    ) -> Result<Reading, Fault> {
        let Self {
            frame,
            black_level,
            ambient,
            estimator,
            by_shape,
            pixels,
            comb,
        } = *self;
        let calibration = calibration.ok_or(Fault::NotCalibrated {
            centre: frame.centre,
            uncertainty: frame.uncertainty,
        })?;
        let (distance, slope) = calibration.distance_at(frame.centre)?;
        let (first, last) = calibration.valid();
        let place = Place {
            distance,
            slope: slope.abs(),
            along: (frame.centre.to_f32() - first.to_f32()) / (last.to_f32() - first.to_f32()),
        };
        let pixels = pixels.of_centre(estimator, frame.width, frame.amplitude, ambient);
        let slits_used = comb.map_or(1, |comb| comb.used.max(1));
        // Each image lies on other pixels.
        let pixels = match slits_used {
            1 => pixels,
            slits => pixels / dual_mac::square_root(slits.into()),
        };
        let by_slits = comb.map(|comb| comb.surface);
        let parts = place.parts(&frame, by_shape, pixels, by_slits, errors, surface);
        Ok(Reading {
            distance,
            uncertainty: parts.combined(),
            parts,
            centre: frame.centre,
            centre_uncertainty: frame.uncertainty,
            amplitude: frame.amplitude,
            exposure: frame.exposure,
            width: frame.width,
            rows_used: frame.rows_used,
            rows: frame.rows,
            slits_used,
            black_level,
            estimator,
            misfits: frame.misfits,
            correlated: frame.correlated,
            is_nominal: *errors == CalibrationErrors::Nominal,
            has_other_settings: false,
        })
    }
}

/// A distance with its uncertainty and how it came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reading {
    /// Distance to the target; to a moving target, in the middle of the frame.
    pub distance: Micrometres,
    /// u, the combined standard uncertainty of the distance (one sigma): all of the parts.
    pub uncertainty: Micrometres,
    /// The parts of u. The first part is r, the repeatability: how much frames of a target at rest scatter.
    pub parts: Parts,
    /// Centre of the spot on the light range.
    pub centre: Pixels,
    /// Repeatability of the centre: the noise of the rows. Speckle, pixels and calibration are not in it.
    pub centre_uncertainty: Pixels,
    /// The spot's height above the background, mean over the rows used.
    pub amplitude: Counts,
    /// The mean exposure of the rows used. `None` if it is not known.
    pub exposure: Option<Exposure>,
    /// The spot's width (a gaussian's sigma), mean over the rows used.
    pub width: Pixels,
    /// Rows whose centre went into the reading.
    pub rows_used: u16,
    /// Rows in the frame.
    pub rows: u16,
    /// Slits of the comb whose images went into the reading; 1 for a sensor with one slit.
    pub slits_used: u8,
    /// The counts of an unlit pixel.
    pub black_level: Counts,
    /// How the rows' centres were found.
    pub estimator: Estimator,
    /// Rows used whose pixels do not look like a spot, or whose asymmetry is too large for u. See
    /// [`RowCentre::misfit`](crate::centre::RowCentre::misfit).
    pub misfits: u16,
    /// The number of independent rows that the frame's rows may be worth, if neighbouring rows have similar
    /// errors and the number is below [`FEWEST_INDEPENDENT`](crate::frame::FEWEST_INDEPENDENT). The
    /// repeatability is then an estimate from too few rows, and may be several times too small.
    ///
    /// `None` does not say that the rows are independent. Few rows tell little about that: the flag marks
    /// 96 % of the frames of 64 rows that are worth fewer than eight, but only 18 % of the frames of 16 rows
    /// that are worth four. An error that all rows share does not show in their differences: speckle, if a
    /// target is at rest. [`Parts::surface`] holds it.
    pub correlated: Option<u16>,
    /// The calibration is the nominal one: nobody calibrated this head.
    pub is_nominal: bool,
    /// The settings differ from those with which the calibration was made: on a spot that is no gaussian, two
    /// estimators find two centres.
    pub has_other_settings: bool,
}
