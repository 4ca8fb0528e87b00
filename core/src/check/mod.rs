//! Judges a centre by its row's mirror symmetry.
//!
//! A centre can be wrong in ways that its uncertainty does not cover, because the uncertainty is only that of
//! noise. The causes are a second spot, a hot pixel, a background that rises, or light that blooms to one
//! side. A sharp test against the spot's shape would see them, but would also reject each profile that is no
//! gaussian: an exact Fresnel pattern lies 7 % from it.
//!
//! All estimators are unbiased for a symmetric spot, whatever its shape. Only the *antisymmetric* part of a
//! row moves a centre, and a good spot has no antisymmetric part. So `symmetry` compares the row with its
//! mirror image about the centre, to the noise, with hardly a tolerance for shape. A sensor that knows its
//! own spot ([`crate::check::own_spot`]) subtracts that spot's antisymmetric part first.
//!
//! In orthonormal Hermite functions of u = (x - c) / sigma, a second spot at d widths has the components a^n
//! / sqrt(n!), with a = d / sqrt(2). The first component moves the centre, so it is zero about the moved
//! centre. The third component remains: 0.8 of the first at two widths, and more beyond. It has a test of its
//! own (*skew*), and so has a straight slope (*tilt*). Such a test sees a component of 4 standard deviations,
//! where a chi-square of 60 pixels needs one of 7. The worst pair shows a bad pixel, and the sum of squares
//! the rest.
//!
//! A symmetric flaw moves the centre of no single spot. But two equal spots have a centre between them, and
//! boxes and clusters of bad pixels have a centre too. So the check also compares the sums of the pairs with
//! a gaussian, loosely.
//!
//! If a row fails the check, the measurement tries [`repair`]. If that finds no better centre, the spot's
//! shape makes u larger ([`crate::centre::spot_shape`]), and the row is flagged only where u cannot express
//! the error. `other_spot` searches the rest of the row for a second spot.

pub(crate) mod other_spot;
pub mod own_spot;
pub mod repair;
mod symmetry;

use crate::base::{WorkBudget, numeric};
use crate::centre::RowCentre;
use crate::centre::estimate::Estimate;
use crate::centre::gauss_newton::MaskedPixels;
use crate::centre::spot_shape::SpotShape;
use crate::check::own_spot::Profile;
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// A narrower spot, in pixels, is flagged. Three bad pixels side by side look like a spot of 0.95, and with
/// noise like one of up to 1.2. Nothing in a row tells them from a spot.
const NARROWEST_SURE: f32 = 1.2;
/// If the sensor's edge cuts a narrower spot, in pixels, nothing tells it from bad pixels.
const NARROWEST_CUT: f32 = 1.25;
/// If the shape's part of u exceeds this many widths, the row is flagged.
const LARGEST_SHAPE: f32 = 0.5;
/// A narrower spot, in pixels, is flagged if it is not symmetric: a single bad pixel looks like a shape
/// there.
const NARROWEST_WITH_SHAPE: f32 = repair::NARROWEST_SURE_REFIT;

/// What the check says of a centre.
#[derive(Clone, Copy, Debug)]
pub struct Verdict {
    /// The spot's shape. The estimate's own one where the check had too few pairs.
    pub shape: SpotShape,
    /// Nothing is wrong with the centre.
    pub is_clean: bool,
    /// The light is no spot, or the shape's part of u is too large.
    pub misfit: bool,
    /// Something is wrong, and a repair may find a better centre.
    pub may_be_repaired: bool,
}

impl Verdict {
    /// The centre with its shape and its flag.
    #[inline(always)]
    pub fn of(&self, found: &RowCentre) -> RowCentre {
        RowCentre {
            shape: self.shape,
            misfit: self.misfit,
            ..*found
        }
    }
}

