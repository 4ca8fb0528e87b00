//! The steps of a spot that was found on a row: estimate, verdict, repair.

use crate::base::{Fault, WorkBudget};
use crate::centre::estimate::{estimate, estimate_image, estimate_robustly};
use crate::centre::{Estimator, RowCentre};
use crate::check::own_spot::Profile;
use crate::check::{self, Verdict, judge, other_spot, repair};
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// Finds the centre of a spot that stands alone on its row.
///
/// If the row fails the check about the estimate, the repair masks samples and fits the rest. Its centre
/// replaces the first one if the row, without those samples, passes the check about it. Otherwise the first
/// one stays, because in speckle the robust fit is worse than a plain one.
///
/// `before` is the centre in the row before of the same frame. Without one, all of the row is searched for
/// another spot.
///
/// # Errors
/// Those of [`estimate`]; [`Fault::TwoSpots`] if there is another spot.
#[inline(always)]
pub fn centre_of_spot(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
    mut budget: WorkBudget,
) -> Result<RowCentre, Fault> {
    let budget = &mut budget;
    let estimate = estimate(estimator, row, spot, before, geometry, budget)?;
    let verdict = judge(&estimate, row, spot, geometry, profile, budget);
    let mut found = verdict.of(&estimate.found);
    if verdict.may_be_repaired && estimator != Estimator::GaussNewton {
        let row = estimate.row(row);
        found = repair_or_keep(
            estimator, row, spot, before, geometry, profile, found, budget,
        );
    }
    let is_alone = before.is_some() || other_spot::check(row, spot, &found, *budget)?;
    Ok(RowCentre {
        misfit: found.misfit || !is_alone || check::may_be_bad_pixels(&found),
        ..found
    })
}

/// Finds the centre of one of several images on a row. There is no repair: an image that fails the check has
/// a flag, and the others take its place.
///
/// # Errors
/// Those of [`estimate_image`].
#[inline(never)]
pub fn centre_of_image(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    budget: &mut WorkBudget,
) -> Result<RowCentre, Fault> {
    let estimate = estimate_image(estimator, row, spot, before, geometry, budget)?;
    let found = judge(&estimate, row, spot, geometry, None, budget).of(&estimate.found);
    Ok(RowCentre {
        misfit: found.misfit || check::may_be_bad_pixels(&found),
        ..found
    })
}

/// Finds the centre of a spot by the robust estimate and its repair, whatever the estimator.
///
/// # Errors
/// Those of [`estimate_robustly`].
pub fn robust_centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
    budget: &mut WorkBudget,
) -> Result<RowCentre, Fault> {
    let estimate = estimate_robustly(row, spot, before, geometry, budget)?;
    let row = estimate.row(row);
    let Verdict {
        shape,
        is_clean,
        may_be_repaired,
        ..
    } = check::by_symmetry(row, spot, &estimate.found, geometry, profile);
    let repaired = match may_be_repaired {
        true => repair::repair(row, spot, geometry, profile, &estimate.found, budget),
        false => None,
    };
    Ok(repaired.unwrap_or(RowCentre {
        shape,
        misfit: !is_clean,
        ..estimate.found
    }))
}

/// The repaired centre if the row is symmetric about it, otherwise the one that was found. The table class
/// stays that of the estimator.
#[cold]
#[inline(never)]
#[expect(
    clippy::too_many_arguments,
    reason = "a step's inputs, each of its own"
)]
fn repair_or_keep(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
    found: RowCentre,
    budget: &mut WorkBudget,
) -> RowCentre {
    let repaired = match estimator {
        // Its centre is the one from which a repair starts, and has failed the check.
        Estimator::Adaptive => repair::repair(row, spot, geometry, profile, &found, budget),
        _ => robust_centre(row, spot, before, geometry, profile, budget).ok(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{gaussian, hash, row, tcd1304dg};

    /// A spot of 60 pixels, in the row's middle or cut by its end. The budget is used up before its estimate.
    #[test]
    fn without_budget_a_wide_spot_has_a_flag_and_a_cut_spot_a_fault() {
        for (centre, is_cut) in [(900.0f32, false), (20.0, true)] {
            let light: [u16; 2000] = core::array::from_fn(|i| {
                let spot = (300.0 + 2000.0 * gaussian(i, centre, 60.0)) as u16;
                spot + (hash(i) >> 30) as u16
            });
            let row = row(&light);
            let (spot, budget) = crate::spot::find(&row).expect("a spot");
            let measure = |budget| {
                let estimator = Estimator::PhaseTable;
                centre_of_spot(estimator, &row, &spot, None, &tcd1304dg(), None, budget)
            };
            let found = measure(budget).expect("a centre");
            assert!((found.centre.to_f32() - centre).abs() < 1.0, "{found:?}");
            assert!(!found.misfit, "{found:?}");
            let mut nothing = budget;
            assert_eq!(nothing.pay(budget.left()), Some(()));
            match measure(nothing) {
                Err(Fault::SpotAtEdge { .. }) if is_cut => {}
                Ok(found) if !is_cut => assert!(found.misfit),
                found => panic!("{found:?}"),
            }
        }
    }
}
