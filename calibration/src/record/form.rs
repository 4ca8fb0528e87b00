//! From a fitted curve to the calibration that the sensor holds.

use anyhow::{Context as _, ensure};
use slitrange::distance::eq1::Eq1;
use slitrange::distance::residuals::{Corrected, CorrectedError};
use slitrange::distance::table::Table;
use slitrange::{Calibration, Micrometres, Pixels};

use super::tabulate::tabulate;
use crate::fit::curve::Curve;
use crate::fit::solve::{Form, Solved};
use crate::fixed::{micrometres, pixels};

/// A calibration, and the curve that it stands for.
#[derive(Clone, Debug)]
pub struct Made<'a> {
    /// As the sensor holds it.
    pub calibration: Calibration,
    /// What it is made of.
    pub form: Form,
    /// Why it is made of that.
    pub because: String,
    /// What it stands for.
    pub curve: &'a Curve,
    /// How many knots its table has.
    pub knots: Option<usize>,
    /// How far the sensor's distances are from the curve, in micrometres, at most over the range: by rounding
    /// and tabulation.
    pub error_um: f64,
}

/// The calibration in a form, or in the better one where none is asked for.
///
/// # Errors
/// The curve cannot be held in that form.
pub fn make(solved: &Solved, wanted: Option<Form>) -> anyhow::Result<Made<'_>> {
    let gain = solved.gain.unwrap_or(0.0);
    let better = solved.better();
    match wanted {
        Some(form) => held(solved, form, "asked for".into()),
        None if better == Form::Eq1 => {
            let because = match solved.corrected {
                None => "there are fewer points than a correction needs".into(),
                Some(_) => format!(
                    "a correction gains {gain:.1} standard errors of cross-validation, and must gain 2"
                ),
            };
            held(solved, Form::Eq1, because)
        }
        None => {
            let because = format!("it gains {gain:.1} standard errors of cross-validation");
            match held(solved, Form::Corrected, because.clone()) {
                // More than residuals may be: distances can.
                Err(error) if error.is::<CorrectedError>() => {
                    held(solved, Form::Table, format!("{because}; {error}"))
                }
                made => made,
            }
        }
    }
}

fn held(solved: &Solved, form: Form, because: String) -> anyhow::Result<Made<'_>> {
    let smooth = || {
        let curve = solved.corrected.as_ref().map(|(curve, _)| curve);
        curve.context("this form needs ten points at least: with fewer, take eq. (1) (--form eq1)")
    };
    let (calibration, knots, curve) = match form {
        Form::Eq1 => (Calibration::Eq1(eq1(&solved.plain)?), None, &solved.plain),
        Form::Corrected => {
            let curve = smooth()?;
            let (first, last) = ends(curve);
            let knots = tabulate(|x| 1e6 * curve.residual(x), first, last)?;
            let corrected = Corrected::new(eq1(curve)?, &knots)?;
            let calibration = Calibration::Corrected(corrected);
            (calibration, Some(knots.len()), curve)
        }
        Form::Table => {
            let curve = smooth()?;
            let (first, last) = ends(curve);
            let knots = tabulate(|x| 1e6 * curve.distance(x), first, last)?;
            let table = Table::new(&knots).context("the smoothed distances are no table")?;
            (Calibration::Table(table), Some(knots.len()), curve)
        }
    };
    let error_um = furthest(&calibration, curve);
    Ok(Made {
        calibration,
        form,
        because,
        curve,
        knots,
        error_um,
    })
}

fn ends(curve: &Curve) -> (Pixels, Pixels) {
    let (first, last) = curve.eq1.valid;
    (pixels(first), pixels(last))
}

fn eq1(curve: &Curve) -> anyhow::Result<Eq1> {
    let found = curve.eq1.curve;
    let (first, last) = ends(curve);
    let farthest = Micrometres::MAX.to_f64();
    ensure!(
        (1e6 * found.d).abs() < farthest && found.pole.abs() < Pixels::MAX.to_f64(),
        "D = {:.1} mm and xp = {:.0} px are beyond what a record holds (8389 mm, 32768 px): the points lie \
         nearly on a straight line; take a wider range of distances, or a table (--form table)",
        1e3 * found.d,
        found.pole
    );
    // From metre pixels to um px in Q48.16. What is too large saturates, and is refused.
    let k = (1e6 * found.k * 65536.0).round() as i64;
    let (d, pole) = (micrometres(1e6 * found.d), pixels(found.pole));
    Ok(Eq1::new(d, k, pole, first..=last)?)
}

/// The largest difference of a calibration's distances from its curve, in micrometres, at even steps.
fn furthest(calibration: &Calibration, curve: &Curve) -> f64 {
    const STEPS: usize = 2000;
    let off = |centre| {
        let centre = pixels(centre);
        let (distance, _) = calibration.distance_at(centre).ok()?;
        Some((distance.to_f64() - 1e6 * curve.distance(centre.to_f64())).abs())
    };
    curve.even_steps(STEPS).filter_map(off).fold(0.0, f64::max)
}
