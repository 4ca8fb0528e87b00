//! From centres to errors: eq. (1) fitted to a data set, and how far its distances are from the true ones.

use calibration::fit::eq1::{self, Fit};

#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
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

/// Judges the centres of captures at these distances, in metres. A centre that is not a number is none.
pub fn judge(distances: &[f64], centres: &[f64]) -> anyhow::Result<Judged> {
    let all = || centres.iter().copied().zip(distances.iter().copied());
    let points: Vec<(f64, f64)> = all().filter(|(centre, _)| centre.is_finite()).collect();
    let fit = eq1::fit(&points)?;
    let error = |(centre, distance): (f64, f64)| match centre.is_finite() {
        true => (fit.curve.distance(centre) - distance) as f32,
        false => f32::NAN,
    };
    let errors: Vec<f32> = all().map(error).collect();
    let finite = || errors.iter().filter(|error| error.is_finite());
    let absolute = || finite().map(|error| f64::from(error.abs()));
    Ok(Judged {
        mae: absolute().sum::<f64>() / points.len() as f64,
        max: absolute().fold(0.0, f64::max),
        without_centre: centres.len() - points.len(),
        fit,
        errors,
    })
}
