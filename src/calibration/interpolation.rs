//! Between two knots: a straight line, or a monotone cubic (PCHIP; F. Fritsch and J. Butland, 1984).
//!
//! The value is whole steps of Q24.8 from integers alone, all of it from [`between`], which never falls where one of its
//! arguments rises. A cubic is evaluated as straight lines between straight lines (P. de Casteljau, 1959): where its four
//! control points are in order, so are the points of each round, and what comes out rises or falls with the centre to the
//! last bit.
//!
//! Error: at most 2^-22 of the difference between the two knots (the fraction of the way and the control points have 24
//! bits), and three steps.

use super::knots::Knot;
use crate::estimator::plausible::limited;
use crate::units::{Micrometres, Pixels};

/// A part of the way, Q2.30: from 0 to this.
const WHOLE: i32 = 1 << FRACTION;
const FRACTION: u32 = 30;

/// Two neighbouring knots: the first lies before the second, and their values differ by less than 2^31 steps.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    pub from: Knot,
    pub to: Knot,
}

impl Interval {
    /// In steps of Q16.16 pixels. Neighbours are in order, so the difference fits an u32.
    const fn length(&self) -> u32 {
        self.way(self.to.centre)
    }

    /// From the first knot to a centre that does not lie before it, in steps of Q16.16 pixels.
    const fn way(&self, centre: Pixels) -> u32 {
        centre.to_bits().wrapping_sub(self.from.centre.to_bits()) as u32
    }

    /// In steps of Q24.8 micrometres. Neighbours differ by less than 2^31 of them.
    pub const fn rise(&self) -> i32 {
        let (from, to) = (self.from.value.to_bits(), self.to.value.to_bits());
        to.wrapping_sub(from)
    }

    /// The value at a centre of the interval on a straight line, and its slope in micrometres a pixel.
    pub fn linear(&self, centre: Pixels) -> (Micrometres, f32) {
        let part = fraction(self.way(centre) as f32 / self.length() as f32);
        (
            between(self.from.value, self.to.value, part),
            self.per_pixel(self.rise() as f32),
        )
    }

    /// The same on a cubic with two further control points.
    pub fn cubic(&self, centre: Pixels, controls: Controls) -> (Micrometres, f32) {
        let way = self.way(centre) as f32 / self.length() as f32;
        let part = fraction(way);
        let (from, to) = (self.from.value, self.to.value);
        let first = between(from, controls.0, part);
        let middle = between(controls.0, controls.1, part);
        let last = between(controls.1, to, part);
        let value = between(
            between(first, middle, part),
            between(middle, last, part),
            part,
        );
        // The derivative is a parabola with the control points' differences for its own.
        let [first, middle, last] = self.differences(controls);
        let left = 1.0 - way;
        let rise = left * (left * first + 2.0 * way * middle) + way * way * last;
        (value, self.per_pixel(3.0 * rise))
    }

    /// The largest slope, without sign, that the straight line or the cubic has, in micrometres a pixel.
    pub fn steepest(&self, controls: Option<Controls>) -> f32 {
        let Some(controls) = controls else {
            return self.per_pixel(self.rise() as f32).abs();
        };
        // A parabola lies between the largest and the least of its control points.
        let [first, middle, last] = self.differences(controls).map(f32::abs);
        let most = if first > last { first } else { last };
        let most = if middle > most { middle } else { most };
        self.per_pixel(3.0 * most)
    }

    /// Steps of Q24.8 micrometres over the interval as micrometres a pixel. A step is at most 2^32 times 2^-8, and an
    /// interval at least a sixteenth of a pixel: below 2^30.
    fn per_pixel(&self, rise: f32) -> f32 {
        const UNITS: f32 = (1u32 << (Pixels::FRACTION - Micrometres::FRACTION)) as f32;
        rise / self.length() as f32 * UNITS
    }

