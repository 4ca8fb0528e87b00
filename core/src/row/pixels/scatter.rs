//! How far a pixel scatters from row to row, estimated from a few pixels of each row.

use crate::base::numeric;
use crate::row::{LARGEST_COUNT, Light};

/// Pixels whose scatter is followed. 64 pixels in 256 rows tell the variance to 1 %.
const FOLLOWED: usize = 64;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Scatter {
    /// The followed pixels of the row before.
    before: [u16; FOLLOWED],
    has_before: bool,
    /// The sum of the squared steps from row to row, less the step that all pixels share.
    squares: u64,
    /// How many rows have a row before them.
    steps: u32,
}

impl Scatter {
    pub(super) const NONE: Self = Self {
        before: [0; FOLLOWED],
        has_before: false,
        squares: 0,
        steps: 0,
    };

    /// Adds a row of counts of at most [`LARGEST_COUNT`].
    pub(super) fn add(&mut self, light: Light<'_>) {
        let stride = (light.len() / FOLLOWED).max(1);
        let (mut sum, mut squares) = (0i64, 0u64);
        for (before, count) in self.before.iter_mut().zip(light.iter().step_by(stride)) {
            let count = count.min(LARGEST_COUNT);
            let step = i64::from(count) - i64::from(*before);
            // 64 steps below 2^12: their sum is below 2^18, that of their squares below 2^30.
            sum = numeric::add_i64(sum, step);
            squares = numeric::add_u64(squares, (step * step).unsigned_abs());
            *before = count;
        }
        if self.has_before {
            // A lamp that flickers changes all pixels together. The mean of the steps is that change.
            let shared = numeric::mul_i64(sum, sum).unsigned_abs() / FOLLOWED as u64;
            self.squares = (self.squares).saturating_add(squares.saturating_sub(shared));
            self.steps = self.steps.saturating_add(1);
        }
        self.has_before = true;
    }

    /// The variance of a pixel's count in a row, in counts squared.
    pub(super) fn variance(&self) -> f32 {
        // A step has twice the variance of a row, and the shared step takes one of the pixels.
        let freedom = (FOLLOWED - 1) as f32 * 2.0 * self.steps.max(1) as f32;
        self.squares as f32 / freedom
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::uniform;

    #[test]
    fn the_variance_is_that_of_the_pixels_and_not_of_the_lamp() {
        let mut scatter = Scatter::NONE;
        let mut random = 1;
        // Pixels alternate by 6 counts, each in its own phase: a variance of 9. The lamp flickers by 100.
        for row in 0..256 {
            let light: [u16; 3648] = core::array::from_fn(|_| {
                1000 + row % 5 * 20 + u16::from(uniform(&mut random) < 0.5) * 6
            });
            scatter.add((&light).into());
        }
        let variance = scatter.variance();
        println!("{variance}");
        assert!((variance - 9.0).abs() < 0.5, "{variance}");
    }
}
