//! The spot's centre on its row, to a fraction of a pixel: five estimators, from the cheapest to the most
//! careful.
//!
//! All take the same arguments and return the same result: see [`centre`].
//!
//! To add an estimator, write its file here and add a variant to [`Estimator`]. The compiler names most
//! places that need a case of it. It does not name these, where a new estimator is treated as `phase-table`
//! is: [`Estimator::by_shape`], `above_black`, the [`estimate`] of a cut or flat spot, and the repair in
//! [`measurement`](crate::measurement).
//!
//! A fit measures a spot that the sensor's edge or saturation cuts. A spot whose top is cut off at a level
//! that nobody stated is recognised by its flat top (`flat_top`). From then on the pixels of the top count as
//! saturated: [`gauss_newton`] measures by the flanks, and the other estimators have the fault
//! [`Fault::Saturated`].

mod centroid;
mod flat_top;
pub mod gauss_newton;
pub mod half_width;
pub mod phase_table;
pub mod spot_shape;
pub mod tables;

use core::ops::Range;

use serde::{Deserialize, Serialize};

use crate::base::{Counts, Fault, Pixels, WorkBudget, named, numeric};
use crate::centre::spot_shape::{OwnSpot, SpotShape};
use crate::row::{Geometry, Light, Row};
use crate::spot::Spot;

/// A way to find a row's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Estimator {
    /// The centroid of the counts above the black level, eq. (2).
    Centroid,
    /// The phase-table score with one set of weights for every row.
    PhaseTable,
    /// The phase-table score with weights that follow the spot's width, noise and asymmetry, and the
    /// background's tilt.
    #[default]
    Adaptive,
    /// A weighted least-squares fit of eq. (5), by the Gauss-Newton method: the paper's fit.
    GaussNewton,
    /// The phase-table score for the diffraction pattern of a slit, eq. (6).
    Fraunhofer,
}

named! {
    Estimator {
        Centroid: "centroid",
        PhaseTable: "phase-table",
        Adaptive: "adaptive",
        GaussNewton: "gauss-newton",
        Fraunhofer: "fraunhofer"
    }
}

impl Estimator {
    /// The standard uncertainty of a calibrated centre by the spot's shape. `own` is the sensor's own spot.
    pub fn by_shape(self, shape: &SpotShape, own: Option<&OwnSpot>) -> Pixels {
        match self {
            Self::Adaptive => shape.uncertainty_by_sets(own),
            _ => shape.uncertainty(own),
        }
    }

    /// The letter in the line of a reading, which has no room for a name.
    pub const fn letter(self) -> char {
        match self {
            Self::Centroid => 'c',
            Self::PhaseTable => 't',
            Self::Adaptive => 'a',
            Self::GaussNewton => 'g',
            Self::Fraunhofer => 'f',
        }
    }
}

/// What an estimator finds in a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RowCentre {
    /// The spot's centre.
    pub centre: Pixels,
    /// The standard uncertainty of the centre that follows from the row's noise and the spot's shot noise.
    pub uncertainty: Pixels,
    /// The spot's height above the background. The [`check`](crate::check) replaces the estimator's by that
    /// of the gaussian that fits the light best. The centroid's is above the black level.
    pub amplitude: Counts,
    /// The spot's width (a gaussian's sigma), as the estimator needs it: see also [`SpotShape::width`].
    pub width: Pixels,
    /// The phase table that was used, if any.
    pub class: WidthClass,
    /// The spot's antisymmetric light and its width. The [`check`](crate::check) measures it;
    /// the estimators leave it at zero.
    pub shape: SpotShape,
    /// The row does not have the shape of a spot, or its asymmetry is too large for `shape` to express: the
    /// centre may be off by more than its uncertainty. Of the estimators only [`Estimator::GaussNewton`]
    /// sets this flag; the [`check`](crate::check) sets it for all.
    pub misfit: bool,
}

/// Which phase table was used, and the pixels in a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WidthClass {
    /// Number of the table set.
    pub set: u8,
    /// Index of the table in its set.
    pub table: u8,
    /// Pixels in a sample.
    pub block: u8,
}

