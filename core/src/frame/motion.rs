//! How the rows' centres move during the frame: a straight line through them.

use super::{Member, number, square};

/// A straight line through the rows, weighted.
pub(super) struct Line {
    /// Pixels a row.
    pub slope: f32,
    /// The place where the line is best known: the mean place of the rows, from the middle of the frame.
    pub middle: f32,
    /// The line's value at that place, in pixels from the frame's origin.
    pub centre: f32,
    /// The weighted sum of the squares of the rows' places, taken from `middle`. It is the inverse of the
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
        let (middle, centre) = (mean_of(|it| it.place), mean_of(|it| it.offset));
        let moment: f32 = (members.iter())
            .map(|it| it.weight * square(it.place - middle))
            .sum();
        let products: f32 = (members.iter())
            .map(|it| it.weight * (it.place - middle) * (it.offset - centre))
            .sum();
        (weights > 0.0 && moment > 0.0).then(|| Self {
            slope: products / moment,
            middle,
            centre,
            moment,
        })
    }

    /// The line's value at a row's place.
    pub fn at(&self, place: f32) -> f32 {
        self.centre + self.slope * (place - self.middle)
    }

    /// Whether the target moves: the slope is more than chance, and more than the rows' scatter makes it.
    fn is_motion(&self, members: &[Member<'_>]) -> bool {
        let rest: f32 = (members.iter())
            .map(|it| it.weight * square(it.offset - self.at(it.place)))
            .sum();
        let counting = number(members, |it| it.weight > 0.0);
        // More than two, or the line goes through all of them.
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
