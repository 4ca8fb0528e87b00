//! A curve over the centre, given by knots with monotone cubics between them (PCHIP; F. Fritsch and J.
//! Butland, 1984).
//!
//! The value is a whole number of steps of Q24.8 micrometres, computed with integers by `between` alone. The
//! result of `between` never falls where one of its arguments rises. A cubic is evaluated as straight lines
//! between straight lines (P. de Casteljau, 1959). Its four control points are in order, so the points of
//! each round are in order too, and the value rises or falls with the centre to the last bit. The fraction of
//! the way and the control points have 24 bits: [`Knots`] states the error.

use core::fmt;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::base::numeric::{self, limited};
use crate::base::{Fault, Micrometres, Pixels};

/// A point of the curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Knot {
    /// The centre.
    pub centre: Pixels,
    /// The distance there, or the residual.
    pub value: Micrometres,
}

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

/// Neighbouring knots differ by less than so many steps of Q24.8.
const MAX_RISE: u32 = 1 << 30;

/// Two neighbouring knots: the first lies before the second, and their values differ by less than
/// [`MAX_RISE`].
#[derive(Clone, Copy, Debug)]
struct Interval {
    from: Knot,
    to: Knot,
}

impl Interval {
    /// Length of the interval in steps of Q16.16 pixels. Neighbours are in order, so the difference fits an
    /// u32.
    const fn length(&self) -> u32 {
        self.offset_of(self.to.centre)
    }

    /// The distance from the first knot to a centre that does not lie before the knot, in steps of Q16.16
    /// pixels.
    const fn offset_of(&self, centre: Pixels) -> u32 {
        let offset = centre.to_bits().wrapping_sub(self.from.centre.to_bits());
        offset.cast_unsigned()
    }

    /// Difference of the two values in steps of Q24.8 micrometres: less than 2^30 of them.
    const fn rise(&self) -> i32 {
        let (from, to) = (self.from.value.to_bits(), self.to.value.to_bits());
        to.wrapping_sub(from)
    }

    /// The value at a centre of the interval, and the slope there in micrometres a pixel.
    #[inline(always)]
    fn at(&self, centre: Pixels, controls: Controls) -> (Micrometres, f32) {
        let part = fraction(self.offset_of(centre) as f32 / self.length() as f32);
        let (from, to) = (self.from.value, self.to.value);
        let first = between(from, controls.0, part);
        let middle = between(controls.0, controls.1, part);
        let last = between(controls.1, to, part);
        let (left, right) = (between(first, middle, part), between(middle, last, part));
        // The last line is the tangent, over a third of the interval; its ends are in order, like all others.
        let tangent = right.to_bits().wrapping_sub(left.to_bits());
        (between(left, right, part), self.slope_over_third(tangent))
    }

    /// The largest slope of the interval's cubic, without sign, in micrometres a pixel.
    fn steepest(&self, controls: Controls) -> f32 {
        // The slope is a parabola. It lies between the largest and the least of its control points, which are
        // the differences of the curve's control points. Those lie between the knots, so no difference
        // exceeds the rise.
        let step = |from: Micrometres, to: Micrometres| from.to_bits().abs_diff(to.to_bits());
        let most = step(self.from.value, controls.0)
            .max(step(controls.0, controls.1))
            .max(step(controls.1, self.to.value));
        // Below 2^30, as the rise is.
        self.slope_over_third(most as i32)
    }

    /// Converts a rise over a third of the interval (steps of Q24.8 micrometres) to micrometres a pixel. The
    /// rise is less than 2^30 steps, and an interval has at least a sixteenth of a pixel: below 3 * 2^26.
    #[inline(always)]
    fn slope_over_third(&self, rise: i32) -> f32 {
        const UNITS: f32 = (1u32 << (Pixels::FRACTION - Micrometres::FRACTION)) as f32;
        rise as f32 / self.length() as f32 * (UNITS * 3.0)
    }
}

/// A cubic's control points at a third and at two thirds of its interval.
type Controls = (Micrometres, Micrometres);

/// The control points of an interval's cubic, which lie in order between its knots. `before` and `after` are
/// the intervals to either side, where there are any.
fn controls(before: Option<Interval>, this: Interval, after: Option<Interval>) -> Controls {
    let (from, to) = (this.from.value, this.to.value);
    // A slope of at most 1.5 goes at most half of the way from either end. Half-way, the roundings from both
    // ends give the same value, so the control points do not pass each other.
    let third = |slope: f32| fraction(slope / 3.0);
    let first = third(slope_at_knot(this, before, after));
    let last = third(slope_at_knot(this, after, before));
    (between(from, to, first), between(to, from, last))
}

/// The curve's slope at a knot of an interval, as a multiple of the interval's secant. `beyond` is the
/// interval on the other side of the knot, `opposite` the one at the other end.
///
/// If both intervals rise or both fall: the harmonic mean of their secants, weighted by their lengths. At a
/// turn: zero. At the curve's end: the slope of the parabola through three knots. The slope is at most 1.5
/// times the lesser secant, so that control points keep their order. (PCHIP as usual has up to 3, which
/// differs where a secant is more than about three times its neighbour.)
fn slope_at_knot(this: Interval, beyond: Option<Interval>, opposite: Option<Interval>) -> f32 {
    let length = this.length() as f32;
    // This secant over another. The products are less than 2^64, so the quotient is finite, unless the
    // other's rise is zero.
    let ratio = |other: Interval| {
        (this.rise() as f32 * other.length() as f32) / (other.rise() as f32 * length)
    };
    match (beyond, opposite) {
        (Some(beyond), _) => {
            let ratio = ratio(beyond);
            // False for not-a-number, which two secants of zero give.
            if ratio > 0.0 {
                let other = beyond.length() as f32;
                let mean = 3.0 * (length + other)
                    / ((2.0 * length + other) * ratio + (length + 2.0 * other));
                let most = if ratio > 1.0 { 1.5 / ratio } else { 1.5 };
                limited(mean, 0.0, most)
            } else {
                0.0
            }
        }
        (None, Some(opposite)) => {
            let other = opposite.length() as f32;
            let parabola = 1.0 + length / (length + other) * (1.0 - 1.0 / ratio(opposite));
            limited(parabola, 0.5, 1.5)
        }
        (None, None) => 1.0,
    }
}

