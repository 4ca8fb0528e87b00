//! A curve over the centre, given by knots with monotone cubics (PCHIP) between them.

use core::fmt;

use heapless::Vec;

pub use super::interpolation::Knot;
use super::interpolation::{Controls, Interval, MAX_RISE, controls};
use crate::base::{Fault, Micrometres, Pixels};

/// The most knots of a curve.
pub const MAX_KNOTS: usize = 129;
/// The least distance between two knots: a sixteenth of a pixel. It bounds the slope between any two values
/// to 2^26 um a pixel.
pub const CLOSEST: Pixels = Pixels::from_bits(1 << (Pixels::FRACTION - 4));

/// A curve through two or more knots, with a monotone cubic between neighbours. The knots are in the order of
/// their centres and [`CLOSEST`] or more apart. The values of neighbours differ by less than 4.19 m.
///
/// Between two knots the curve rises if the second is higher, falls if it is lower, and never leaves their
/// values. At a knot it is exact. Elsewhere its arithmetic is off by at most 2^-22 of the difference between
/// the two knots and three steps of Q24.8 (0.012 um).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Knots {
    /// The first centre and the last.
    valid: (Pixels, Pixels),
    /// The knots' centres. Beyond the last knot, the largest centre that there is, so that the search needs
    /// no length.
    centres: [Pixels; MAX_KNOTS],
    pieces: Vec<Piece, MAX_KNOTS>,
}

/// A knot's value, and the control points of the cubic that begins there. The last knot's control points have
/// no meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Piece {
    value: Micrometres,
    controls: Controls,
}

impl Knots {
    /// Makes the curve through knots.
    ///
    /// # Errors
    /// [`KnotsError`] says which knot is wrong.
    pub fn new(knots: &[Knot]) -> Result<Self, KnotsError> {
        let [first, .., last] = knots else {
            return Err(KnotsError::TooFew { knots: knots.len() });
        };
        for (index, (before, knot)) in (1..knots.len()).zip(knots.iter().zip(knots.iter().skip(1)))
        {
            let least = i64::from(before.centre.to_bits()) + i64::from(CLOSEST.to_bits());
            if i64::from(knot.centre.to_bits()) < least {
                return Err(KnotsError::Order {
                    index,
                    centre: knot.centre,
                });
            }
            let (from, to) = (before.value.to_bits(), knot.value.to_bits());
            if to.abs_diff(from) >= MAX_RISE {
                return Err(KnotsError::Step {
                    index,
                    value: knot.value,
                });
            }
        }
        let interval = |index: Option<usize>| match knots.get(index?..)? {
            &[from, to, ..] => Some(Interval { from, to }),
            _ => None,
        };
        let mut pieces = Vec::new();
        let mut centres = [Pixels::MAX; MAX_KNOTS];
        for (place, knot) in centres.iter_mut().zip(knots) {
            *place = knot.centre;
        }
        for (index, &knot) in knots.iter().enumerate() {
            let controls = match interval(Some(index)) {
                Some(this) => controls(
                    interval(index.checked_sub(1)),
                    this,
                    interval(index.checked_add(1)),
                ),
                None => (knot.value, knot.value),
            };
            pieces
                .push(Piece {
                    value: knot.value,
                    controls,
                })
                .map_err(|_| KnotsError::TooMany { knots: knots.len() })?;
        }
        Ok(Self {
            valid: (first.centre, last.centre),
            centres,
            pieces,
        })
    }

    /// How many knots there are.
    #[expect(clippy::len_without_is_empty, reason = "there are always two")]
    pub fn len(&self) -> usize {
        self.pieces.len()
    }

    /// All knots in their order.
    pub fn iter(&self) -> impl Iterator<Item = Knot> {
        let values = self.pieces.iter().map(|piece| piece.value);
        let knots = self.centres.iter().zip(values);
        knots.map(|(&centre, value)| Knot { centre, value })
    }

    /// The first and the last centre.
    pub const fn valid(&self) -> (Pixels, Pixels) {
        self.valid
    }

    /// Finds the interval that a centre is in: the last knot before the centre, or the first knot if none is
    /// before it.
    ///
    /// Sets the index bit by bit, from the highest: if knot `index` lies before the centre, so do all knots
    /// before it. This takes a third fewer instructions than `partition_point`.
    #[inline(always)]
    fn interval(&self, centre: Pixels) -> usize {
        let mut index = 0;
        let mut bit = MAX_KNOTS / 2;
        while bit > 0 {
            let next = index | bit;
            if self.centres.get(next).is_some_and(|knot| *knot < centre) {
                index = next;
            }
            bit /= 2;
        }
        index
    }

    /// The value at a centre, and the slope there in micrometres a pixel. At a knot, the slope of the
    /// interval before it.
    ///
    /// # Errors
    /// [`Fault::OutOfRange`] before the first knot and beyond the last.
    pub fn at(&self, centre: Pixels) -> Result<(Micrometres, f32), Fault> {
        let out_of_range = Err(Fault::OutOfRange { centre });
        if centre < self.valid.0 || centre > self.valid.1 {
            return out_of_range;
        }
        let index = self.interval(centre);
        match (self.centres.get(index..), self.pieces.get(index..)) {
            (Some([first, last, ..]), Some([from, to, ..])) => {
                let knot = |&centre: &Pixels, piece: &Piece| Knot {
                    centre,
                    value: piece.value,
                };
                let interval = Interval {
                    from: knot(first, from),
                    to: knot(last, to),
                };
                Ok(interval.at(centre, from.controls))
            }
            // There is an interval for every centre of the range.
            _ => out_of_range,
        }
    }

    /// The two knots of each interval, and the largest slope between them, without sign, in micrometres a
    /// pixel.
    pub fn steepest(&self) -> impl Iterator<Item = (Knot, Knot, f32)> {
        let controls = self.pieces.iter().map(|piece| piece.controls);
        let ends = self.iter().zip(self.iter().skip(1));
        ends.zip(controls)
            .map(|((from, to), controls)| (from, to, Interval { from, to }.steepest(controls)))
    }
}

/// Why knots give no curve. An index counts from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KnotsError {
    /// Fewer than two.
    TooFew {
        /// How many there are.
        knots: usize,
    },
    /// More than [`MAX_KNOTS`].
    TooMany {
        /// How many there are.
        knots: usize,
    },
    /// A knot does not lie beyond the one before it, by [`CLOSEST`] at least.
    Order {
        /// Which.
        index: usize,
        /// Its centre.
        centre: Pixels,
    },
    /// A knot's value differs by 2^22 um (4.19 m) or more from that of the one before it.
    Step {
        /// Which.
        index: usize,
        /// Its value.
        value: Micrometres,
    },
}

impl fmt::Display for KnotsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFew { knots } => write!(
                f,
                "a table has at least two knots, and there are {knots}: add some"
            ),
            Self::TooMany { knots } => {
                write!(f, "{knots} knots are too many: give at most {MAX_KNOTS}")
            }
            Self::Order { index, centre } => write!(
                f,
                "knot {index} at {centre} px is not beyond the one before it: sort the knots by their \
                centres, a sixteenth of a pixel or more apart"
            ),
            Self::Step { index, value } => write!(
                f,
                "knot {index} with {value} um is 4.19 m or more from the one before it: check its distance"
            ),
        }
    }
}

impl core::error::Error for KnotsError {}
