//! Why a frame gives no distance.

use core::fmt;

use serde::{Deserialize, Serialize};

use crate::base::exposure::Exposure;
use crate::base::units::{Counts, Micrometres, Pixels};

/// Why there is no distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// No rows come, or rows that no sensor makes.
    SensorSilent,
    /// Nothing in the row stands out of its noise, or what stands out does not have the shape of a spot.
    NoSpot {
        /// The height of the highest candidate.
        amplitude: Counts,
    },
    /// There is a spot, but it is too dim for a centre that can be trusted.
    TooDim {
        /// The spot's height.
        amplitude: Counts,
        /// The height that this spot would need.
        needed: Counts,
    },
    /// Pixels of the spot are saturated: its top is cut off.
    Saturated {
        /// How many.
        pixels: u16,
    },
    /// The pixels around the spot that a fit needs reach over the sensor's edge.
    SpotAtEdge {
        /// Where the spot is, roughly.
        centre: Pixels,
    },
    /// Two spots of similar height: nothing tells which of them is the laser's.
    TwoSpots {
        /// Where the higher one is, roughly.
        centre: Pixels,
        /// Where the other one is, roughly.
        other: Pixels,
    },
    /// The centres of the frame's rows do not agree, or scatter by more than the spot's width: the target
    /// moved, or there are two spots.
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
    /// A comb shows the spot through too few of its slits.
    FewSlits {
        /// How many slits show it.
        found: u16,
        /// How many are needed.
        needed: u16,
    },
    /// The images of a comb fit its slits in two ways: nothing tells which slit each belongs to.
    SlitsUnclear {
        /// How many images fit the better way.
        images: u16,
        /// How many fit the other.
        other: u16,
    },
    /// The spot is too dim at the longest exposure that `exposure limit` allows.
    DimAtLongest {
        /// The spot's height.
        amplitude: Counts,
        /// The exposure.
        exposure: Exposure,
    },
    /// The spot is saturated at the shortest exposure.
    SaturatedAtShortest {
        /// How many pixels are saturated.
        pixels: u16,
        /// The exposure.
        exposure: Exposure,
    },
    /// The option `laser` is off.
    LaserOff,
    /// The reading is farther from the last good one than the filter for spikes allows.
    Spike {
        /// How far.
        step: Micrometres,
    },
}

impl Fault {
    /// Number of kinds of fault.
    pub const KINDS: usize = 15;

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
            Self::FewSlits { .. } => 9,
            Self::SlitsUnclear { .. } => 10,
            Self::DimAtLongest { .. } => 11,
            Self::SaturatedAtShortest { .. } => 12,
            Self::LaserOff => 13,
            Self::Spike { .. } => 14,
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
        "too few slits",
        "slits unclear",
        "too dim at the longest exposure",
        "saturated at the shortest exposure",
        "laser off",
        "spike",
    ];

    /// The kind's name.
    pub const fn name(&self) -> &'static str {
        Self::NAMES[self.kind()]
    }

    /// The fault of a row whose pixel 0 lies so many pixels before that of the fault.
    pub(crate) fn moved_by(self, pixels: i32) -> Self {
        match self {
            Self::SpotAtEdge { centre } => Self::SpotAtEdge {
                centre: centre.moved_by(pixels),
            },
            Self::TwoSpots { centre, other } => Self::TwoSpots {
                centre: centre.moved_by(pixels),
                other: other.moved_by(pixels),
            },
            // These have no place, or one on the row: only a frame's result is out of range.
            fault => fault,
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        match self {
            Self::SensorSilent | Self::LaserOff => Ok(()),
            Self::NoSpot { amplitude } => write!(f, ": {amplitude:.1} counts at most"),
            Self::TooDim { amplitude, needed } => {
                write!(f, ": {amplitude:.1} counts, needs {needed:.1}")
            }
            Self::Saturated { pixels } => write!(f, ": {pixels} pixels"),
            Self::SpotAtEdge { centre } => write!(f, ": x {centre:.1}"),
            Self::TwoSpots { centre, other } => write!(f, ": x {centre:.1} and {other:.1}"),
            Self::Unsteady { scatter } => write!(f, ": rows scatter by {scatter:.2} px"),
            Self::OutOfRange { centre } => write!(f, ": x {centre:.5}"),
            Self::NotCalibrated {
                centre,
                uncertainty,
            } => write!(f, ": x {centre:.5} u {uncertainty:.5}"),
            Self::FewSlits { found, needed } => write!(f, ": {found}, needs {needed}"),
            Self::SlitsUnclear { images, other } => {
                write!(f, ": {images} images fit one place, {other} another")
            }
            Self::DimAtLongest {
                amplitude,
                exposure,
            } => write!(f, ": {amplitude:.1} counts in {} us", exposure.us()),
            Self::SaturatedAtShortest { pixels, exposure } => {
                write!(f, ": {pixels} pixels in {} us", exposure.us())
            }
            Self::Spike { step } => write!(f, ": {step:.1} um from the last good reading"),
        }
    }
}

impl core::error::Error for Fault {}
