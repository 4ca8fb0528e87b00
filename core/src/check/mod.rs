//! Checks a centre against the row's mirror symmetry, and tries the robust fit if the check fails.
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
//! | component | statistic | its noise |
//! |---|---|---|
//! | shift, tilt, skew | r = sum w f z | sum w f^2, less its parts along those before |
//! | worst pair | w z^2 | 1 |
//! | squares | sum w z^2 of n pairs | 2 n + (0.06 n)^2 |
//!
//! with z the difference of a pair and 1 / w = 2 noise^2 + g p its variance: the row's noise and the shot
//! noise of its own light p.
//!
//! A symmetric flaw moves the centre of no single spot. But two equal spots have a centre between them, and
//! boxes and clusters of bad pixels have a centre too. So the check also compares the sums of the pairs with
//! a gaussian, loosely.
//!
//! A spot whose top is cut off at a level that nobody stated is recognised by its flat top (`flat_top`). From
//! then on the pixels of the top count as saturated: [`gauss_newton`] measures by the flanks, and the other
//! estimators have the fault [`Fault::Saturated`].
//!
//! If a row fails the check, [`repair`] masks samples and fits the rest. Its centre replaces the first one
//! if the row, without those samples, passes the check about it. Otherwise the first centre stays, because
//! in speckle the robust fit is worse than a plain one. The spot's shape then makes u larger
//! ([`crate::centre::spot_shape`]), and the row is flagged only where u cannot express the error. `other_spot` searches
//! the rest of the row for a second spot.

mod flat_top;
mod other_spot;
pub mod own_spot;
pub mod repair;
mod symmetry;

use crate::base::fault::Fault;
use crate::centre::gauss_newton::MaskedPixels;
use crate::centre::plausible::count_saturated_pixels;
use crate::centre::{self, Estimator, RowCentre, gauss_newton, half_width};
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

/// The estimator and the check take effort only for a spot that is wider than this, in pixels.
const USUAL_WIDTH: usize = 16;

/// They take so much for each pixel that the spot is wider.
const EFFORT_OF_PIXEL: usize = 15;

/// The effort of [`gauss_newton`] if it takes all its steps.
fn effort_of_fit(spot: &Spot) -> usize {
    widest(spot).saturating_mul(4).saturating_add(1400)
}

/// The most pixels that a spot may be wide, before its width is known.
fn widest(spot: &Spot) -> usize {
    let widest = *half_width::WIDTHS.end() as usize;
    spot.block().saturating_mul(2).min(widest)
}

/// Finds the centre of a spot that the coarse search found, and checks it.
///
/// [`gauss_newton`] fits a spot that the sensor's edge cuts, whatever the estimator: no other estimator takes
/// a cut window.
///
/// # Errors
/// See [`centre::centre`]; [`Fault::SpotAtEdge`] where the fit has no centre either;
/// [`Fault::Saturated`] also where the spot's top is flat.
pub fn centre(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
) -> Result<RowCentre, Fault> {
    let mut spot = *spot;
    let found = find_and_check(estimator, row, &mut spot, before, geometry, profile)?;
    let is_alone = before.is_some() || other_spot::check(row, &spot, &found)?;
    Ok(RowCentre {
        misfit: found.misfit || !is_alone || found.width.to_f32() < NARROWEST_SURE,
        ..found
    })
}

/// As [`centre`] for one of several images on a row: without a search of the rest of the row, and without a
/// repair. An image that fails the check is flagged, and the others take its place. Wide light takes its
/// effort from the spot's; fits are at most as many as there are images.
///
/// # Errors
/// As [`centre`].
#[inline(never)]
pub(crate) fn centre_of_one(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &mut Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let mut found = centre::centre(estimator, row, spot, before, geometry)?;
    let cut = flat_top::find(row, spot, &found, geometry);
    let cut = cut.map(|saturation| row.with_saturation(saturation));
    if let Some(row) = &cut {
        found = measure_flanks(estimator, row, spot, &found, geometry)?;
    }
    let row = cut.as_ref().unwrap_or(row);
    if spot.effort.pay(effort_of_width(&found)).is_none() {
        return Ok(RowCentre {
            misfit: true,
            ..found
        });
    }
    let found = check_symmetry(row, spot, found, geometry, None).found;
    Ok(RowCentre {
        misfit: found.misfit || found.width.to_f32() < NARROWEST_SURE,
        ..found
    })
}

