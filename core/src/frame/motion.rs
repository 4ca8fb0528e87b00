//! How the rows' centres move during the frame: a straight line through them, and a parabola.

use super::{Member, count_where, total};
use crate::base::numeric::{at_least, square};

/// From so many rows on, the rows can show a motion: their own scatter then tells how large a slope chance
/// gives.
pub(super) const ENOUGH: usize = 8;

/// How the target moves during a frame.
pub(super) struct Course {
    /// The speed of the steady motion in pixels a row, zero for a target at rest. The members' offsets are
    /// without this motion.
    pub speed: f32,
    /// The inverse of the variance that the speed has, if the target moves.
    pub moment: f32,
    /// The motion that remains, if the target accelerates.
    pub parabola: Option<Parabola>,
}

impl Course {
    /// Describes the motion of rows from which the motion `speed` is subtracted. The speed comes from the
    /// weights of `members`, the parabola from those of `certain`: the same rows with weights of 1/u^2.
    pub fn of(members: &[Member<'_>], certain: &[Member<'_>], speed: f32) -> Self {
        Self {
            speed,
            moment: if speed == 0.0 {
                f32::INFINITY
            } else {
                Line::through(members).map_or(f32::INFINITY, |line| line.moment)
            },
            parabola: (certain.len() >= ENOUGH)
                .then(|| Parabola::through(certain))
                .flatten()
                .filter(|it| it.is_motion(1.0)),
        }
    }
}

/// A straight line through the rows, weighted.
pub(super) struct Line {
    /// Pixels a row.
    pub slope: f32,
    /// The weighted mean of the rows' numbers, from the middle of the frame. The line is best known there.
    pub middle: f32,
    /// The line's value at `middle`, in pixels from the frame's origin.
    pub centre: f32,
    /// The weighted sum of the squares of the rows' numbers, taken from `middle`. It is the inverse of the
    /// slope's variance, if the weights are 1/u^2.
    pub moment: f32,
    weights: f32,
}

/// A slope counts as motion if it is so many times its standard deviation. Rows at rest with normal errors
/// get there in 0.7 % of frames of eight rows, and in fewer of larger frames. To take them for moving then
/// costs only a little certainty.
const SIGNIFICANT: f32 = 4.0;

