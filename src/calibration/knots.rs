//! A curve over the centre, given at knots.

use core::fmt;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::interpolation::{Controls, Interval, MAX_RISE, controls};
use crate::units::{Micrometres, Pixels};

/// Most knots with straight lines between them.
pub const MAX_LINEAR: usize = 257;

/// Most knots with cubics between them: a cubic takes twice the memory, and a tenth of the knots do as well.
pub const MAX_CUBIC: usize = 129;

/// The least distance between two knots: a sixteenth of a pixel. It bounds the slope between any two values to 2^26 um a pixel.
pub const CLOSEST: Pixels = Pixels::from_bits(1 << (Pixels::FRACTION - 4));

/// What lies between knots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Interpolation {
    /// Straight lines.
    Linear,
    /// Monotone cubics (PCHIP): smooth, and nowhere beyond the knots to either side.
    Cubic,
}

impl Interpolation {
    /// How many knots there may be.
    pub const fn most(self) -> usize {
        match self {
            Self::Linear => MAX_LINEAR,
            Self::Cubic => MAX_CUBIC,
        }
    }
}

/// A place on the curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Knot {
    /// The centre.
    pub centre: Pixels,
    /// The distance there, or the residual.
    pub value: Micrometres,
}

/// At least two knots in the order of their centres, [`CLOSEST`] or more apart, whose values differ by less than 4.19 m from
/// one to the next; and what lies between them.
///
/// Between two knots the curve rises if the second is higher, falls if it is lower, and never leaves their values. At a knot
/// it is exact. Elsewhere its arithmetic is off by at most 2^-22 of the difference between the two knots and three steps of
/// Q24.8 (0.012 um).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Knots(Pieces);

#[derive(Clone, Debug, PartialEq, Eq)]
enum Pieces {
    Linear(Vec<Knot, MAX_LINEAR>),
    Cubic(Vec<CubicKnot, MAX_CUBIC>),
}

/// A knot with the control points of the cubic that begins there; the last one's are of no meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct CubicKnot {
    knot: Knot,
    controls: Controls,
}

impl Knots {
    /// The curve through knots.
    ///
    /// # Errors
    /// [`KnotsError`] says which knot stands against it.
    pub fn new(interpolation: Interpolation, knots: &[Knot]) -> Result<Self, KnotsError> {
        if knots.len() < 2 {
            return Err(KnotsError::TooFew { knots: knots.len() });
        }
        let most = interpolation.most();
        let too_many = KnotsError::TooMany {
            knots: knots.len(),
            most,
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
        match interpolation {
            Interpolation::Linear => match Vec::from_slice(knots) {
                Ok(knots) => Ok(Self(Pieces::Linear(knots))),
                Err(_) => Err(too_many),
            },
            Interpolation::Cubic => match cubic(knots) {
                Some(knots) => Ok(Self(Pieces::Cubic(knots))),
                None => Err(too_many),
            },
        }
    }

    /// What lies between the knots.
    pub const fn interpolation(&self) -> Interpolation {
        match self.0 {
            Pieces::Linear(_) => Interpolation::Linear,
            Pieces::Cubic(_) => Interpolation::Cubic,
        }
    }

    /// How many knots there are.
    #[expect(clippy::len_without_is_empty, reason = "there are always two")]
    pub fn len(&self) -> usize {
        match &self.0 {
            Pieces::Linear(knots) => knots.len(),
            Pieces::Cubic(knots) => knots.len(),
        }
    }

    /// A knot.
    pub fn get(&self, index: usize) -> Option<Knot> {
        match &self.0 {
            Pieces::Linear(knots) => knots.get(index).copied(),
            Pieces::Cubic(knots) => knots.get(index).map(|at| at.knot),
        }
    }

    /// All knots in their order.
    pub fn iter(&self) -> impl Iterator<Item = Knot> {
        (0..self.len()).filter_map(|index| self.get(index))
    }

    /// The first and the last knot.
    pub fn ends(&self) -> (Knot, Knot) {
        // There are at least two.
        const NONE: Knot = Knot {
            centre: Pixels::MIN,
            value: Micrometres::MIN,
        };
        let last = self.len().saturating_sub(1);
        (self.get(0).unwrap_or(NONE), self.get(last).unwrap_or(NONE))
    }

    /// The value at a centre, and the slope there in micrometres a pixel. `None` before the first knot and beyond the last.
    pub fn at(&self, centre: Pixels) -> Option<(Micrometres, f32)> {
        match &self.0 {
            Pieces::Linear(knots) => {
                let (from, to) = around(knots, |knot| knot.centre, centre)?;
                let interval = Interval {
                    from: *from,
                    to: *to,
                };
                Some(interval.linear(centre))
            }
            Pieces::Cubic(knots) => {
                let (from, to) = around(knots, |at| at.knot.centre, centre)?;
                let interval = Interval {
                    from: from.knot,
                    to: to.knot,
                };
                Some(interval.cubic(centre, from.controls))
            }
        }
    }

    /// The two knots of an interval, and the largest slope between them, without sign, in micrometres a pixel.
    pub fn steepest(&self, index: usize) -> Option<(Knot, Knot, f32)> {
        let interval = Interval {
            from: self.get(index)?,
            to: self.get(index.checked_add(1)?)?,
        };
        let controls = match &self.0 {
            Pieces::Linear(_) => None,
            Pieces::Cubic(knots) => knots.get(index).map(|at| at.controls),
        };
        Some((interval.from, interval.to, interval.steepest(controls)))
    }
}

/// Knots with their control points. `None` where there are too many.
fn cubic(knots: &[Knot]) -> Option<Vec<CubicKnot, MAX_CUBIC>> {
    let mut cubics = Vec::new();
    let interval = |index: Option<usize>| {
        let from = index?;
        Some(Interval {
            from: *knots.get(from)?,
            to: *knots.get(from.checked_add(1)?)?,
        })
    };
    for (index, &knot) in knots.iter().enumerate() {
        let controls = match interval(Some(index)) {
            Some(this) => controls(
                interval(index.checked_sub(1)),
                this,
                interval(index.checked_add(1)),
            ),
            None => (knot.value, knot.value),
        };
        cubics.push(CubicKnot { knot, controls }).ok()?;
    }
    Some(cubics)
}

/// The knots to either side of a centre; the last interval has both its ends.
#[inline]
fn around<K>(knots: &[K], centre_of: impl Fn(&K) -> Pixels, centre: Pixels) -> Option<(&K, &K)> {
    let [_, inner @ .., _] = knots else {
        return None;
    };
    let index = inner.partition_point(|knot| centre_of(knot) <= centre);
    // At most the number of inner knots, which is two less than there are.
    let (from, to) = (knots.get(index)?, knots.get(index + 1)?);
    (centre_of(from) <= centre && centre <= centre_of(to)).then_some((from, to))
}

/// Why knots give no curve. An index counts from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KnotsError {
    /// Fewer than two.
    TooFew {
        /// How many there are.
        knots: usize,
    },
    /// More than there is memory for.
    TooMany {
        /// How many there are.
        knots: usize,
        /// How many there may be.
        most: usize,
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
            Self::TooMany { knots, most } => {
                write!(f, "{knots} knots are too many: give at most {most}")
            }
            Self::Order { index, centre } => write!(
                f,
                "knot {index} at {centre} px is not beyond the one before it: sort the knots by their centres, a \
                 sixteenth of a pixel or more apart"
            ),
            Self::Step { index, value } => write!(
                f,
                "knot {index} with {value} um is 4.19 m or more from the one before it: check its distance"
            ),
        }
    }
}

impl core::error::Error for KnotsError {}