    /// From each control point to the next. They lie between the knots: no difference exceeds the rise.
    fn differences(&self, controls: Controls) -> [f32; 3] {
        let step = |from: Micrometres, to: Micrometres| to.to_bits().wrapping_sub(from.to_bits());
        [
            step(self.from.value, controls.0) as f32,
            step(controls.0, controls.1) as f32,
            step(controls.1, self.to.value) as f32,
        ]
    }
}

/// A cubic's control points at a third and at two thirds of its interval.
pub type Controls = (Micrometres, Micrometres);

/// The control points of an interval's cubic, which lie in order between its knots. `before` and `after` are the intervals
/// to either side, where there are any.
pub fn controls(before: Option<Interval>, this: Interval, after: Option<Interval>) -> Controls {
    let (from, to) = (this.from.value, this.to.value);
    // At most half of the way from either end, so that they do not pass each other.
    let third = |slope: f32| fraction(slope / 3.0).clamp(0, WHOLE / 2);
    let first = third(slope_at_knot(this, before, after));
    let last = third(slope_at_knot(this, after, before));
    (between(from, to, first), between(from, to, WHOLE - last))
}

/// The curve's slope at a knot of an interval, as a multiple of the interval's secant. `beyond` is the interval on the other
/// side of the knot, `opposite` the one at the other end.
///
/// Where both sides rise or both fall, the harmonic mean of their secants, weighted by their lengths; at a turn zero; at the
/// curve's end that of the parabola through three knots. At most 1.5 times the lesser secant, so that control points keep
/// their order (PCHIP as usual has up to 3, which differs where a secant is more than about three times its neighbour).
fn slope_at_knot(this: Interval, beyond: Option<Interval>, opposite: Option<Interval>) -> f32 {
    let length = this.length() as f32;
    // This secant over another: products of less than 2^64, so the quotient is finite or the other's rise is zero.
    let ratio = |other: Interval| {
        (this.rise() as f32 * other.length() as f32) / (other.rise() as f32 * length)
    };
    match (beyond, opposite) {
        (Some(beyond), _) => {
            let ratio = ratio(beyond);
            // Not so for not-a-number, from two secants of zero.
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

/// A part of the way from 0 to 1 in Q2.30: exact to the 24 bits of an f32. Not-a-number becomes 0.
fn fraction(part: f32) -> i32 {
    // The product is exact: a power of two.
    (part * WHOLE as f32) as i32
}

/// From one value so far towards another (part 0 to [`WHOLE`]), rounded. They differ by less than 2^31 steps.
///
/// Monotone in each argument: with d = to - from, from + round(d part) falls nowhere where `to` or, as part is at most 1,
/// `from` rises; and as `part` rises it goes the way of d.
const fn between(from: Micrometres, to: Micrometres, part: i32) -> Micrometres {
    let rise = to.to_bits().wrapping_sub(from.to_bits());
    // Below 2^31 times 2^30, and a half; as part is at most 1, what is shifted down lies between 0 and rise.
    let step = (rise as i64 * part as i64 + (1 << (FRACTION - 1))) >> FRACTION;
    Micrometres::from_bits(from.to_bits().wrapping_add(step as i32))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths and rises of intervals that follow each other, from 0.
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
        // The parabola's slope at the first knot: ((2 * 2 + 1) * 3 - 2 * 5) / 3 = 5/3; at the last: (4 * 5 - 3) / 3 = 17/3.
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
        for (from, to) in [(0, 5), (5, 0), (-3, i32::MAX - 3), (i32::MAX, 1), (7, 7)] {
            assert_eq!(between(at(from), at(to), 0), at(from));
            assert_eq!(between(at(from), at(to), WHOLE), at(to));
            let mut last = from;
            for part in (0..=WHOLE).step_by(WHOLE as usize / 1009) {
                let now = between(at(from), at(to), part).to_bits();
                assert!(if from <= to { now >= last } else { now <= last });
                last = now;
            }
        }
    }
}
