//! Eq. (1) with a table of residuals. The curve has three numbers, which the noise of the calibration points
//! hardly moves. The smoothed table adds what a lens or the mounting changes.

use core::fmt;
use core::ops::RangeInclusive;

use super::knots::{Knot, Knots, KnotsError};
use crate::base::numeric::{at_most, limited};
use crate::base::{Fault, Micrometres, Pixels};
use crate::distance::eq1::Eq1;

/// Eq. (1) plus residuals, valid from their first knot to their last.
///
/// The residuals change the curve's slope by at most half of it, so that the distance still rises or falls
/// with the centre. Each of the two parts is rounded, so the distance may turn back by four steps of Q24.8
/// (0.016 um) and 2^-22 of the difference of neighbouring residuals.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Corrected {
    curve: Eq1,
    /// Distance less curve.
    residuals: Knots,
}

/// The distances at the ends stay so many steps of Q24.8 away from the ends of [`Micrometres`], so that
/// rounding cannot leave it in between: more than four and 2^-22 of 2^30.
const MARGIN: i32 = 1024;

impl Corrected {
    /// Makes eq. (1) with residuals (distance less curve) at knots.
    ///
    /// # Errors
    /// [`CorrectedError`] says which knot is wrong.
    pub fn new(curve: Eq1, knots: &[Knot]) -> Result<Self, CorrectedError> {
        let residuals = Knots::new(knots).map_err(CorrectedError::Knots)?;
        for (index, knot) in knots.iter().enumerate() {
            if curve.distance_at(knot.centre).is_err() {
                return Err(CorrectedError::Beyond {
                    index,
                    centre: knot.centre,
                });
            }
        }
        let corrected = Self { curve, residuals };
        if let Some((index, knot)) = corrected.steep() {
            return Err(CorrectedError::Steep {
                index,
                centre: knot.centre,
            });
        }
        let (first, last) = corrected.valid();
        for centre in [first, last] {
            const INSIDE: RangeInclusive<i32> = i32::MIN + MARGIN..=i32::MAX - MARGIN;
            let distance = corrected.distance_at(centre);
            if !distance.is_ok_and(|(distance, _)| INSIDE.contains(&distance.to_bits())) {
                return Err(CorrectedError::Distance { centre });
            }
        }
        Ok(corrected)
    }

    /// Finds the first interval in which the residuals change the slope by more than half of the curve's, and
    /// returns its second knot.
    fn steep(&self) -> Option<(usize, Knot)> {
        let mut intervals = (1..self.residuals.len()).zip(self.residuals.steepest());
        intervals.find_map(|(index, (from, to, steepest))| {
            // The curve is least steep at the end that is further from its pole.
            let at = |knot: Knot| self.curve.distance_at(knot.centre);
            let (Ok((_, at_from)), Ok((_, at_to))) = (at(from), at(to)) else {
                return Some((index, to));
            };
            let most = 0.5 * at_most(at_from.abs(), at_to.abs());
            (steepest > most).then_some((index, to))
        })
    }

    /// The distance at a centre, and the slope there in micrometres a pixel.
    ///
    /// # Errors
    /// [`Fault::OutOfRange`] before the first knot of the residuals and beyond the last.
    pub fn distance_at(&self, centre: Pixels) -> Result<(Micrometres, f32), Fault> {
        let (residual, change) = self.residuals.at(centre)?;
        let (distance, slope) = self.curve.distance_at(centre)?;
        // It always fits: both ends do, with a margin, and rounding takes less than that margin.
        let bits = (distance.to_bits()).checked_add(residual.to_bits());
        let bits = bits.ok_or(Fault::OutOfRange { centre })?;
        // `new` allows half of the slope. Over a short interval the tangent's rounding may exceed that.
        let most = 0.5 * slope.abs();
        let slope = slope + limited(change, -most, most);
        Ok((Micrometres::from_bits(bits), slope))
    }

    /// Eq. (1).
    pub const fn curve(&self) -> &Eq1 {
        &self.curve
    }

    /// Distance less curve.
    pub const fn residuals(&self) -> &Knots {
        &self.residuals
    }

    /// The first and the last centre of the residuals.
    pub const fn valid(&self) -> (Pixels, Pixels) {
        self.residuals.valid()
    }
}

/// Why residuals do not fit a curve. An index counts from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CorrectedError {
    /// The knots of the residuals give no curve.
    Knots(KnotsError),
    /// A knot lies where eq. (1) is not valid.
    Beyond {
        /// Which.
        index: usize,
        /// Its centre.
        centre: Pixels,
    },
    /// From the knot before to this one, the residuals change the slope of eq. (1) by more than half of it.
    Steep {
        /// Which.
        index: usize,
        /// Its centre.
        centre: Pixels,
    },
    /// The distance at an end of the range is beyond what [`Micrometres`] hold.
    Distance {
        /// That end.
        centre: Pixels,
    },
}

impl fmt::Display for CorrectedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Knots(error) => error.fmt(f),
            Self::Beyond { index, centre } => write!(
                f,
                "residual {index} at {centre} px is outside the range of eq. (1): leave it out, or widen \
                that range"
            ),
            Self::Steep { index, centre } => write!(
                f,
                "the residuals up to number {index} at {centre} px change the slope of eq. (1) by more than \
                half: smooth them, or use a table of distances"
            ),
            Self::Distance { centre } => write!(
                f,
                "the distance at {centre} px is beyond 8.38 m: take a smaller range of centres"
            ),
        }
    }
}

impl core::error::Error for CorrectedError {}
