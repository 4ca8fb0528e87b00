//! From centres to errors: eq. (1) fitted to a data set, and how far its distances are from the true ones.

use anyhow::Context as _;
use calibration::fit::eq1::{self, Fit};
use calibration::fit::spline::{Equations, Grid, Residual, Spline};
use rayon::prelude::*;

use crate::paper::apparatus::Aperture;
use crate::paper::data_set::Centres;
use crate::paper::methods::{Calibration, CentreMethod, Method};

/// What a method makes of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    pub method: Method,
    pub fit: Fit,
    /// Mean of the absolute errors in metres: the paper's MAE.
    pub mae: f64,
    /// The largest absolute error in metres: the paper's MAX.
    pub max: f64,
    pub without_centre: usize,
    /// For each capture the prediction less the true distance, in metres; not a number where there is no
    /// centre.
    pub errors: Vec<f32>,
}

/// The residual tables of a sensor, one for each of the centre methods of an aperture, where there are enough
/// data for them.
pub type Tables = Vec<Option<Spline>>;

/// Judges every method of an aperture on the centres of a data set.
pub fn judge(
    aperture: Aperture,
    centres: &Centres,
    tables: &Tables,
) -> anyhow::Result<Vec<Judged>> {
    let methods: Vec<(Method, usize)> = CentreMethod::all(aperture)
        .into_iter()
        .enumerate()
        .flat_map(|(column, centre)| {
            [Calibration::Eq1, Calibration::Eq1AndTable].map(|calibration| {
                (
                    Method {
                        centre,
                        calibration,
                    },
                    column,
                )
            })
        })
        .filter(|(method, column)| {
            method.calibration == Calibration::Eq1
                || tables.get(*column).is_some_and(Option::is_some)
        })
        .collect();
    methods
        .into_par_iter()
        .map(|(method, column)| {
            let table = match method.calibration {
                Calibration::Eq1 => None,
                Calibration::Eq1AndTable => tables[column].as_ref(),
            };
            of_method(
                method,
                &centres.distances,
                &centres.of_methods[column],
                table,
            )
            .with_context(|| method.name())
        })
        .collect()
}

fn of_method(
    method: Method,
    distances: &[f64],
    centres: &[f64],
    table: Option<&Spline>,
) -> anyhow::Result<Judged> {
    let residual = |centre: f64| table.map_or(0.0, |table| table.at(centre));
    // The table is taken off first, so that the two do not compete for what both can follow.
    let points: Vec<(f64, f64)> = centres
        .iter()
        .zip(distances)
        .filter(|(centre, _)| centre.is_finite())
        .map(|(&centre, distance)| (centre, distance - residual(centre)))
        .collect();
    let fit = eq1::fit(&points)?;
    let errors: Vec<f32> = centres
        .iter()
        .zip(distances)
        .map(|(&centre, distance)| {
            if centre.is_finite() {
                (fit.curve.distance(centre) + residual(centre) - distance) as f32
            } else {
                f32::NAN
            }
        })
        .collect();
    let absolute = || {
        errors
            .iter()
            .filter(|error| error.is_finite())
            .map(|error| f64::from(error.abs()))
    };
    Ok(Judged {
        method,
        mae: absolute().sum::<f64>() / points.len() as f64,
        max: absolute().fold(0.0, f64::max),
        without_centre: centres.len() - points.len(),
        fit,
        errors,
    })
}

/// The residual tables of centres: what eq. (1), fitted to them, leaves.
pub fn tables(centres: &Centres) -> anyhow::Result<Tables> {
    centres
        .of_methods
        .par_iter()
        .map(|of_method| {
            let points: Vec<(f64, f64)> = of_method
                .iter()
                .zip(&centres.distances)
                .filter(|(centre, _)| centre.is_finite())
                .map(|(&centre, &distance)| (centre, distance))
                .collect();
            if points.is_empty() {
                return Ok(None);
            }
            let curve = eq1::fit(&points)?.curve;
            let residuals: Vec<(f64, f64)> = points
                .iter()
                .map(|&(centre, distance)| (centre, distance - curve.distance(centre)))
                .collect();
            Ok(smooth(&residuals))
        })
        .collect()
}

/// Intervals of a residual table: an aberration of the lens is of third or fifth order over the field. More
/// of them would follow speckle.
const INTERVALS: usize = 8;

/// The penalty of a residual table: it holds splines that few points reach.
const PENALTY: f64 = 2.1e-3;

/// A smooth curve over the sensor through residuals (of any unit) at centres in pixels: a distortion, a spot
/// whose shape changes along the table. `None` where there are fewer points than splines.
///
/// The residuals are of other surfaces than those that the curve is applied to: a curve through a surface's
/// own residuals would take the speckle for the sensor.
fn smooth(points: &[(f64, f64)]) -> Option<Spline> {
    if points.len() < INTERVALS + 3 {
        return None;
    }
    let centres = || points.iter().map(|&(centre, _)| centre);
    let first = centres().fold(f64::INFINITY, f64::min);
    let last = centres().fold(f64::NEG_INFINITY, f64::max);
    let residuals = points.iter().map(|&(at, value)| Residual {
        at,
        value,
        weight: 1.0,
    });
    let grid = Grid::with_intervals(first, last, INTERVALS);
    Equations::new(grid, residuals, points.len() as f64).solve(PENALTY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_residual_table_follows_smooth_errors_only() {
        let cubic = |x: f64| 1e-9 * (x - 900.0).powi(3) - 2e-4 * (x - 900.0);
        let points: Vec<(f64, f64)> = (0..2000)
            .map(|i| {
                let x = 100.0 + 0.8 * f64::from(i);
                (x, cubic(x) + 0.1 * (x * 0.7).sin())
            })
            .collect();
        let table = smooth(&points).expect("enough points");
        let worst = (100..1700)
            .map(|x| (table.at(f64::from(x)) - cubic(f64::from(x))).abs())
            .fold(0.0, f64::max);
        println!("worst {worst:.4} of {:.3}", cubic(1700.0));
        assert!(worst < 0.01);
        // It ends where the points do.
        assert_eq!(table.at(0.0), table.at(100.0));
        assert!(smooth(&points[..10]).is_none());
    }
}
