//! How the rows' centres move during the frame: a straight line through them.

use super::{Member, count_where, square};

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
}

/// A slope counts as motion if it is so many times its standard deviation. Rows at rest with normal errors
/// get there in 0.7 % of frames of eight rows, and in fewer of larger frames. To take them for moving then
/// costs only a little certainty.
const SIGNIFICANT: f32 = 4.0;

impl Line {
    /// Fits the line. `None` for fewer than two rows that count.
    pub fn through(members: &[Member<'_>]) -> Option<Self> {
        let weights: f32 = members.iter().map(|it| it.weight).sum();
        let mean_of = |value: fn(&Member<'_>) -> f32| {
            members.iter().map(|it| it.weight * value(it)).sum::<f32>() / weights
        };
        let (middle, centre) = (mean_of(|it| it.rows_from_middle), mean_of(|it| it.offset));
        let moment: f32 = (members.iter())
            .map(|it| it.weight * square(it.rows_from_middle - middle))
            .sum();
        let products: f32 = (members.iter())
            .map(|it| it.weight * (it.rows_from_middle - middle) * (it.offset - centre))
            .sum();
        (weights > 0.0 && moment > 0.0).then(|| Self {
            slope: products / moment,
            middle,
            centre,
            moment,
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
        let variance = rest / (counting as f32 - 2.0);
        let variance = if variance > 1.0 { variance } else { 1.0 };
        square(self.slope) * self.moment > square(SIGNIFICANT) * variance
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

    /// The motion that eight rows show if only some of them count. The target moves by `speed` pixels a row,
    /// and each row claims an uncertainty of 0.02 pixels.
    fn motion(counting: &[usize], speed: f32) -> Option<f32> {
        let row = row(0.0, 0.02).expect("a centre");
        let members: [Member<'_>; 8] = core::array::from_fn(|number| Member {
            row: &row,
            rows_from_middle: number as f32 - 3.5,
            offset: speed * number as f32,
            uncertainty: 0.02,
            weight: if counting.contains(&number) {
                2500.0
            } else {
                0.0
            },
        });
        of(&members)
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