/// Measures a spot with a flat top, on a row that counts the pixels of this top as saturated. Does
/// what the estimator does at a saturation that is known: only [`gauss_newton`] measures by the flanks alone.
///
/// # Errors
/// [`Fault::Saturated`] from every other estimator, and if too little effort is left.
#[cold]
#[inline(never)]
fn measure_flanks(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &mut Spot,
    found: &RowCentre,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let pixels = count_saturated_pixels(row, found.centre, found.width.to_f32());
    let saturated = Fault::Saturated { pixels };
    if estimator != Estimator::GaussNewton {
        return Err(saturated);
    }
    spot.effort.pay(effort_of_fit(spot)).ok_or(saturated)?;
    gauss_newton::centre(row, spot, None, geometry)
}

/// The effort of the estimator and the check for a spot of this width.
#[inline(always)]
fn effort_of_width(found: &RowCentre) -> usize {
    // `as` saturates.
    let wider = (found.width.to_f32() as usize).saturating_sub(USUAL_WIDTH);
    wider.saturating_mul(EFFORT_OF_PIXEL)
}

/// As [`centre`], without a search of the rest of the row.
#[inline(always)]
fn find_and_check(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &mut Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
) -> Result<RowCentre, Fault> {
    if estimator == Estimator::GaussNewton {
        spot.effort.pay(effort_of_fit(spot)).ok_or(spot.no_spot())?;
    }
    let mut found = match centre::centre(estimator, row, spot, before, geometry) {
        Err(at_edge @ Fault::SpotAtEdge { .. }) if estimator != Estimator::GaussNewton => {
            spot.effort.pay(effort_of_fit(spot)).ok_or(at_edge)?;
            let fit = Estimator::GaussNewton;
            let mut found = gauss_newton::centre(row, spot, before, geometry)?;
            let cut = flat_top::find(row, spot, &found, geometry);
            let cut = cut.map(|saturation| row.with_saturation(saturation));
            if let Some(row) = &cut {
                found = measure_flanks(fit, row, spot, &found, geometry)?;
            }
            let row = cut.as_ref().unwrap_or(row);
            let checked = check_symmetry(row, spot, found, geometry, profile);
            return Ok(RowCentre {
                misfit: !checked.is_clean || !is_certain_cut(row, &found),
                ..checked.found
            });
        }
        found => found?,
    };
    let cut = flat_top::find(row, spot, &found, geometry);
    let cut = cut.map(|saturation| row.with_saturation(saturation));
    if let Some(row) = &cut {
        found = measure_flanks(estimator, row, spot, &found, geometry)?;
    }
    let row = cut.as_ref().unwrap_or(row);
    // The estimator's part is paid only now, when the width is known.
    if spot.effort.pay(effort_of_width(&found)).is_none() {
        return Ok(RowCentre {
            misfit: true,
            ..found
        });
    }
    let checked = check_symmetry(row, spot, found, geometry, profile);
    let found = checked.found;
    if checked.may_be_repaired && estimator != Estimator::GaussNewton {
        return Ok(repair_or_keep(
            estimator, row, spot, before, geometry, profile, found,
        ));
    }
    Ok(found)
}

/// The repaired centre if the row is symmetric about it, otherwise the one that was found. The table class
/// stays that of the estimator.
#[cold]
#[inline(never)]
fn repair_or_keep(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &mut Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
    found: RowCentre,
) -> RowCentre {
    let repaired = match estimator {
        // Its centre is the repair's first one, and has failed the check.
        Estimator::Adaptive => repair::refit(row, spot, geometry, profile, found),
        _ => repair::centre_within(row, spot, before, geometry, profile).ok(),
    };
    match repaired {
        Some(other) if !other.misfit || other.width.to_f32() < repair::NARROWEST_SURE_REFIT => {
            RowCentre {
                class: found.class,
                ..other
            }
        }
        _ => found,
    }
}

/// A centre with what the check says of it.
struct Checked {
    /// With its shape, and a flag if the light is no spot or the shape's part of u is too large.
    found: RowCentre,
    /// Nothing is wrong with the centre.
    is_clean: bool,
    /// Something is wrong, and a repair may find a better centre.
    may_be_repaired: bool,
}

