//! From centres to errors: eq. (1) fitted to a data set, and how far its distances are from the true ones.

use anyhow::Context as _;
use rayon::prelude::*;
use slitrange_tool::fit::eq1::{self, Fit};

use crate::paper::apparatus::Aperture;
use crate::paper::data_set::Centres;
use crate::paper::methods::{Calibration, CentreMethod, Method};
use crate::paper::residual_table::ResidualTable;

/// What a method makes of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// The method.
    pub method: Method,
    /// Eq. (1) as it was fitted.
    pub fit: Fit,
    /// Mean of the absolute errors in metres: the paper's MAE.
    pub mae: f64,
    /// The largest absolute error in metres: the paper's MAX.
    pub max: f64,
    /// Captures without a centre.
    pub without_centre: usize,
    /// For each capture the prediction less the true distance, in metres; not a number where there is no centre.
    pub errors: Vec<f32>,
}

/// The residual tables of a sensor, one for each of the centre methods of an aperture, where there are enough data for them.
pub type Tables = Vec<Option<ResidualTable>>;

/// Judges every method of an aperture on the centres of a data set.
///
/// # Errors
/// Eq. (1) does not fit.
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
    table: Option<&ResidualTable>,
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
///
/// # Errors
/// Eq. (1) does not fit.
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
            Ok(ResidualTable::of(&residuals))
        })
        .collect()
}
