//! What eq. (1) leaves over the sensor, as a smooth curve: a distortion, a spot whose shape changes along the table.
//!
//! Measured on other surfaces than those it is applied to: on its own data a curve through the residuals would take the
//! speckle for the sensor.

use nalgebra::{Cholesky, DMatrix, DVector};

/// Residuals over the centre: cubic B-splines, eight intervals over the centres that were measured.
#[derive(Clone, Debug)]
pub struct ResidualTable {
    first: f64,
    interval: f64,
    coefficients: DVector<f64>,
}

/// Intervals of the splines: an aberration of the lens is of third or fifth order over the field. More of them would follow speckle.
const INTERVALS: usize = 8;

const SPLINES: usize = INTERVALS + 3;

/// Weight of the squared third differences of the coefficients (P. Eilers and B. Marx, 1996) over that of a spline's points: holds
/// splines that few points reach.
const SMOOTHNESS: f64 = 1e-3;

impl ResidualTable {
    /// The curve through residuals (of any unit) at centres in pixels. `None` where there are fewer points than splines.
    pub fn of(points: &[(f64, f64)]) -> Option<Self> {
        if points.len() < SPLINES {
            return None;
        }
        let centres = || points.iter().map(|&(x, _)| x);
        let first = centres().fold(f64::INFINITY, f64::min);
        let last = centres().fold(f64::NEG_INFINITY, f64::max);
        let mut table = Self {
            first,
            interval: (last - first) / INTERVALS as f64,
            coefficients: DVector::zeros(SPLINES),
        };
        let mut normal = DMatrix::zeros(SPLINES, SPLINES);
        let mut right = DVector::zeros(SPLINES);
        for &(centre, residual) in points {
            let (start, weights) = table.splines(centre);
            for i in 0..4 {
                right[start + i] += weights[i] * residual;
                for j in 0..4 {
                    normal[(start + i, start + j)] += weights[i] * weights[j];
                }
            }
        }
        let smoothness = SMOOTHNESS * points.len() as f64 / SPLINES as f64;
        let differences = [-1.0, 3.0, -3.0, 1.0];
        for start in 0..SPLINES - 3 {
            for i in 0..4 {
                for j in 0..4 {
                    normal[(start + i, start + j)] += smoothness * differences[i] * differences[j];
                }
            }
        }
        table.coefficients = Cholesky::new(normal)?.solve(&right);
        Some(table)
    }

    /// The curve at a centre in pixels; beyond the ends, as at the end.
    pub fn at(&self, centre: f64) -> f64 {
        let (start, weights) = self.splines(centre);
        (0..4)
            .map(|i| weights[i] * self.coefficients[start + i])
            .sum()
    }

    /// The first of the four splines that reach to a place, and their values there.
    fn splines(&self, centre: f64) -> (usize, [f64; 4]) {
        let knots = ((centre - self.first) / self.interval).clamp(0.0, INTERVALS as f64);
        let start = (knots as usize).min(INTERVALS - 1);
        let t = knots - start as f64;
        let s = 1.0 - t;
        let weights = [
            s * s * s / 6.0,
            2.0 / 3.0 - t * t + t * t * t / 2.0,
            2.0 / 3.0 - s * s + s * s * s / 2.0,
            t * t * t / 6.0,
        ];
        (start, weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_what_is_smooth_and_not_what_is_not() {
        let cubic = |x: f64| 1e-9 * (x - 900.0).powi(3) - 2e-4 * (x - 900.0);
        let points: Vec<(f64, f64)> = (0..2000)
            .map(|i| {
                let x = 100.0 + 0.8 * f64::from(i);
                (x, cubic(x) + 0.1 * (x * 0.7).sin())
            })
            .collect();
        let table = ResidualTable::of(&points).expect("enough points");
        let worst = (100..1700)
            .map(|x| (table.at(f64::from(x)) - cubic(f64::from(x))).abs())
            .fold(0.0, f64::max);
        println!("worst {worst:.4} of {:.3}", cubic(1700.0));
        assert!(worst < 0.01);
        // It ends where the points do.
        assert_eq!(table.at(0.0), table.at(100.0));
        assert!(ResidualTable::of(&points[..10]).is_none());
    }
}
