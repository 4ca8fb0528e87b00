//! Estimates how many independent rows the rows of a frame are worth.
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

use super::motion::Line;
use super::{FEWEST_INDEPENDENT, MAX_ROWS, Member, is_more_than_chance};
use crate::base::numeric::{at_most, limited, square, whole_u16};

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
const SIGNIFICANT: f32 = 2.88;
/// The same for rows that scatter more than their noise explains. Other causes than noise seldom differ from
/// row to row, so a weaker sign is enough; one frame of six shows it by chance.
const SIGNIFICANT_IN_EXCESS: f32 = 1.0;

impl Correlated {
    /// The least number of independent rows that these may be worth, at least one. `None` if the number is
    /// [`FEWEST_INDEPENDENT`] or more, which is enough.
    pub fn rows_if_few(self) -> Option<u16> {
        let rows = whole_u16(self.rows / MARGIN).max(1);
        (rows < FEWEST_INDEPENDENT).then_some(rows)
    }
}

/// What the rows are worth, if neighbours have similar errors by more than chance. `None` otherwise, and for
/// too few rows. `fitted` as in [`super::Fluctuation`].
pub(super) fn estimate(members: &[Member<'_>], fitted: f32) -> Option<Correlated> {
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
    // For independent rows, the autocorrelation of neighbours has a mean of -2/n, from the mean and the line,
    // and a standard deviation of (1 - 2/n) / sqrt(n). Mean and line take a degree of freedom each.
    let significant = if is_more_than_chance(squares, n - 2.0) {
        SIGNIFICANT_IN_EXCESS
    } else {
        SIGNIFICANT
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
    // For so many independent rows, the scatter about their mean is (rows - 1) / rows of that about the
    // truth.
    let free = limited(rows - fitted, 1.0, n);
    Some(Correlated {
        rows,
        growth: dual_mac::square_root(n / free),
    })
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

    /// What rows with these offsets in pixels are worth, if each claims an uncertainty of 0.02.
    fn of(offsets: impl Iterator<Item = f32>) -> Option<Correlated> {
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
        estimate(&members, 1.0)
    }

    #[test]
    fn neighbours_that_err_alike_are_worth_few() {
        // A wave of 32 rows: the 64 rows are worth no more than one or two independent ones.
        let wave = of((0..64).map(|i| 0.5 * libm::sinf(i as f32 * 0.196))).expect("a finding");
        assert_eq!(wave.rows_if_few(), Some(1), "{wave:?}");
        assert!((4.0..=8.0).contains(&wave.growth), "{wave:?}");
        // Random steps of four rows each: the 64 rows are worth 16.
        let steps = [3, -1, 2, -4, 1, 5, -2, -3, 4, 0, -5, 1, 2, -1, -4, 3];
        let steps = of((0..64).map(|i| 0.01 * steps[i / 4] as f32)).expect("a finding");
        assert!((8.0..=24.0).contains(&steps.rows), "{steps:?}");
        assert!((1.6..=2.6).contains(&steps.growth), "{steps:?}");
    }

    /// The margin of 2.5 may take 8 from 20, which is enough.
    #[test]
    fn eight_independent_rows_are_enough() {
        let worth = |rows| Correlated { rows, growth: 1.0 }.rows_if_few();
        for (rows, expected) in [(20.0, None), (19.9, Some(7)), (1.0, Some(1))] {
            assert_eq!(worth(rows), expected);
        }
    }

    #[test]
    fn motion_equal_rows_and_opposite_neighbours_are_no_correlation() {
        let found = |rows: usize, offset: fn(usize) -> f32| of((0..rows).map(offset));
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