/// Compares a row with its mirror image about a centre. A fit's own flag stays if saturation or the sensor's
/// edge cuts the spot; for a whole spot the fit would flag every profile that is no gaussian.
fn check_symmetry(
    row: &Row<'_>,
    spot: &Spot,
    found: RowCentre,
    geometry: &Geometry,
    profile: Option<&Profile>,
) -> Checked {
    let own = profile.map(|profile| profile.at(found.centre));
    let own = own.as_ref();
    let nothing = MaskedPixels::default();
    let verdict = symmetry::check(row, spot, &found, geometry, own, &nothing);
    let Some(verdict) = verdict else {
        let misfit = found.misfit || found.width.to_f32() < NARROWEST_CUT;
        return Checked {
            found: RowCentre { misfit, ..found },
            is_clean: !misfit,
            may_be_repaired: misfit,
        };
    };
    let shape = verdict.shape;
    let is_sound = verdict.is_spot && !(found.misfit && !is_whole(row, &found));
    let is_clean = is_sound && verdict.is_symmetric;
    let width = found.width.to_f32();
    let is_expressed = verdict.is_symmetric
        || width > NARROWEST_WITH_SHAPE && shape.uncertainty(own).to_f32() <= LARGEST_SHAPE * width;
    Checked {
        found: RowCentre {
            misfit: !(is_sound && is_expressed),
            shape,
            ..found
        },
        is_clean,
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
    // `as` saturates.
    let near = (centre - reach) as usize..((centre + reach) as usize).saturating_add(1);
    centre >= reach && end - centre >= reach && !row.reaches_saturation(near)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::{Counts, Pixels};

    pub(super) fn found_at(centre: f32, width: f32) -> RowCentre {
        RowCentre {
            centre: Pixels::from_f32(centre),
            uncertainty: Pixels::from_f32(0.25),
            amplitude: Counts::from_int(1000),
            width: Pixels::from_f32(width),
            class: Default::default(),
            shape: Default::default(),
            misfit: false,
        }
    }

    #[test]
    fn a_spot_is_whole_if_five_widths_fit_on_both_sides_and_nothing_is_saturated() {
        let mut light = [300; 101];
        for (centre, is_so) in [(49.5, false), (50.0, true), (50.5, false)] {
            let row = Row::new(&light, &[], 4095).expect("12 bits");
            assert_eq!(is_whole(&row, &found_at(centre, 10.0)), is_so, "{centre}");
        }
        light[3] = 4095;
        let row = Row::new(&light, &[], 4095).expect("12 bits");
        assert!(!is_whole(&row, &found_at(50.0, 10.0)));
    }

    /// A spot of 60 pixels, in the row's middle or cut by its end, on a row whose search left no effort.
    #[test]
    fn without_effort_a_wide_spot_has_a_flag_and_a_cut_spot_a_fault() {
        let geometry = crate::row::sensor_heads::tcd1304dg();
        for (centre, is_cut) in [(900.0f32, false), (20.0, true)] {
            let light: std::vec::Vec<u16> = (0..2000u32)
                .map(|i| {
                    let u = (i as f32 - centre) / 60.0;
                    let noise = i.wrapping_mul(2_654_435_761) >> 30;
                    (300.0 + 2000.0 * libm::expf(-0.5 * u * u)) as u16 + noise as u16
                })
                .collect();
            let row = Row::new(&light, &[], 4095).expect("12 bits");
            let spot = crate::spot::find(&row).expect("a spot");
            let measure = |spot: &Spot| {
                let estimator = Estimator::PhaseTable;
                super::centre(estimator, &row, spot, None, &geometry, None)
            };
            let found = measure(&spot).expect("a centre");
            assert!((found.centre.to_f32() - centre).abs() < 1.0, "{found:?}");
            assert!(!found.misfit, "{found:?}");
            let mut tired = spot;
            assert_eq!(tired.effort.pay(spot.effort.left()), Some(()));
            let found = measure(&tired);
            if is_cut {
                assert!(matches!(found, Err(Fault::SpotAtEdge { .. })), "{found:?}");
            } else {
                assert!(found.expect("a centre").misfit);
            }
        }
    }

    #[test]
    fn a_cut_spot_needs_a_small_uncertainty_and_a_row_of_eight_widths() {
        let light = [300; 101];
        let row = Row::new(&light, &[], 4095).expect("12 bits");
        // 32 * 0.25 = 8, and 8 * 12.625 = 101.
        for (width, is_so) in [(7.9, false), (8.0, true), (12.625, true), (12.7, false)] {
            assert_eq!(
                is_certain_cut(&row, &found_at(1.0, width)),
                is_so,
                "{width}"
            );
        }
    }
}
