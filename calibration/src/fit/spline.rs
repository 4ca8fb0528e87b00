//! What eq. (1) leaves, as a smooth curve over the distance: a smoothing spline.
//!
//! Cubic B-splines on many even intervals, held smooth by a penalty on the third differences of their
//! coefficients (P. Eilers and B. Marx, 1996). Curves without third differences are the quadratics, and
//! quadratics of the distance are just what eq. (1) can still do: its derivatives by D, K and xp are 1, (d -
//! D) and (d - D)^2, each times a constant. So the two do not compete: however large the penalty, what eq.
//! (1) can follow is followed, and all else fades. A penalty without end is eq. (1) alone, with its three
//! freedoms.
//!
//! The penalty is that of the least generalised cross-validation error, with each freedom counted 1.4 times,
//! which keeps it from following noise where there are few points (Y.-J. Kim and C. Gu, 2004).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector4};

/// Even intervals over a range of distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    first: f64,
    interval: f64,
    intervals: usize,
}

/// A residual to be followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// The distance at which it is.
    pub at: f64,
    /// Itself.
    pub value: f64,
    /// One over its variance, in any unit.
    pub weight: f64,
}

/// A smooth curve. Beyond its grid it stays as at the grid's end.
#[derive(Clone, Debug)]
pub struct Spline {
    grid: Grid,
    coefficients: DVector<f64>,
    /// The covariance of the coefficients where the variance of a residual of weight 1 is 1. With the penalty
    /// taken as what was known of the curve before (G. Wahba, 1983): it counts what smoothing takes from the
    /// curve, too.
    unit_covariance: DMatrix<f64>,
    /// How many parameters the curve is worth.
    pub freedoms: f64,
}

/// Each freedom counts so many times when the penalty is chosen.
const FREEDOM_COUNTS: f64 = 1.4;

/// How many freedoms a curve through points may have: two points for each, and no more than a smooth
/// departure needs (one of 300 um over the paper's range, known to 1 um, takes 13).
pub fn most_freedoms(points: f64) -> f64 {
    (points / 2.0).clamp(3.01, 25.0)
}

/// Penalties that are tried, relative to what the points weigh, from the stiffest on.
pub fn penalties() -> impl Iterator<Item = f64> {
    (-16..=16).map(|step| 10f64.powf(-0.5 * f64::from(step)))
}

impl Grid {
    /// Even intervals from one distance to another, as many as points can use: half as many, at most 40.
    pub fn new(first: f64, last: f64, points: usize) -> Self {
        let intervals = (points / 2).clamp(4, 40);
        Self {
            first,
            interval: (last - first) / intervals as f64,
            intervals,
        }
    }

    fn splines(&self) -> usize {
        self.intervals + 3
    }

    fn value(&self, coefficients: &DVector<f64>, distance: f64) -> f64 {
        let (start, values, _) = self.at(distance);
        values.dot(&coefficients.fixed_rows::<4>(start))
    }

    /// The first of the four splines that reach to a place, their values there and their slopes.
    fn at(&self, place: f64) -> (usize, Vector4<f64>, Vector4<f64>) {
        let place = ((place - self.first) / self.interval).clamp(0.0, self.intervals as f64);
        let start = (place as usize).min(self.intervals - 1);
        let t = place - start as f64;
        let s = 1.0 - t;
        let values = Vector4::new(
            s * s * s / 6.0,
            2.0 / 3.0 - t * t + t * t * t / 2.0,
            2.0 / 3.0 - s * s + s * s * s / 2.0,
            t * t * t / 6.0,
        );
        let slopes = Vector4::new(
            -s * s / 2.0,
            -2.0 * t + 1.5 * t * t,
            2.0 * s - 1.5 * s * s,
            t * t / 2.0,
        );
        (start, values, slopes / self.interval)
    }
}

/// The normal equations of splines through residuals, without their penalty.
pub struct Equations {
    grid: Grid,
    normal: DMatrix<f64>,
    right: DVector<f64>,
    /// The weighted sum of the residuals' squares.
    squares: f64,
    /// How many points of full weight there are.
    points: f64,
}

impl Equations {
    /// Those of residuals. `points` is how many of full weight they stand for.
    pub fn new(grid: Grid, residuals: impl Iterator<Item = Residual>, points: f64) -> Self {
        let count = grid.splines();
        let mut equations = Self {
            grid,
            normal: DMatrix::zeros(count, count),
            right: DVector::zeros(count),
            squares: 0.0,
            points,
        };
        for residual in residuals {
            let (start, values, _) = grid.at(residual.at);
            let weighted = residual.weight * values;
            let mut right = equations.right.fixed_rows_mut::<4>(start);
            right += weighted * residual.value;
            let mut normal = equations.normal.fixed_view_mut::<4, 4>(start, start);
            normal += weighted * values.transpose();
            equations.squares += residual.weight * residual.value * residual.value;
        }
        equations
    }

    fn penalised(&self, penalty: f64) -> Option<Cholesky<f64, Dyn>> {
        let mut matrix = self.normal.clone();
        let penalty = penalty * self.normal.trace() / self.grid.splines() as f64;
        let differences = Vector4::new(-1.0, 3.0, -3.0, 1.0);
        let squares = penalty * differences * differences.transpose();
        for start in 0..self.grid.splines() - 3 {
            let mut part = matrix.fixed_view_mut::<4, 4>(start, start);
            part += squares;
        }
        Cholesky::new(matrix)
    }

