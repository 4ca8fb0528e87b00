//! What comes out: where the spot is, a reading, or a fault.

use crate::calibration::Calibration;
use crate::estimator::Estimator;
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
    /// See [`RowCentre::misfit`](crate::estimator::RowCentre::misfit).
    pub misfits: u16,
    /// As how few independent rows the frame's may count, where neighbouring rows err alike and that is fewer than
    /// [`FEWEST_INDEPENDENT`](crate::frame::FEWEST_INDEPENDENT): the uncertainty is then an estimate from too few, and may be several
    /// times too small.
    ///
    /// `None` does not say that the rows are independent. Few rows say little about it: of 64 that are worth fewer than eight 96 % are
    /// flagged, of 16 that are worth four 18 %. And what all rows share is in none of their differences: speckle of a target
    /// at rest, or one that drifts steadily, makes a reading wrong by hundreds of times what it claims, and nothing in the frame
    /// tells. Only readings of other places on the surface do.
    pub correlated: Option<u16>,
}

/// Why there is no distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// No rows come, or words that no sensor makes.
    SensorSilent,
    /// Nothing in the row stands out of its noise, or what does has not the shape of a spot.
    NoSpot {
        /// The height of the highest candidate.
        amplitude: Counts,
    },
    /// A spot, too dim for a centre that can be trusted.
    TooDim {
        /// The spot's height.
        amplitude: Counts,
        /// The height that this spot would need.
        needed: Counts,
    },
    /// Pixels of the spot are at full scale: its top is cut off.
    Saturated {
        /// How many.
        pixels: u16,
    },
    /// The pixels around the spot that a fit needs reach over the sensor's edge.
    SpotAtEdge {
        /// Where the spot is, roughly.
        centre: Pixels,
    },
    /// Two spots of like height: which of them is the laser's cannot be told.
    TwoSpots {
        /// Where the higher one is, roughly.
        centre: Pixels,
        /// Where the other one is, roughly.
        other: Pixels,
    },
    /// The centres of the frame's rows lie further apart than the spot is wide: the target moved, or there are two spots.
    Unsteady {
        /// Standard deviation of the rows' centres.
        scatter: Pixels,
    },
    /// The centre lies where the calibration is not valid.
    OutOfRange {
        /// The centre.
        centre: Pixels,
    },
    /// The sensor has no calibration; the centre is good.
    NotCalibrated {
        /// The centre.
        centre: Pixels,
        /// Its standard uncertainty.
        uncertainty: Pixels,
    },
}

impl Fault {
    /// Number of kinds of fault.
    pub const KINDS: usize = 9;

    /// The kind as a number from 0 to [`Fault::KINDS`] - 1, to count by.
    pub const fn kind(&self) -> usize {
        match self {
            Self::SensorSilent => 0,
            Self::NoSpot { .. } => 1,
            Self::TooDim { .. } => 2,
            Self::Saturated { .. } => 3,
            Self::SpotAtEdge { .. } => 4,
            Self::TwoSpots { .. } => 5,
            Self::Unsteady { .. } => 6,
            Self::OutOfRange { .. } => 7,
            Self::NotCalibrated { .. } => 8,
        }
    }

    /// The names of the kinds, in the order of [`Fault::kind`].
    pub const NAMES: [&'static str; Self::KINDS] = [
        "sensor silent",
        "no spot",
        "too dim",
        "saturated",
        "spot at the edge",
        "two spots",
        "unsteady",
        "out of range",
        "not calibrated",
    ];

    /// The kind's name.
    pub const fn name(&self) -> &'static str {
        Self::NAMES[self.kind()]
    }

    /// What to do about it.
    pub const fn advice(&self) -> &'static str {
        match self {
            Self::SensorSilent => "check the sensor head's supply and wires",
            Self::NoSpot { .. } => "check that the laser is on and hits a target",
            Self::TooDim { .. } => "more laser power, a brighter target or less ambient light",
            Self::Saturated { .. } => "less laser power or a darker target",
            Self::SpotAtEdge { .. } | Self::OutOfRange { .. } => {
                "move the target into the range that `info` names"
            }
            Self::TwoSpots { .. } => "cover what reflects the laser or shines beside it",
            Self::Unsteady { .. } => "hold the target still, or take fewer rows in a frame",
            Self::NotCalibrated { .. } => {
                "`calibration on`; where there is none, upload one or `defaults`"
            }
        }
    }
}
