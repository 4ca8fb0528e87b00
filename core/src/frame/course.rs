//! What the rows show over the time of the frame: the target's motion, as a straight line or a parabola, and
//! errors that neighbours share.
//!
//! Speckle, a lamp that flickers or air that moves gives neighbouring rows similar errors. Their mean is then
//! less certain than their number says, and so is their scatter. With r_k the autocorrelation of the
//! residuals at lag k, the variance of the mean grows by 1 + 2 (r_1 + r_2 + ...). The terms are added in
//! pairs of neighbours. The sum ends at the first pair that is not positive, and a pair counts no more than
//! the one before (the initial monotone sequence of C. J. Geyer, Statist. Sci. 7, 473 (1992)).
//!
//! A straight line through the residuals is subtracted first, because a steady motion of the target is no
//! error.

use heapless::Vec;

use super::mean::{copy, is_more_than_chance};
use super::{FEWEST_INDEPENDENT, MAX_ROWS, Member, Members, count_where, total};
use crate::base::numeric::{at_least, at_most, limited, square, whole_u16};

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
    parabola: Option<Parabola>,
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
struct Line {
    /// Pixels a row.
    slope: f32,
    /// The weighted mean of the rows' numbers, from the middle of the frame. The line is best known there.
    middle: f32,
    /// The line's value at `middle`, in pixels from the frame's origin.
    centre: f32,
    /// The weighted sum of the squares of the rows' numbers, taken from `middle`. It is the inverse of the
    /// slope's variance, if the weights are 1/u^2.
    moment: f32,
    weights: f32,
}

/// A slope counts as motion if it is so many times its standard deviation. Rows at rest with normal errors
/// get there in 0.7 % of frames of eight rows, and in fewer of larger frames. To take them for moving then
/// costs only a little certainty.
const SIGNIFICANT: f32 = 4.0;

