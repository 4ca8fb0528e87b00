//! Fits eq. (5) on a level by weighted least squares: centre, width, height and level by the Gauss-Newton
//! method, in f32.
//!
//! This estimator also fits a spot that the sensor's edge cuts, or whose top is saturated: it uses the
//! pixels that are left. Its uncertainty is that of the four parameters together, so it grows where those
//! pixels cannot tell the parameters apart.
//!
//! **Model.** y(x) = b + A e(u), u = (x - c) / s, e = exp(-u^2 / 2). A pixel's own width is in s: s^2 =
//! sigma^2 + 1/12, which leaves an error of at most 0.0003 pixel for a width of 0.8, and none from 1.2.
//!
//! **Weights.** 1 / (noise^2 + g A e), from the model and not from the pixel: pixels that noise makes low
//! must not weigh more. `noise` is measured on the row, rounding to counts included. Saturated pixels
//! weigh nothing. In white noise this is the least-squares fit, in shot noise nearly the maximum-likelihood
//! one.
//!
//! **Scaling.** The unknowns are b / A, ln A, ln s and c / s: the derivatives by them are A times 1, e, u^2 e
//! and u e. The condition number of the normal equations is 22 then (10^9 for pixels and counts), and f32
//! solves them to a thousandth of a step.
//!
//! **Exponential.** Outwards from the pixel nearest to the centre e(k + 1) = e(k) r(k), r(k + 1) = r(k) q,
//! with q = exp(-1 / s^2): two multiplications a pixel. A relative error of 2^-24 in q becomes one of k 2^-24
//! in r(k), and of k^2/2 2^-24 in e(k). As e(k) itself is exp(-k^2 / 2s^2), the error is at most 2^-24 s^2 /
//! 2.7 of the height. For the widest spot that a window is made for, 13 samples, this is 4e-6: a sixtieth of
//! a count of 4095. This error is the same on both sides, like an error of s. The roundings of each step
//! differ between the sides, but add up to less.
//!
//! **Window.** 128 samples, as in the paper. A sample is one pixel up to a width of 12.8. Beyond, it has as
//! many pixels as make the window five widths to either side: at most a sixth of the width, which costs 0.1 %
//! in uncertainty. Sums of n pixels have n^2 / 12 in s^2 in place of 1/12.
//!
//! **Steps.** A step changes c by at most a width, and s and A by at most a half. The fit ends after a step
//! that is shorter than a tenth of a standard deviation in the metric of the normal equations. The error that
//! is left is far smaller, because the method converges quadratically.
//!
//! **Other profiles.** A slit's diffraction pattern is no gaussian. What the fit leaves of a bright one is 30
//! times the noise, and the method converges only linearly. So a step's standard deviation is that of the
//! noise or that of what the fit leaves, whichever is larger; but the step of the centre alone must be short
//! beside the noise too. In shot noise the side lobes weigh most, and the fit widens to cover them: to 1.4
//! widths at a Fresnel number of 0.55. A fit that is wider than the half maximum says therefore weighs the
//! spot's flanks less: see `LEAST_MIX`.

mod fit;
mod masked_pixels;
mod normal_equations;
mod start;
mod window;

use crate::base::{Fault, Pixels};
use crate::centre::half_width::WIDTHS;
use crate::centre::{RowCentre, check_uncertainty, count_saturated_pixels};
use crate::row::{Geometry, Row};
use crate::spot::Spot;
use fit::{Until, fit_profile};
use window::CutOff;

pub(crate) use fit::{Fit, MAX_STEPS, exponentials, fit, least_without};
pub(crate) use masked_pixels::MaskedPixels;
pub use normal_equations::{Parameters, SAMPLES, Sample};
pub(crate) use start::Start;
pub(crate) use window::{Window, allowed_scatter, half_window, pixels_a_sample};

/// Finds the centre of a spot that [`crate::spot::find`] found.
///
/// Ignores the row before: the fit starts from the half maximum, which costs only a twentieth of a step.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where the centre is not on the sensor. [`Fault::Saturated`] where saturation leaves
/// too few pixels of the spot. [`Fault::TooDim`] where the centre is uncertain by more than an eighth of the
/// width. [`Fault::NoSpot`] where the fit does not arrive.
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    _before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let light = row.light();
    let start = Start::find(row, spot)?;
    let window = Window::around(row, spot, &start, geometry);
    let (_, shot) = spot.background.variances(geometry);
    let saturated = count_saturated_pixels(row, start.centre, Pixels::from_f32(start.width));
    let unfit = match saturated {
        0 => spot.no_spot(),
        pixels => Fault::Saturated { pixels },
    };
    let is_whole = start.is_whole && saturated == 0;
    let least_noise = if is_whole {
        window.variance
    } else {
        f32::INFINITY
    };
    let parameters = window.parameters(&start);
    let until = Until::PRECISE;
    let fit = fit_profile(window.samples(), parameters, shot, least_noise, &until).ok_or(unfit)?;
    let cut_off = window.cut_off(&fit.parameters);
    if cut_off == CutOff::TooMuch {
        return Err(unfit);
    }
    let found = window.row_centre(&fit);
    let sensor = -0.5..light.len() as f32 - 0.5;
    if !sensor.contains(&found.centre.to_f32()) {
        return Err(Fault::SpotAtEdge {
            centre: found.centre,
        });
    }
    check_uncertainty(found.amplitude, found.uncertainty, found.width).map_err(|too_dim| {
        // The spot is cut off: the cause is not a lack of light.
        if cut_off == CutOff::No {
            too_dim
        } else {
            unfit
        }
    })?;
    if fit.has_arrived() && WIDTHS.contains(&found.width) {
        Ok(found)
    } else {
        Err(unfit)
    }
}