/// Converts a part of the way, from 0 to 1, to Q0.31, as exactly as the 24 bits of an f32 allow. Not-a-number
/// becomes 0, and 1 becomes 1 - 2^-31.
fn fraction(part: f32) -> i32 {
    // The product is exact, being by a power of two.
    numeric::whole_i32(part * (1u32 << 31) as f32)
}

/// Goes from one value a part (Q0.31, 0 or more) of the way towards another, and rounds. The two differ by
/// less than [`MAX_RISE`].
///
/// Monotone in each argument. With d = to - from the result is from + round(d part). It never falls as `to`
/// rises, nor as `from` rises, because part is at most 1. As `part` rises the result goes the way of d. At
/// the largest part the result is `to`, because d 2^-31 is less than a half.
const fn between(from: Micrometres, to: Micrometres, part: i32) -> Micrometres {
    // Twice the rise is below 2^31, and its product with the part below 2^62. The sum lies between from and
    // to, both times 2^32, and a half more: one instruction of the chip (SMMLAR).
    let rise = to.to_bits().wrapping_sub(from.to_bits());
    let twice = numeric::mul_i32(rise, 2);
    let from = from.to_bits() as i64 * (1 << 32) + (1 << 31);
    let sum = numeric::add_i64(from, twice as i64 * part as i64);
    Micrometres::from_bits((sum >> 32) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes intervals that follow each other, from 0, of these lengths and rises.
    fn intervals<const N: usize>(steps: [(f32, f32); N]) -> [Interval; N] {
        let (mut centre, mut value) = (0.0, 0.0);
        steps.map(|(length, rise)| {
            let at = |centre, value| Knot {
                centre: Pixels::from_f32(centre),
                value: Micrometres::from_f32(value),
            };
            let from = at(centre, value);
            (centre, value) = (centre + length, value + rise);
            Interval {
                from,
                to: at(centre, value),
            }
        })
    }

    #[test]
    fn slopes_at_knots_are_those_of_pchip() {
        let [a, b] = intervals([(2.0, 6.0), (1.0, 5.0)]);
        // Secants 3 and 5, weights 2 * 1 + 2 = 4 and 1 + 2 * 2 = 5: 9 / (4/3 + 5/5) = 27/7.
        assert!((slope_at_knot(a, Some(b), None) - 27.0 / 7.0 / 3.0).abs() < 1e-6);
        assert!((slope_at_knot(b, Some(a), None) - 27.0 / 7.0 / 5.0).abs() < 1e-6);
        // The parabola's slope at the first knot: ((2 * 2 + 1) * 3 - 2 * 5) / 3 = 5/3; at the last: (4 * 5 -
        // 3) / 3 = 17/3.
        assert!((slope_at_knot(a, None, Some(b)) - 5.0 / 9.0).abs() < 1e-6);
        assert!((slope_at_knot(b, None, Some(a)) - 17.0 / 15.0).abs() < 1e-6);
        assert_eq!(slope_at_knot(a, None, None), 1.0);
        // A turn, and a level neighbour.
        let [up, down, level, still] = intervals([(1.0, 1.0), (1.0, -2.0), (1.0, 0.0), (1.0, 0.0)]);
        assert_eq!(slope_at_knot(up, Some(down), None), 0.0);
        assert_eq!(slope_at_knot(down, Some(level), None), 0.0);
        assert_eq!(slope_at_knot(level, Some(down), None), 0.0);
        assert_eq!(slope_at_knot(level, Some(still), None), 0.0);
        // Much steeper than the neighbour: 1.5 times the neighbour's secant, seen from either side.
        let [flat, steep] = intervals([(1.0, 1.0), (1.0, 100.0)]);
        assert_eq!(slope_at_knot(flat, Some(steep), None), 1.5);
        assert_eq!(slope_at_knot(steep, Some(flat), None), 0.015);
        assert_eq!(slope_at_knot(flat, None, Some(steep)), 0.5);
        assert_eq!(slope_at_knot(steep, None, Some(flat)), 1.495);
    }

    #[test]
    fn between_goes_all_the_way_and_never_back() {
        let at = Micrometres::from_bits;
        let most = MAX_RISE as i32 - 1;
        for (from, to) in [
            (0, 5),
            (5, 0),
            (-3, most - 3),
            (i32::MAX, i32::MAX - most),
            (i32::MIN, i32::MIN + most),
            (i32::MIN + most, i32::MIN),
            (7, 7),
        ] {
            assert_eq!(between(at(from), at(to), fraction(0.0)), at(from));
            assert_eq!(between(at(from), at(to), fraction(1.0)), at(to));
            let half = fraction(0.5);
            let back = between(at(to), at(from), half);
            assert_eq!(between(at(from), at(to), half), back);
            let mut last = from;
            for part in (0..=i32::MAX).step_by(i32::MAX as usize / 1009) {
                let now = between(at(from), at(to), part).to_bits();
                assert!(if from <= to { now >= last } else { now <= last });
                last = now;
            }
        }
    }
}
