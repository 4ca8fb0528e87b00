//! How far the target's surface moves distances: what the points scatter beyond their noise.
//!
//! Speckle moves each point by e sqrt(usual height / height), where e rises with the distance (core,
//! `uncertainty`): e = c (d - D), with D of eq. (1), so that the zero of a stage does not matter. The usual
//! height is H (d - D)^q, which follows the laser, the slit and the material.
//!
//! With a comb, each point's uncertainty already holds the scatter of its slits. The points then scatter
//! further by the part that all slits share. This part does not follow the height.

use nalgebra::{Matrix2, Vector2};
use statistics::mean;

use crate::fit::curve::Curve;
use crate::fit::observed::Observed;
use crate::fit::solve::Solved;

/// The surface of the points' target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// c: standard deviation of a distance over d - D, of a spot of the usual height.
    pub share: f64,
    /// How well c is known, over itself.
    pub known_to: f64,
    /// Mean of the spots' heights in counts, in the middle of the points.
    pub height: f64,
    /// q: how the usual height changes with d - D, as a power.
    pub power: f64,
    /// d - D in the middle of the points, in metres.
    pub middle: f64,
}

/// The fewest degrees of freedom for an estimate: e is then known to 22 %.
const FEWEST_FREEDOMS: f64 = 10.0;

impl Surface {
    /// The surface that the points of a fit show. `None` where they have no heights, or are too few.
    pub fn of(solved: &Solved, curve: &Curve) -> Option<Self> {
        let is_comb = solved.points.iter().any(|point| point.slits.is_some());
        let points: Vec<(Observed, f64)> = (solved.observed.iter())
            .map(|point| Some((*point, point.height.or(is_comb.then_some(1.0))?)))
            .collect::<Option<_>>()?;
        let freedom = points.len() as f64 - curve.freedoms();
        if freedom < FEWEST_FREEDOMS {
            return None;
        }
        let from_pole = |point: &Observed| (point.distance - curve.eq1.curve.d).abs();
        let logs = points.iter().map(|(point, _)| from_pole(point).ln());
        let logs: Vec<f64> = logs.collect();
        let middle = mean(&logs).exp();
        let heights: Vec<(f64, f64)> = (points.iter().zip(&logs))
            .map(|((_, height), log)| (log - middle.ln(), *height))
            .collect();
        let (height, power) = usual_height(&heights);
        let usual = Self {
            share: 0.0,
            known_to: 1.0 / (2.0 * freedom).sqrt(),
            height,
            power,
            middle,
        };
        // Each residual's square, less the variance of the point's own noise, in squares of the model's e for
        // c = 1. The curve follows the points, so a residual is smaller than the point's error: points over
        // freedoms corrects this on average.
        let squares: Vec<f64> = (points.iter())
            .map(|(point, height)| {
                let by_height = match is_comb {
                    true => 1.0,
                    false => usual.height_at(from_pole(point)) / height,
                };
                let unit = from_pole(point).powi(2) * by_height;
                let residual = point.distance - curve.distance(point.centre);
                let own = point.sigma_at(curve.slope(point.centre)).powi(2);
                (residual.powi(2) * points.len() as f64 / freedom - own) / unit
            })
            .collect();
        let square = mean(&squares);
        // With few points the estimate scatters, and one that is too small loses more coverage than one that
        // is too large gains. With this factor 95 % of the errors are within twice the value (Student's t,
        // first order in 1 / freedom).
        let student = 1.0 + 1.25 / freedom;
        Some(Self {
            share: square.max(0.0).sqrt() * student,
            ..usual
        })
    }

    /// The usual height in counts at a distance d - D in metres.
    pub fn height_at(&self, from_pole: f64) -> f64 {
        self.height * (from_pole / self.middle).powf(self.power)
    }
}

/// Prior mean of q. Light falls as one over the square of the distance, and a target that shines towards the
/// sensor when it is far makes up for some of that: half-way.
const POWER: f64 = -1.0;
/// Prior standard deviation of q.
const POWER_DEVIATION: f64 = 1.5;

/// H and q for heights at logarithms of distances. Heights scatter by a share of their mean, up to all of it,
/// so this is the regression of a gamma distribution (P. McCullagh and J. A. Nelder, Generalized Linear
/// Models, 2nd ed., section 8), with [`POWER`] before it.
fn usual_height(heights: &[(f64, f64)]) -> (f64, f64) {
    let (mut log_height, mut power) = (mean(heights.iter().map(|(_, height)| height)).ln(), 0.0);
    for _ in 0..20 {
        let prior = POWER_DEVIATION.powi(-2);
        let mut matrix = Matrix2::new(0.0, 0.0, 0.0, prior);
        let mut vector = Vector2::new(0.0, prior * (POWER - power));
        for (log, height) in heights {
            let over = height / (log_height + power * log).exp() - 1.0;
            matrix += Matrix2::new(1.0, *log, *log, log * log);
            vector += Vector2::new(over, over * log);
        }
        let Some(step) = matrix.lu().solve(&vector) else {
            break;
        };
        // At most 0.5: Newton's steps on an exponential may diverge.
        let step = step * (0.5 / step.amax()).min(1.0);
        (log_height, power) = (log_height + step[0], power + step[1]);
    }
    (log_height.exp(), power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_height_is_the_mean_and_follows_the_distance() {
        // Pairs of a high and a low spot, with a mean of 1000 d^-2.
        let pair = |i| {
            let log = f64::from(i) / 400.0 - 0.5;
            let share = if i % 2 == 0 { 0.2 } else { 1.8 };
            (log, 1000.0 * share * (-2.0 * log).exp())
        };
        let heights: Vec<(f64, f64)> = (0..400).map(pair).collect();
        let (height, power) = usual_height(&heights);
        println!("{height} {power}");
        assert!((height / 1000.0 - 1.0).abs() < 0.02);
        // 400 points over 1: the power is known to 0.14, what is thought of it to 1.5.
        assert!((power + 2.0).abs() < 0.05);
    }
}