/// Finds the centre of a spot that the coarse search found.
///
/// `before` is the result of the same estimator for the row before, if there is one. As far as its width and
/// its place still fit, they need not be found again.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where the pixels that the estimator needs reach over the sensor's edge.
/// [`Fault::Saturated`] where a pixel within two widths of the centre is saturated. [`Fault::TooDim`]
/// where the noise leaves the centre uncertain by more than an eighth of the width. [`Fault::NoSpot`] where
/// the light there does not have the shape of a spot.
// Inlined, so that a program whose estimator is fixed at compile time does not contain the others.
#[inline(always)]
pub fn centre(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    match estimator {
        Estimator::Centroid => centroid::centre(row, spot, before, geometry),
        Estimator::GaussNewton => gauss_newton::centre(row, spot, before, geometry),
        Estimator::Adaptive => phase_table::adaptive(row, spot, before, geometry),
        Estimator::Fraunhofer => phase_table::fraunhofer(row, spot, before, geometry),
        Estimator::PhaseTable => {
            phase_table::centre(row, spot, before, geometry, &tables::GAUSSIAN)
        }
    }
}

/// A centre with its height above the black level, if that is what the centroid sums. The other estimators
/// fit or cancel the level under the spot, and measure the height above it.
///
/// # Errors
/// [`Fault::NoSpot`] if the centroid's height is not above zero.
#[inline(always)]
pub(crate) fn above_black(
    estimator: Estimator,
    spot: &Spot,
    found: RowCentre,
) -> Result<RowCentre, Fault> {
    if estimator != Estimator::Centroid {
        return Ok(found);
    }
    let amplitude = spot.above_black(found.amplitude);
    if amplitude <= Counts::default() {
        return Err(spot.no_spot());
    }
    Ok(RowCentre { amplitude, ..found })
}

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
        let width = whole_pixels(self.found.width.to_bits());
        let wider = width.saturating_sub(USUAL_WIDTH);
        wider.saturating_mul(WORK_OF_PIXEL)
    }

    /// Measures a spot with a flat top again, by its flanks.
    #[inline(always)]
    pub(crate) fn of(
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
    let widest = whole_pixels(half_width::WIDTHS.end().to_bits());
    spot.block().saturating_mul(2).min(widest)
}

/// Estimates the centre of a spot that stands alone on its row. [`gauss_newton`] fits a spot that the
/// sensor's edge cuts, whatever the estimator: no other estimator takes a cut window.
///
/// # Errors
/// See [`centre`]; [`Fault::SpotAtEdge`] where the fit has no centre either; [`Fault::Saturated`]
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
    match centre(estimator, row, spot, before, geometry) {
        Err(at_edge @ Fault::SpotAtEdge { .. }) if estimator != Estimator::GaussNewton => {
            budget.pay(work_of_fit(spot)).ok_or(at_edge)?;
            let found = gauss_newton::centre(row, spot, before, geometry)?;
            let fit = Estimator::GaussNewton;
            Estimate::of(fit, found, true, row, spot, geometry, budget)
        }
        found => Estimate::of(estimator, found?, false, row, spot, geometry, budget),
    }
}

/// Estimates the centre from which a repair starts: `adaptive`'s, or a fit's if pixels are saturated.
///
/// # Errors
/// See [`centre`]; [`Fault::Saturated`] only where the pixels that are not saturated are too few.
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
    let found = match phase_table::adaptive(row, spot, before, geometry) {
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
    let pixels = count_saturated_pixels(row, found.centre, found.width);
    let saturated = Fault::Saturated { pixels };
    if estimator != Estimator::GaussNewton {
        return Err(saturated);
    }
    budget.pay(work_of_fit(spot)).ok_or(saturated)?;
    gauss_newton::centre(row, spot, None, geometry)
}

/// The uncertainty of a centre must be at most the width over this. Noise alone may look like a dimmer spot.
const DIMMEST: i64 = 8;

/// Rejects a spot with a saturated pixel within two widths of the centre: its top is lost.
///
/// # Errors
/// [`Fault::Saturated`] with the number of such pixels.
#[inline]
pub(crate) fn check_saturation(row: &Row<'_>, centre: Pixels, width: Pixels) -> Result<(), Fault> {
    // Most rows are saturated nowhere near.
    if !row.reaches_saturation(two_widths(centre, width)) {
        return Ok(());
    }
    match count_saturated_pixels(row, centre, width) {
        0 => Ok(()),
        pixels => Err(Fault::Saturated { pixels }),
    }
}

/// Counts the saturated pixels within two widths of the centre.
#[inline(never)]
pub(crate) fn count_saturated_pixels(row: &Row<'_>, centre: Pixels, width: Pixels) -> u16 {
    let (light, saturation) = (row.light(), row.saturated_from());
    let Range { start, end } = two_widths(centre, width);
    let near = light.slice(start.min(light.len())..end.min(light.len()));
    near.into_iter()
        .flat_map(Light::iter)
        .fold(0, |pixels, count| {
            u16::saturating_add(pixels, (count >= saturation).into())
        })
}