impl Line {
    /// Fits the line. `None` for fewer than two rows that count.
    pub fn through(members: &[Member<'_>]) -> Option<Self> {
        let (mut weights, mut numbers, mut offsets) = (0.0, 0.0, 0.0);
        for member in members {
            weights += member.weight;
            numbers += member.weight * member.rows_from_middle;
            offsets += member.weight * member.offset;
        }
        let (middle, centre) = (numbers / weights, offsets / weights);
        let (mut moment, mut products) = (0.0, 0.0);
        for member in members {
            let x = member.rows_from_middle - middle;
            moment += member.weight * square(x);
            products += member.weight * x * (member.offset - centre);
        }
        (weights > 0.0 && moment > 0.0).then(|| Self {
            slope: products / moment,
            middle,
            centre,
            moment,
            weights,
        })
    }

    /// The line's value at a row, in pixels from the frame's origin.
    pub fn at(&self, rows_from_middle: f32) -> f32 {
        self.centre + self.slope * (rows_from_middle - self.middle)
    }

    /// Whether the target moves: the slope is more than chance, and more than the rows' scatter makes it.
    fn is_motion(&self, members: &[Member<'_>]) -> bool {
        let counting = count_where(members, |it| it.weight > 0.0);
        // The scatter about the line has two degrees of freedom fewer than there are rows. Two rows have
        // none left: the line goes through both, so they cannot show motion beyond their noise.
        if counting <= 2 {
            return false;
        }
        let rest: f32 = (members.iter())
            .map(|it| it.weight * square(it.offset - self.at(it.rows_from_middle)))
            .sum();
        let variance = at_least(rest / (counting as f32 - 2.0), 1.0);
        square(self.slope) * self.moment > square(SIGNIFICANT) * variance
    }
}

/// A parabola through the rows, weighted: a line, and a curvature times a shape that no line describes.
///
/// With x the row's number from the line's middle, the shape is x^2 - skew x - mean_square. Its weighted sums
/// with 1 and with x are zero, so the line is the one through the rows alone.
pub(super) struct Parabola {
    line: Line,
    /// Pixels a row^2: half of the target's acceleration.
    curvature: f32,
    skew: f32,
    mean_square: f32,
    /// The square of the curvature over its standard deviation.
    significance: f32,
}

impl Parabola {
    /// Fits the parabola. `None` for fewer than four rows that count.
    fn through(members: &[Member<'_>]) -> Option<Self> {
        let line = Line::through(members)?;
        let counting = count_where(members, |it| it.weight > 0.0);
        // The parabola has three parameters: nothing is left of three rows.
        if counting <= 3 {
            return None;
        }
        let x = |it: &Member<'_>| it.rows_from_middle - line.middle;
        let rest = |it: &Member<'_>| it.offset - line.at(it.rows_from_middle);
        // |x|^3 is at most 63 x^2, so the skew is at most 63 and the shape below 2^14.
        let skew = total(members, |it| it.weight * x(it) * square(x(it))) / line.moment;
        let mean_square = line.moment / line.weights;
        let shape = |it: &Member<'_>| square(x(it)) - skew * x(it) - mean_square;
        let (mut moment, mut products) = (0.0, 0.0);
        for member in members {
            let shape = shape(member);
            moment += member.weight * square(shape);
            products += member.weight * shape * rest(member);
        }
        let curvature = products / moment;
        let squares = total(members, |it| {
            it.weight * square(rest(it) - curvature * shape(it))
        });
        let variance = at_least(squares / (counting as f32 - 3.0), 1.0);
        (moment > 0.0).then_some(Self {
            line,
            curvature,
            skew,
            mean_square,
            significance: square(curvature) * moment / variance,
        })
    }

    /// The parabola's value at a row, in pixels from the frame's origin.
    pub fn at(&self, rows_from_middle: f32) -> f32 {
        let x = rows_from_middle - self.line.middle;
        let shape = square(x) - self.skew * x - self.mean_square;
        self.line.at(rows_from_middle) + self.curvature * shape
    }

    /// Whether the target accelerates: the curvature is more than chance, and more than the rows' scatter
    /// makes it. `growth` is the factor by which the scatter makes the mean less certain than independent
    /// errors would.
    pub fn is_motion(&self, growth: f32) -> bool {
        self.significance > square(SIGNIFICANT * growth)
    }
}

/// The motion of the target in pixels a row, if it moves.
pub(super) fn of(members: &[Member<'_>]) -> Option<f32> {
    let line = Line::through(members)?;
    line.is_motion(members).then_some(line.slope)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::tests::row;

    /// What eight rows show of which some count. Their places are a function of their numbers from the
    /// middle, and each row claims an uncertainty of 0.02 pixels.
    fn of_eight<T>(
        counting: &[usize],
        place: impl Fn(f32) -> f32,
        show: impl Fn(&[Member<'_>]) -> Option<T>,
    ) -> Option<T> {
        let row = row(0.0, 0.02).expect("a centre");
        let members: [Member<'_>; 8] = core::array::from_fn(|number| Member {
            row: &row,
            rows_from_middle: number as f32 - 3.5,
            offset: place(number as f32 - 3.5),
            uncertainty: 0.02,
            weight: if counting.contains(&number) {
                2500.0
            } else {
                0.0
            },
        });
        show(&members)
    }

    fn motion(counting: &[usize], speed: f32) -> Option<f32> {
        of_eight(counting, |x| speed * x, of)
    }

    fn parabola(counting: &[usize], place: impl Fn(f32) -> f32) -> Option<Parabola> {
        of_eight(counting, place, Parabola::through)
    }

    #[test]
    fn a_parabola_goes_through_the_rows_of_a_target_that_accelerates() {
        let place = |x: f32| 0.7 - 0.3 * x + 0.05 * x * x;
        for counting in [
            &[0, 1, 2, 3, 4, 5, 6, 7][..],
            &[0, 1, 2, 3, 4],
            &[1, 4, 6, 7],
        ] {
            let found = parabola(counting, place).expect("a parabola");
            for x in [-3.5, -0.5, 0.0, 3.5] {
                assert!((found.at(x) - place(x)).abs() < 1e-5, "{counting:?} {x}");
            }
            assert!(found.is_motion(1.0), "{counting:?}");
        }
        // Nothing is left of three rows.
        assert!(parabola(&[0, 3, 7], place).is_none());
    }

    /// Eight rows: the squares of the shape x^2 - 21/4 sum to 168. A curvature of four standard deviations is
    /// 4 * 0.02 / sqrt(168) = 0.00617.
    #[test]
    fn a_curvature_counts_from_four_standard_deviations_on() {
        let all = [0, 1, 2, 3, 4, 5, 6, 7];
        for (curvature, growth, is_motion) in [
            (0.0061, 1.0, false),
            (0.0063, 1.0, true),
            (-0.0063, 1.0, true),
            (0.0122, 2.0, false),
            (0.0125, 2.0, true),
        ] {
            let found = parabola(&all, |x| 0.2 * x + curvature * x * x).expect("a parabola");
            assert_eq!(found.is_motion(growth), is_motion, "{curvature}");
        }
    }

    #[test]
    fn two_rows_show_no_motion() {
        for speed in [0.1, 1.0, 1.1, 3.7] {
            for other in 1..8 {
                assert_eq!(motion(&[0, other], speed), None, "{speed} {other}");
            }
            let found = motion(&[0, 3, 7], speed).expect("a motion");
            assert!((found - speed).abs() < 1e-3 * speed, "{found}");
        }
    }
}