    /// Freedoms and the generalised cross-validation error, but for a factor.
    fn score(&self, penalty: f64) -> Option<(f64, f64)> {
        let factor = self.penalised(penalty)?;
        let freedoms = factor.inverse().component_mul(&self.normal).sum();
        let coefficients = factor.solve(&self.right);
        let followed =
            2.0 * coefficients.dot(&self.right) - coefficients.dot(&(&self.normal * &coefficients));
        // Rounding may leave less than nothing.
        let left = (self.squares - followed).max(1e-12 * self.squares);
        let room = self.points - FREEDOM_COUNTS * freedoms;
        (room > 0.0).then_some((freedoms, left / (room * room)))
    }

    /// The penalty with the least generalised cross-validation error.
    pub fn best_penalty(&self) -> Option<f64> {
        let scores = penalties().map_while(|penalty| {
            let (freedoms, score) = self.score(penalty)?;
            (freedoms <= most_freedoms(self.points)).then_some((penalty, score))
        });
        let (penalty, _) = scores.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        Some(penalty)
    }

    /// The smooth curve.
    pub fn solve(&self, penalty: f64) -> Option<Spline> {
        let factor = self.penalised(penalty)?;
        let unit_covariance = factor.inverse();
        Some(Spline {
            grid: self.grid,
            coefficients: factor.solve(&self.right),
            freedoms: unit_covariance.component_mul(&self.normal).sum(),
            unit_covariance,
        })
    }

    /// The values of the smooth curve at distances, and no more.
    pub fn values(&self, penalty: f64, at: impl Iterator<Item = f64>) -> Option<Vec<f64>> {
        let coefficients = self.penalised(penalty)?.solve(&self.right);
        let values = at.map(|distance| self.grid.value(&coefficients, distance));
        Some(values.collect())
    }
}

impl Spline {
    /// The curve at a distance.
    pub fn at(&self, distance: f64) -> f64 {
        self.grid.value(&self.coefficients, distance)
    }

    /// How much it changes with the distance.
    pub fn slope_at(&self, distance: f64) -> f64 {
        let (start, _, slopes) = self.grid.at(distance);
        slopes.dot(&self.coefficients.fixed_rows::<4>(start))
    }

    /// Its variance there, where the variance of a residual of weight 1 is 1.
    pub fn unit_variance_at(&self, distance: f64) -> f64 {
        let (start, values, _) = self.grid.at(distance);
        let covariance = self.unit_covariance.fixed_view::<4, 4>(start, start);
        values.dot(&(covariance * values))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn residuals(count: usize, value: impl Fn(f64) -> f64) -> Vec<Residual> {
        let distances = (0..count).map(|i| 0.6 + 0.42 * i as f64 / (count - 1) as f64);
        let residual = |at| Residual {
            at,
            value: value(at),
            weight: 1.0,
        };
        distances.map(residual).collect()
    }

    fn equations(count: usize, value: impl Fn(f64) -> f64) -> Equations {
        let grid = Grid::new(0.6, 1.02, count);
        Equations::new(grid, residuals(count, value).into_iter(), count as f64)
    }

    /// The largest penalty leaves three freedoms, and does not change a quadratic.
    #[test]
    fn the_largest_penalty_leaves_a_quadratic_unchanged() {
        let quadratic = |d: f64| 3e-3 - 2e-3 * d + 5e-3 * d * d;
        let spline = equations(60, quadratic).solve(1e8).expect("a curve");
        println!("{} freedoms", spline.freedoms);
        assert!((spline.freedoms - 3.0).abs() < 1e-3);
        for residual in residuals(200, quadratic) {
            let error = spline.at(residual.at) - residual.value;
            assert!(error.abs() < 1e-9, "{error} at {}", residual.at);
        }
    }

    /// A wave of 300 um under noise of 2 um: with the chosen penalty, less than half of the noise remains.
    #[test]
    fn the_penalty_is_neither_too_small_nor_too_large() {
        use rand::SeedableRng as _;
        use rand_distr::{Distribution as _, StandardNormal};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let wave = |d: f64| 300e-6 * (12.0 * d).sin();
        let normal = StandardNormal.sample_iter(&mut random);
        let noise: Vec<f64> = normal.take(60).map(|it: f64| 2e-6 * it).collect();
        let noise_at = |d: f64| noise[((d - 0.6) / 0.42 * 59.0).round() as usize];
        let equations = equations(60, |d| wave(d) + noise_at(d));
        let penalty = equations.best_penalty().expect("a penalty");
        let spline = equations.solve(penalty).expect("a curve");
        let rms = |error: &dyn Fn(f64) -> f64| {
            1e6 * statistics::rms(residuals(400, error).iter().map(|residual| residual.value))
        };
        let error = rms(&|d| spline.at(d) - wave(d));
        let claimed = rms(&|d| 2e-6 * spline.unit_variance_at(d).sqrt());
        println!(
            "{:.1} freedoms, error {error:.2} um, claimed {claimed:.2} um",
            spline.freedoms
        );
        assert!(error < 1.0, "{error}");
        assert!((0.7..1.5).contains(&(claimed / error)));
        let step = 1e-6;
        let slope = (spline.at(0.8 + step) - spline.at(0.8 - step)) / (2.0 * step);
        assert!((spline.slope_at(0.8) / slope - 1.0).abs() < 1e-6);
    }
}