/// The pixels within two widths of the centre, to one pixel.
fn two_widths(centre: Pixels, width: Pixels) -> Range<usize> {
    let centre = whole_pixels(centre.to_bits());
    let reach = whole_pixels(width.to_bits().saturating_mul(2));
    let start = centre.saturating_sub(reach).saturating_sub(1);
    start..centre.saturating_add(reach).saturating_add(2)
}

/// The whole pixels in a place or a width, Q16. A negative one has none.
fn whole_pixels(bits: i32) -> usize {
    usize::try_from(bits >> Pixels::FRACTION).unwrap_or_default()
}

/// Rejects a centre whose uncertainty is more than an eighth of the width.
///
/// # Errors
/// [`Fault::TooDim`], with the height at which the uncertainty would be small enough, if the noise did not
/// grow with the light.
#[inline]
pub(crate) fn check_uncertainty(
    amplitude: Counts,
    uncertainty: Pixels,
    width: Pixels,
) -> Result<(), Fault> {
    if i64::from(uncertainty.to_bits()) * DIMMEST <= width.to_bits().into() {
        return Ok(());
    }
    Err(too_dim(amplitude, uncertainty, width))
}

#[cold]
fn too_dim(amplitude: Counts, uncertainty: Pixels, width: Pixels) -> Fault {
    let light = numeric::product(amplitude.to_bits(), uncertainty.to_bits());
    let needed = (light.saturating_mul(DIMMEST)).checked_div(width.to_bits().into());
    Fault::TooDim {
        amplitude,
        needed: Counts::from_bits(numeric::saturated(needed.unwrap_or(i64::MAX))),
    }
}

/// Converts the spot's pixel to a position.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where it is not on the row.
pub(crate) fn position_on_row(light: Light<'_>, spot: &Spot) -> Result<Pixels, Fault> {
    match i32::try_from(spot.centre) {
        // A row has at most 4096 pixels: Q16 holds them.
        Ok(centre) if spot.centre < light.len() => Ok(Pixels::from_int(centre)),
        _ => Err(Fault::SpotAtEdge {
            centre: Pixels::MAX,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_letters_tell_estimators_apart() {
        for it in Estimator::ALL {
            assert_eq!(Estimator::named(it.name()), Some(it));
            let same = Estimator::ALL
                .into_iter()
                .filter(|other| other.letter() == it.letter());
            assert_eq!(same.count(), 1, "{}", it.letter());
        }
        for name in ["", "Adaptive", "adaptive ", "t"] {
            assert_eq!(Estimator::named(name), None, "{name}");
        }
    }

    #[test]
    fn pixels_within_two_widths_count_as_saturated() {
        let mut light = [100u16; 64];
        let count = |light: &[u16], saturation, centre, width| {
            let row = Row::new(light, &[], saturation).expect("12 bits");
            count_saturated_pixels(&row, centre, Pixels::from_f32(width))
        };
        let centre = Pixels::from_f32(32.5);
        assert_eq!(count(&light, 4095, centre, 2.0), 0);
        (light[27], light[32], light[37]) = (4095, 2500, 4095);
        for (saturation, centre, width, expected) in [
            (4095, centre, 2.0, 2),
            (2501, centre, 2.0, 2),
            (2500, centre, 2.0, 3),
            (4095, centre, 1.4, 0),
            (4095, Pixels::MAX, f32::MAX, 2),
        ] {
            assert_eq!(count(&light, saturation, centre, width), expected);
        }
        assert_eq!(count(&[], 4095, Pixels::MIN, f32::MIN), 0);
    }

    #[test]
    fn an_eighth_of_the_width() {
        let [amplitude, needed] = [100, 200].map(Counts::from_int);
        let too_dim = Err(Fault::TooDim { amplitude, needed });
        let [width, u] = [2.0, 0.25].map(Pixels::from_f32);
        assert_eq!(check_uncertainty(amplitude, u, width), Ok(()));
        assert_eq!(
            check_uncertainty(amplitude, u.max(Pixels::from_f32(0.5)), width),
            too_dim
        );
        let needed = Counts::MAX;
        let never = Err(Fault::TooDim { amplitude, needed });
        assert_eq!(
            check_uncertainty(amplitude, Pixels::MAX, Pixels::default()),
            never
        );
    }
}
