//! Computes the uncertainties of a fitted calibration, as its record holds them.

use slitrange::base::places::PLACES;
use slitrange::base::units::{Counts, Micrometres};
use slitrange::reading::uncertainty::{CalibrationErrors, FittedErrors, FittedSurface};

use super::form::Made;
use super::surface::Surface;
use crate::fit::solve::Solved;
use crate::fixed::micrometres;

/// The errors, at even steps of the centre from the calibration's first to its last.
pub fn of(solved: &Solved, made: &Made<'_>) -> CalibrationErrors {
    let curve = made.curve;
    let (first, last) = curve.eq1.valid;
    let centres: [f64; PLACES] =
        std::array::from_fn(|place| first + (last - first) * place as f64 / (PLACES - 1) as f64);
    // Three points leave no residuals, so the fit cannot tell its errors. The tolerances of a head that
    // nobody calibrated stand in, with their flag: unknown errors would count as none.
    let Some(factor) = solved.quality(made.form).factor else {
        return CalibrationErrors::Nominal;
    };
    let um = |metres: f64| micrometres(1e6 * metres).max(Micrometres::default());
    let surface = Surface::of(solved, curve).map(|surface| {
        let from_pole = |centre: f64| (curve.distance(centre) - curve.eq1.curve.d).abs();
        let counts = |height: f64| {
            let bits = (height * f64::from(1 << Counts::FRACTION)).round();
            Counts::from_bits((bits as i32).max(1))
        };
        FittedSurface {
            deviation: centres.map(|centre| um(surface.share * from_pole(centre))),
            height: centres.map(|centre| counts(surface.height_at(from_pole(centre)))),
        }
    });
    CalibrationErrors::Fitted(FittedErrors {
        curve: centres.map(|centre| {
            let rounding = 1e-6 * made.error_um;
            let noise = factor * curve.unit_variance_at(centre).sqrt();
            um(noise.hypot(rounding).hypot(curve.smoothed_away(centre)))
        }),
        surface,
    })
}
