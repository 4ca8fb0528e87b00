//! Estimates a spot's centre: by the chosen estimator, or by a fit where the sensor's edge or saturation cuts
//! the spot.
//!
//! A spot whose top is cut off at a level that nobody stated is recognised by its flat top (`flat_top`).
//! From then on the pixels of the top count as saturated: [`gauss_newton`] measures by the flanks, and the
//! other estimators have the fault [`Fault::Saturated`].

use crate::base::{Fault, WorkBudget, numeric};
use crate::centre::plausible::count_saturated_pixels;
use crate::centre::{self, Estimator, RowCentre, adaptive, flat_top, gauss_newton, half_width};
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// Estimator and check take work from the budget only for a spot that is wider than this, in pixels.
const USUAL_WIDTH: usize = 16;
/// They take so much for each pixel that the spot is wider.
const WORK_OF_PIXEL: usize = 15;
/// The work of the robust estimate of a narrow spot, where the estimator has found another centre.
const WORK_OF_ROBUST_ESTIMATE: usize = 300;
/// It takes so much more for each pixel that the spot may be wide.
const WORK_OF_MEASURED_PIXEL: usize = 9;

/// A centre that the check has not judged yet.
#[derive(Clone, Debug)]
pub struct Estimate<'a> {
    /// The centre.
    pub found: RowCentre,
    /// The row with the saturation of the spot's flat top, if it has one.
    pub with_flat_top: Option<Row<'a>>,
    /// The sensor's edge cuts the spot.
    pub is_cut: bool,
}

impl<'a> Estimate<'a> {
    /// The row by which the centre was found, of the row as it was read.
    #[inline(always)]
    pub fn row<'b>(&'b self, as_read: &'b Row<'a>) -> &'b Row<'a> {
        self.with_flat_top.as_ref().unwrap_or(as_read)
    }

    /// The work of estimator and check beyond that of a usual spot. It is known only with the width.
    #[inline(always)]
    pub(crate) fn work(&self) -> usize {
        let width = numeric::whole_usize(self.found.width.to_f32());
        let wider = width.saturating_sub(USUAL_WIDTH);
        wider.saturating_mul(WORK_OF_PIXEL)
    }

    /// Measures a spot with a flat top again, by its flanks.
    #[inline(always)]
    fn of(
        estimator: Estimator,
        found: RowCentre,
        is_cut: bool,
        row: &Row<'a>,
        spot: &Spot,
        geometry: &Geometry,
        budget: &mut WorkBudget,
    ) -> Result<Self, Fault> {
        let top = flat_top::find(row, spot, &found, geometry);
        let with_flat_top = top.map(|saturation| row.with_saturation(saturation));
        Ok(Self {
            found: match &with_flat_top {
                Some(row) => measure_flanks(estimator, row, spot, &found, geometry, budget)?,
                None => found,
            },
            with_flat_top,
            is_cut,
        })
    }
}

/// The work of [`gauss_newton`] if it takes all its steps.
fn work_of_fit(spot: &Spot) -> usize {
    widest(spot).saturating_mul(4).saturating_add(1400)
}

/// The most pixels that a spot may be wide, before its width is known.
fn widest(spot: &Spot) -> usize {
    let widest = numeric::whole_usize(*half_width::WIDTHS.end());
    spot.block().saturating_mul(2).min(widest)
}

/// Estimates the centre of a spot that stands alone on its row. [`gauss_newton`] fits a spot that the
/// sensor's edge cuts, whatever the estimator: no other estimator takes a cut window.
///
/// # Errors
/// See [`centre::centre`]; [`Fault::SpotAtEdge`] where the fit has no centre either; [`Fault::Saturated`]
/// also where the spot's top is flat.
#[inline(always)]
pub fn estimate<'a>(
    estimator: Estimator,
    row: &Row<'a>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    budget: &mut WorkBudget,
) -> Result<Estimate<'a>, Fault> {
    if estimator == Estimator::GaussNewton {
        budget.pay(work_of_fit(spot)).ok_or(spot.no_spot())?;
    }
    match centre::centre(estimator, row, spot, before, geometry) {
        Err(at_edge @ Fault::SpotAtEdge { .. }) if estimator != Estimator::GaussNewton => {
            budget.pay(work_of_fit(spot)).ok_or(at_edge)?;
            let found = gauss_newton::centre(row, spot, before, geometry)?;
            let fit = Estimator::GaussNewton;
            Estimate::of(fit, found, true, row, spot, geometry, budget)
        }
        found => Estimate::of(estimator, found?, false, row, spot, geometry, budget),
    }
}

/// Estimates the centre of one of several images on a row. Fits are at most as many as there are images, so
/// they take nothing from the budget. An image at the sensor's edge has no centre.
///
/// # Errors
/// See [`centre::centre`]; [`Fault::Saturated`] also where the spot's top is flat.
#[inline(always)]
pub fn estimate_image<'a>(
    estimator: Estimator,
    row: &Row<'a>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    budget: &mut WorkBudget,
) -> Result<Estimate<'a>, Fault> {
    let found = centre::centre(estimator, row, spot, before, geometry)?;
    Estimate::of(estimator, found, false, row, spot, geometry, budget)
}

/// Estimates the centre from which a repair starts: `adaptive`'s, or a fit's if pixels are saturated.
///
/// # Errors
/// See [`centre::centre`]; [`Fault::Saturated`] only where the pixels that are not saturated are too few.
/// [`Fault::NoSpot`] also if the budget is too small.
#[inline(always)]
pub fn estimate_robustly<'a>(
    row: &Row<'a>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    budget: &mut WorkBudget,
) -> Result<Estimate<'a>, Fault> {
    let of_width = widest(spot).saturating_mul(WORK_OF_MEASURED_PIXEL);
    let work = WORK_OF_ROBUST_ESTIMATE.saturating_add(of_width);
    budget.pay(work).ok_or(spot.no_spot())?;
    let found = match adaptive::centre(row, spot, before, geometry) {
        Err(Fault::Saturated { .. }) => {
            budget.pay(work_of_fit(spot)).ok_or(spot.no_spot())?;
            gauss_newton::centre(row, spot, before, geometry)?
        }
        // If `adaptive` finds no spot there is none: a fit to a hot pixel is not to be trusted.
        found => found?,
    };
    let fit = Estimator::GaussNewton;
    Estimate::of(fit, found, false, row, spot, geometry, budget)
}

/// Measures a spot with a flat top, on a row that counts the pixels of this top as saturated. Does
/// what the estimator does at a saturation that is known: only [`gauss_newton`] measures by the flanks alone.
///
/// # Errors
/// [`Fault::Saturated`] from every other estimator, and if the budget is too small.
#[cold]
#[inline(never)]
fn measure_flanks(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    found: &RowCentre,
    geometry: &Geometry,
    budget: &mut WorkBudget,
) -> Result<RowCentre, Fault> {
    let pixels = count_saturated_pixels(row, found.centre, found.width.to_f32());
    let saturated = Fault::Saturated { pixels };
    if estimator != Estimator::GaussNewton {
        return Err(saturated);
    }
    budget.pay(work_of_fit(spot)).ok_or(saturated)?;
    gauss_newton::centre(row, spot, None, geometry)
}