impl Line {
    /// Fits the line. `None` for fewer than two rows that count.
    fn through(members: &[Member<'_>]) -> Option<Self> {
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
    fn at(&self, rows_from_middle: f32) -> f32 {
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
struct Parabola {
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
    fn at(&self, rows_from_middle: f32) -> f32 {
        let x = rows_from_middle - self.line.middle;
        let shape = square(x) - self.skew * x - self.mean_square;
        self.line.at(rows_from_middle) + self.curvature * shape
    }

    /// Whether the target accelerates: the curvature is more than chance, and more than the rows' scatter
    /// makes it. `growth` is the factor by which the scatter makes the mean less certain than independent
    /// errors would.
    fn is_motion(&self, growth: f32) -> bool {
        self.significance > square(SIGNIFICANT * growth)
    }
}

/// The motion of the target in pixels a row, if it moves.
pub(super) fn speed(members: &[Member<'_>]) -> Option<f32> {
    let line = Line::through(members)?;
    line.is_motion(members).then_some(line.slope)
}

/// How the rows scatter about their motion.
pub(super) struct Fluctuation {
    /// The number of parameters that come from the rows themselves: 1 for their mean, 2 with a speed, 3 with
    /// an acceleration.
    pub fitted: f32,
    /// What the rows are worth, if neighbours have similar errors.
    pub correlated: Option<Correlated>,
    /// How far the mean of the positions lies off the position in the middle of the frame, because the target
    /// accelerates. In pixels, not negative.
    pub shift: f32,
}

impl Fluctuation {
    /// Compares the rows with their line. If the target accelerates, compares the rows with their parabola,
    /// and subtracts the parabola from the members without changing their mean.
    ///
    /// Speckle, a lamp that flickers or a target that swings make rows similar to their neighbours beside the
    /// parabola too. If the curvature does not exceed what such errors cause, all of it counts as scatter.
    pub fn about(members: &mut Members<'_>, course: &Course) -> Self {
        if let Some(parabola) = &course.parabola {
            let place = |it: &Member<'_>| parabola.at(it.rows_from_middle);
            let mean = total(members, |it| it.weight * place(it)) / total(members, |it| it.weight);
            let mut straight = Members::new();
            copy(members, &mut straight, |it| Member {
                offset: it.offset - (place(it) - mean),
                ..*it
            });
            let fitted = 3.0;
            let correlated = Correlated::of(&straight, fitted);
            if parabola.is_motion(correlated.map_or(1.0, |it| it.growth)) {
                *members = straight;
                return Self {
                    fitted,
                    correlated,
                    shift: (mean - parabola.at(0.0)).abs(),
                };
            }
        }
        let fitted = if course.speed == 0.0 { 1.0 } else { 2.0 };
        Self {
            fitted,
            correlated: Correlated::of(members, fitted),
            shift: 0.0,
        }
    }
}

/// What rows with similar errors are worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Correlated {
    /// The number of independent rows that give the same uncertainty.
    rows: f32,
    /// The factor by which the uncertainty of their mean grows.
    pub growth: f32,
}

/// The sum of autocorrelations is too small, because the mean and the line come from the same rows. For n
/// rows with a true sum t it is t / (1 + 6.5 t/n). This holds within 10 % of the median for t of 2 to 16, for
/// rows that each depend on the one before.
const LOST: f32 = 6.5;
/// The estimated number of independent rows may be so many times too large. In one frame of twenty it is.
const MARGIN: f32 = 2.5;
/// The least excess of the neighbours' autocorrelation over that of independent rows, in standard deviations.
/// 0.2 % of the frames of independent rows exceed it.
const SIMILAR: f32 = 2.88;
/// The same for rows that scatter more than their noise explains. Other causes than noise seldom differ from
/// row to row, so a weaker sign is enough; one frame of six shows it by chance.
const SIMILAR_IN_EXCESS: f32 = 1.0;

impl Correlated {
    /// What the rows are worth, if neighbours have similar errors by more than chance. `None` otherwise, and
    /// for too few rows. `fitted` as in [`Fluctuation`].
    fn of(members: &[Member<'_>], fitted: f32) -> Option<Self> {
        if members.len() < usize::from(FEWEST_INDEPENDENT) {
            return None;
        }
        let n = members.len() as f32;
        let residuals = residuals(members)?;
        let squares: f32 = residuals.iter().copied().map(square).sum();
        // Rows that agree to the last bit, or lie on a line.
        if squares <= 0.0 {
            return None;
        }
        let correlation = |lag: usize| {
            let later = residuals.iter().skip(lag);
            let products: f32 = (residuals.iter().zip(later)).map(|(a, b)| a * b).sum();
            products / squares
        };
        // For independent rows, the autocorrelation of neighbours has a mean of -2/n, from the mean and the
        // line, and a standard deviation of (1 - 2/n) / sqrt(n). Mean and line take a degree of freedom each.
        let significant = if is_more_than_chance(squares, n - 2.0) {
            SIMILAR_IN_EXCESS
        } else {
            SIMILAR
        };
        let chance = significant * (1.0 - 2.0 / n) / dual_mac::square_root(n) - 2.0 / n;
        if correlation(1) <= chance {
            return None;
        }
        let mut sum = -1.0;
        let mut before = f32::INFINITY;
        for lag in (0..members.len() / 2).step_by(2) {
            let pair = correlation(lag) + correlation(lag + 1);
            if pair <= 0.0 {
                break;
            }
            before = at_most(pair, before);
            sum += 2.0 * before;
        }
        // The sum is above 1, because its first pair is.
        let rows = limited(n / sum - LOST, 1.0, n);
        // The variance of independent rows about their mean is (rows - 1) / rows of that about the truth.
        let free = limited(rows - fitted, 1.0, n);
        Some(Self {
            rows,
            growth: dual_mac::square_root(n / free),
        })
    }

    /// The least number of independent rows that these may be worth, at least one. `None` if the number is
    /// [`FEWEST_INDEPENDENT`] or more, which is enough.
    pub fn rows_if_few(self) -> Option<u16> {
        let rows = whole_u16(self.rows / MARGIN).max(1);
        (rows < FEWEST_INDEPENDENT).then_some(rows)
    }
}

/// The residuals of the rows from a straight line, each in the row's own uncertainty. Their mean is zero.
fn residuals(members: &[Member<'_>]) -> Option<Vec<f32, { MAX_ROWS as usize }>> {
    let line = Line::through(members)?;
    let mut residuals = Vec::new();
    let mut sum = 0.0;
    for member in members {
        let residual = member.residual(line.at(member.rows_from_middle));
        sum += residual;
        // There is room for all rows.
        let _ = residuals.push(residual);
    }
    let mean = sum / members.len() as f32;
    residuals.iter_mut().for_each(|residual| *residual -= mean);
    Some(residuals)
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
        of_eight(counting, |x| speed * x, super::speed)
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

    /// What rows with these offsets in pixels are worth, if each claims an uncertainty of 0.02.
    fn worth(offsets: impl Iterator<Item = f32>) -> Option<Correlated> {
        let row = row(0.0, 0.02).expect("a centre");
        let members: std::vec::Vec<Member<'_>> = (offsets.zip(0u8..))
            .map(|(offset, number)| Member {
                row: &row,
                rows_from_middle: f32::from(number),
                offset,
                uncertainty: 0.02,
                weight: 1.0,
            })
            .collect();
        Correlated::of(&members, 1.0)
    }

    #[test]
    fn neighbours_that_err_alike_are_worth_few() {
        // A wave of 32 rows: the 64 rows are worth no more than one or two independent ones.
        let wave = worth((0..64).map(|i| 0.5 * libm::sinf(i as f32 * 0.196))).expect("a finding");
        assert_eq!(wave.rows_if_few(), Some(1), "{wave:?}");
        assert!((4.0..=8.0).contains(&wave.growth), "{wave:?}");
        // Random steps of four rows each: the 64 rows are worth 16.
        let steps = [3, -1, 2, -4, 1, 5, -2, -3, 4, 0, -5, 1, 2, -1, -4, 3];
        let steps = worth((0..64).map(|i| 0.01 * steps[i / 4] as f32)).expect("a finding");
        assert!((8.0..=24.0).contains(&steps.rows), "{steps:?}");
        assert!((1.6..=2.6).contains(&steps.growth), "{steps:?}");
    }

    /// The margin of 2.5 may take 8 from 20, which is enough.
    #[test]
    fn eight_independent_rows_are_enough() {
        let rows_if_few = |rows| Correlated { rows, growth: 1.0 }.rows_if_few();
        for (rows, expected) in [(20.0, None), (19.9, Some(7)), (1.0, Some(1))] {
            assert_eq!(rows_if_few(rows), expected);
        }
    }

    #[test]
    fn motion_equal_rows_and_opposite_neighbours_are_no_correlation() {
        let found = |rows: usize, offset: fn(usize) -> f32| worth((0..rows).map(offset));
        for (case, found) in [
            ("steady motion", found(64, |i| 0.1 * i as f32)),
            ("rows that are equal", found(64, |_| 0.5)),
            ("opposite neighbours", found(64, |i| (i % 2) as f32)),
            ("too few rows to tell", found(7, |i| (i / 4) as f32)),
        ] {
            assert_eq!(found, None, "{case}");
        }
    }
}
