//! Whether the row looks as its centre says, and another rung where it does not.
//!
//! A centre can be off in ways that its uncertainty, which is noise through the estimator, knows nothing of: a second spot, a hot pixel, a background
//! that rises, light that blooms to one side. A sharp test against the spot's shape would see them, and would see every profile that is not the
//! gaussian too: an exact Fresnel pattern lies 7 % from it.
//!
//! But all rungs are unbiased for a spot that is symmetric, whatever its shape. What moves a centre is what is *antisymmetric* about it, and of
//! that no optics leave anything: the row is compared with its mirror image about the centre (`symmetry`), to the noise, with hardly a
//! tolerance for shape. In orthonormal Hermite functions of u = (x - c) / sigma a second spot at d widths has components a^n / sqrt(n!), a = d / sqrt 2:
//! the first is what moves the centre, and is gone about the centre that it moved; the third is the witness, 0.8 of the first at two widths and more beyond.
//! It is tested by itself (*skew*), and so is a straight slope (*tilt*): a matched component is seen at 4 standard deviations where a
//! chi-square of 60 pixels needs one of 7. The pair that deviates most shows a bad pixel, and the sum of squares the rest.
//!
//! | component | statistic | its noise |
//! |---|---|---|
//! | shift, tilt, skew | r = sum w f z | sum w f^2, less what the shift shares |
//! | worst pair | w z^2 | 1 |
//! | squares | sum w z^2 of n pairs | 2 n + (0.06 n)^2 |
//!
//! with z the difference of a pair and 1 / w = 2 noise^2 + g p its variance, of the row's noise and of the shot noise of its own light p.
//!
//! What is symmetric moves no centre of one spot. Two equal ones have their centre between them, and boxes and clusters of bad pixels one of their own:
//! the pairs' sums are compared with a gaussian, loosely.
//!
//! Where the row does not look like its centre [`repair`] takes over, if the row looks like *its* centre but for the pixels that it left out. Otherwise the
//! first centre stands, flagged: in speckle the robust rung is worse than a plain one.

mod other_spot;
pub mod repair;
mod symmetry;

use crate::centre::gauss_newton::LeftOut;
use crate::centre::{self, Estimator, RowCentre, gauss_newton};
use crate::fault::Fault;
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// A narrower spot, in pixels, is flagged: three bad pixels side by side look like one of 0.95, and with noise of up to this, and
/// nothing in a row tells them from it.
const NARROWEST_SURE: f32 = 1.2;

/// Narrower spots, in pixels, that the sensor's edge cuts are not told from bad pixels.
const NARROWEST_CUT: f32 = 1.25;

/// The centre of a spot that the coarse search found, as the measurement trusts it.
///
/// A spot that the sensor's edge cuts is [`gauss_newton`]'s, whichever rung was asked: no other one's window is for it.
///
/// # Errors
/// See [`centre::centre`]; [`Fault::SpotAtEdge`] where the fit has none either.
pub fn centre(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let found = look(estimator, row, spot, before, geometry)?;
    if before.is_none() {
        other_spot::is_alone(row.light(), spot, &found)?;
    }
    Ok(RowCentre {
        misfit: found.misfit || found.width.to_f32() < NARROWEST_SURE,
        ..found
    })
}

/// The same without a look at the rest of the row.
#[inline(always)]
fn look(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let found = match centre::centre(estimator, row, spot, before, geometry) {
        Err(Fault::SpotAtEdge { .. }) if estimator != Estimator::GaussNewton => {
            let found = gauss_newton::centre(row, spot, before, geometry)?;
            let found = looked_at(row, spot, found, geometry);
            return Ok(RowCentre {
                misfit: found.misfit || !is_certain_cut(row, &found),
                ..found
            });
        }
        found => found?,
    };
    let found = looked_at(row, spot, found, geometry);
    if found.misfit && estimator != Estimator::GaussNewton {
        return Ok(another(row, spot, before, geometry, found));
    }
    Ok(found)
}

/// The robust rung's centre, if it is one without a flag, as one of the rung that found this one.
#[cold]
#[inline(never)]
fn another(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    found: RowCentre,
) -> RowCentre {
    match repair::centre(row, spot, before, geometry) {
        Ok(other) if !other.misfit || other.width.to_f32() < repair::NARROWEST_SURE_REFIT => {
            RowCentre {
                class: found.class,
                ..other
            }
        }
        _ => found,
    }
}

/// A centre, flagged where the row does not look like it. A fit's own flag stands where full scale or the sensor's edge leaves only a part of the spot to look
/// at; for a whole one it would be one for every profile that is not the gaussian.
pub(super) fn looked_at(
    row: &Row<'_>,
    spot: &Spot,
    found: RowCentre,
    geometry: &Geometry,
) -> RowCentre {
    let misfit = match symmetry::fits(row, spot, &found, geometry, &LeftOut::default()) {
        Some(fits) => !fits || found.misfit && !is_whole(row, &found),
        None => found.misfit || found.width.to_f32() < NARROWEST_CUT,
    };
    RowCentre { misfit, ..found }
}

/// Whether what the edge leaves of a spot tells it from a background that falls towards the edge.
fn is_certain_cut(row: &Row<'_>, found: &RowCentre) -> bool {
    let width = found.width.to_f32();
    32.0 * found.uncertainty.to_f32() <= width && row.light().len() as f32 >= 8.0 * width
}

/// Whether all of the spot within five widths is on the row, and no pixel at full scale.
fn is_whole(row: &Row<'_>, found: &RowCentre) -> bool {
    let reach = 5.0 * found.width.to_f32();
    // A row has at most 2^12 pixels.
    let (centre, end) = (found.centre.to_f32(), row.light().len() as f32 - 1.0);
    !row.reaches_full_scale() && centre >= reach && end - centre >= reach
}
