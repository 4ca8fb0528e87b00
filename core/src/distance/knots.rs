//! A curve over the centre, given at knots.

use core::fmt;

use serde::{Deserialize, Serialize};

use super::centres::Centres;
use super::interpolation::{Controls, Interval, MAX_RISE, controls};
use crate::fault::Fault;
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
pub struct Knots {
    /// How many.
    len: usize,
    /// The first centre and the last.
    valid: (Pixels, Pixels),
    pieces: Pieces,
}

/// What belongs to each knot; what is beyond the last has no meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Pieces {
    Linear {
        centres: Centres<MAX_LINEAR>,
        values: [Micrometres; MAX_LINEAR],
    },
    Cubic {
        centres: Centres<MAX_CUBIC>,
        starts: [CubicStart; MAX_CUBIC],
    },
}

/// Where a cubic begins; the last knot's control points have no meaning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct CubicStart {
    value: Micrometres,
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
        let pieces = match interpolation {
            Interpolation::Linear => linear(knots),
            Interpolation::Cubic => cubic(knots),
        };
        match (knots, pieces) {
            ([first, .., last], Some(pieces)) => Ok(Self {
                len: knots.len(),
                valid: (first.centre, last.centre),
                pieces,
            }),
            _ => Err(too_many),
        }
    }

    /// What lies between the knots.
    pub const fn interpolation(&self) -> Interpolation {
        match self.pieces {
            Pieces::Linear { .. } => Interpolation::Linear,
            Pieces::Cubic { .. } => Interpolation::Cubic,
        }
    }

    /// How many knots there are.
    #[expect(clippy::len_without_is_empty, reason = "there are always two")]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// A knot.
    pub fn get(&self, index: usize) -> Option<Knot> {
        if index >= self.len {
            return None;
        }
        let (centre, value) = match &self.pieces {
            Pieces::Linear { centres, values } => (centres.get(index)?, *values.get(index)?),
            Pieces::Cubic { centres, starts } => (centres.get(index)?, starts.get(index)?.value),
        };
        Some(Knot { centre, value })
    }

    /// All knots in their order.
    pub fn iter(&self) -> impl Iterator<Item = Knot> {
        (0..self.len()).filter_map(|index| self.get(index))
    }

    /// The first and the last centre.
    pub const fn valid(&self) -> (Pixels, Pixels) {
        self.valid
    }

    /// The value at a centre, and the slope there in micrometres a pixel; at a knot that of the interval before it.
    ///
    /// # Errors
    /// [`Fault::OutOfRange`] before the first knot and beyond the last.
    pub fn at(&self, centre: Pixels) -> Result<(Micrometres, f32), Fault> {
        if centre < self.valid.0 || centre > self.valid.1 {
            return Err(Fault::OutOfRange { centre });
        }
        match &self.pieces {
            Pieces::Linear { centres, values } => on_a_line(centres, values, centre),
            Pieces::Cubic { centres, starts } => on_a_cubic(centres, starts, centre),
        }
    }

    /// The two knots of an interval, and the largest slope between them, without sign, in micrometres a pixel.
    pub fn steepest(&self, index: usize) -> Option<(Knot, Knot, f32)> {
        let interval = Interval {
            from: self.get(index)?,
            to: self.get(index.checked_add(1)?)?,
        };
        let controls = match &self.pieces {
            Pieces::Linear { .. } => None,
            Pieces::Cubic { starts, .. } => starts.get(index).map(|start| start.controls),
        };
        Some((interval.from, interval.to, interval.steepest(controls)))
    }
}

/// `None` where there are too many.
fn linear(knots: &[Knot]) -> Option<Pieces> {
    let mut values = [Micrometres::default(); MAX_LINEAR];
    for (at, knot) in values.get_mut(..knots.len())?.iter_mut().zip(knots) {
        *at = knot.value;
    }
    Some(Pieces::Linear {
        centres: Centres::of(knots)?,
        values,
    })
}

/// `None` where there are too many.
fn cubic(knots: &[Knot]) -> Option<Pieces> {
    let mut starts = [CubicStart::default(); MAX_CUBIC];
    let interval = |index: Option<usize>| {
        let from = index?;
        Some(Interval {
            from: *knots.get(from)?,
            to: *knots.get(from.checked_add(1)?)?,
        })
    };
    for ((index, knot), at) in knots.iter().enumerate().zip(starts.get_mut(..knots.len())?) {
        let controls = match interval(Some(index)) {
            Some(this) => controls(
                interval(index.checked_sub(1)),
                this,
                interval(index.checked_add(1)),
            ),
            None => (knot.value, knot.value),
        };
        *at = CubicStart {
            value: knot.value,
            controls,
        };
    }
    Some(Pieces::Cubic {
        centres: Centres::of(knots)?,
        starts,
    })
}

// Two functions: in one, the compiler makes one end of both, and does not find SMMLAR for it.

/// The value and the slope at a centre of the range, on straight lines.
#[inline(never)]
fn on_a_line(
    centres: &Centres<MAX_LINEAR>,
    values: &[Micrometres; MAX_LINEAR],
    centre: Pixels,
) -> Result<(Micrometres, f32), Fault> {
    let index = centres.before(centre);
    let knot = |index| {
        Some(Knot {
            centre: centres.get(index)?,
            value: *values.get(index)?,
        })
    };
    let (Some(from), Some(to)) = (knot(index), knot(index + 1)) else {
        // There is an interval for every centre.
        return Err(Fault::OutOfRange { centre });
    };
    Ok(Interval { from, to }.linear(centre))
}

/// The same on cubics.
#[inline(never)]
fn on_a_cubic(
    centres: &Centres<MAX_CUBIC>,
    starts: &[CubicStart; MAX_CUBIC],
    centre: Pixels,
) -> Result<(Micrometres, f32), Fault> {
    let index = centres.before(centre);
    let knot = |index| {
        let start = starts.get(index)?;
        Some((
            Knot {
                centre: centres.get(index)?,
                value: start.value,
            },
            start.controls,
        ))
    };
    let (Some((from, controls)), Some((to, _))) = (knot(index), knot(index + 1)) else {
        // There is an interval for every centre.
        return Err(Fault::OutOfRange { centre });
    };
    Ok(Interval { from, to }.cubic(centre, controls))
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