/// Judges an estimate by its row's symmetry. A wide spot takes the work of estimator and check from the
/// budget; if too little is left it has a flag.
#[inline(always)]
pub fn judge(
    estimate: &Estimate<'_>,
    row: &Row<'_>,
    spot: &Spot,
    geometry: &Geometry,
    profile: Option<&Profile>,
    budget: &mut WorkBudget,
) -> Verdict {
    let Estimate { found, is_cut, .. } = estimate;
    let row = estimate.row(row);
    // A cut spot has paid for its fit.
    if !is_cut && budget.pay(estimate.work()).is_none() {
        return Verdict {
            shape: found.shape,
            is_clean: false,
            misfit: true,
            may_be_repaired: false,
        };
    }
    let verdict = by_symmetry(row, spot, found, geometry, profile);
    if *is_cut {
        return Verdict {
            misfit: !verdict.is_clean || !is_certain_cut(row, found),
            may_be_repaired: false,
            ..verdict
        };
    }
    verdict
}

/// Whether a spot is so narrow that it may be a few bad pixels.
#[inline(always)]
pub(crate) fn may_be_bad_pixels(found: &RowCentre) -> bool {
    found.width.to_f32() < NARROWEST_SURE
}

/// Compares a row with its mirror image about a centre. A fit's own flag stays if saturation or the sensor's
/// edge cuts the spot; for a whole spot the fit would flag every profile that is no gaussian.
pub(crate) fn by_symmetry(
    row: &Row<'_>,
    spot: &Spot,
    found: &RowCentre,
    geometry: &Geometry,
    profile: Option<&Profile>,
) -> Verdict {
    let own = profile.map(|profile| profile.at(row.on_sensor(found.centre)));
    let own = own.as_ref();
    let nothing = MaskedPixels::default();
    let verdict = symmetry::check(row, spot, found, geometry, own, &nothing);
    let Some(verdict) = verdict else {
        let misfit = found.misfit || found.width.to_f32() < NARROWEST_CUT;
        return Verdict {
            shape: found.shape,
            is_clean: !misfit,
            misfit,
            may_be_repaired: misfit,
        };
    };
    let shape = verdict.shape;
    let is_sound = verdict.is_spot && !(found.misfit && !is_whole(row, found));
    let is_clean = is_sound && verdict.is_symmetric;
    let width = found.width.to_f32();
    let is_expressed = verdict.is_symmetric
        || width > NARROWEST_WITH_SHAPE && shape.uncertainty(own).to_f32() <= LARGEST_SHAPE * width;
    Verdict {
        shape,
        is_clean,
        misfit: !(is_sound && is_expressed),
        may_be_repaired: !is_clean && !verdict.is_hopeless,
    }
}

/// Whether the part of a spot that the edge leaves is enough to tell it from a background that falls towards
/// the edge.
fn is_certain_cut(row: &Row<'_>, found: &RowCentre) -> bool {
    let width = found.width.to_f32();
    32.0 * found.uncertainty.to_f32() <= width && row.light().len() as f32 >= 8.0 * width
}

/// Whether all of the spot within five widths is on the row, and no pixel of it saturated.
fn is_whole(row: &Row<'_>, found: &RowCentre) -> bool {
    let reach = 5.0 * found.width.to_f32();
    // A row has at most 2^12 pixels.
    let (centre, end) = (found.centre.to_f32(), row.light().len() as f32 - 1.0);
    let last = numeric::whole_usize(centre + reach);
    let near = numeric::whole_usize(centre - reach)..last.saturating_add(1);
    centre >= reach && end - centre >= reach && !row.reaches_saturation(near)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{found_at, row};

    #[test]
    fn a_spot_is_whole_if_five_widths_fit_on_both_sides_and_nothing_is_saturated() {
        let mut light = [300; 101];
        for (centre, is_so) in [(49.5, false), (50.0, true), (50.5, false)] {
            let found = is_whole(&row(&light), &found_at(centre, 10.0));
            assert_eq!(found, is_so, "{centre}");
        }
        light[3] = 4095;
        assert!(!is_whole(&row(&light), &found_at(50.0, 10.0)));
    }

    #[test]
    fn a_cut_spot_needs_a_small_uncertainty_and_a_row_of_eight_widths() {
        // 32 * 0.25 = 8, and 8 * 12.625 = 101.
        for (width, is_so) in [(7.9, false), (8.0, true), (12.625, true), (12.7, false)] {
            let found = is_certain_cut(&row(&[300; 101]), &found_at(1.0, width));
            assert_eq!(found, is_so, "{width}");
        }
    }
}
