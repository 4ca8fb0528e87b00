//! A lookup table of distances.

use core::fmt;

use super::knots::{Knot, Knots, KnotsError};
use crate::base::{Fault, Micrometres, Pixels};
use crate::distance::eq1::LEAST_SLOPE_HALVINGS;

/// Distances at knots. They all rise or all fall with the centre, by at least a sixteenth of a micrometre a
/// pixel, and so do the distances in between, without a step back. Valid from the first knot to the last.
///
/// For its arithmetic's error see [`Knots`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table(Knots);

impl Table {
    /// Makes a table of the knots' distances.
    ///
    /// # Errors
    /// [`TableError`] says which knot is wrong.
    pub fn new(knots: &[Knot]) -> Result<Self, TableError> {
        let curve = Knots::new(knots).map_err(TableError::Knots)?;
        let falls = matches!(knots, [first, .., last] if last.value < first.value);
        for (index, (before, knot)) in (1..knots.len()).zip(knots.iter().zip(knots.iter().skip(1)))
        {
            let length = i64::from(knot.centre.to_bits()) - i64::from(before.centre.to_bits());
            let rise = i64::from(knot.value.to_bits()) - i64::from(before.value.to_bits());
            let onward = if falls { -rise } else { rise };
            // Q8 um over Q16 px is at least 2^-4: below 2^33 times 2^12.
            if onward * (1 << (Pixels::FRACTION - Micrometres::FRACTION + LEAST_SLOPE_HALVINGS))
                < length
            {
                return Err(TableError::NotMonotone {
                    index,
                    distance: knot.value,
                });
            }
        }
        Ok(Self(curve))
    }

    /// The distance at a centre, and the table's slope there in micrometres a pixel.
    ///
    /// # Errors
    /// [`Fault::OutOfRange`] before the first knot and beyond the last.
    pub fn distance_at(&self, centre: Pixels) -> Result<(Micrometres, f32), Fault> {
        self.0.at(centre)
    }

    /// The knots.
    pub const fn knots(&self) -> &Knots {
        &self.0
    }

    /// The first and the last centre of the table.
    pub const fn valid(&self) -> (Pixels, Pixels) {
        self.0.valid()
    }
}

/// Why knots give no table of distances. An index counts from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableError {
    /// The knots give no curve.
    Knots(KnotsError),
    /// From the knot before to this one, the distance does not go the same way as from the first knot to the
    /// last, or by less than a sixteenth of a micrometre a pixel.
    NotMonotone {
        /// Which.
        index: usize,
        /// Its distance.
        distance: Micrometres,
    },
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Knots(error) => error.fmt(f),
            Self::NotMonotone { index, distance } => write!(
                f,
                "knot {index} with {distance} um does not go on from the one before it: distances must all \
                rise or all fall, by 1/16 um a pixel at least; leave that point out, or smooth the table"
            ),
        }
    }
}

impl core::error::Error for TableError {}
