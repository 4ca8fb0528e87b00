//! Estimators that other firmware uses. The firmware has none of them: `phase-table` is faster and more
//! accurate.

pub mod parabola;
pub mod zero_crossing;

use slitrange::base::fault::Fault;
use slitrange::base::units::Counts;
use slitrange::centre::plausible::check_uncertainty;

/// Rejects an uncertain centre, as [`check_uncertainty`], where the uncertainty comes from a few pixels'
/// counts. Where the search took noise for a spot, those pixels were chosen for being high and seem sharper
/// than they are, so the Cramér-Rao bound in that noise must pass too.
///
/// # Errors
/// See [`check_uncertainty`].
#[inline]
fn check_uncertainty_in_noise(
    amplitude: f32,
    uncertainty: f32,
    width: f32,
    noise: Counts,
) -> Result<(), Fault> {
    /// The bound over sqrt(sigma) noise / A: sqrt(2 / sqrt(pi)).
    const BOUND: f32 = 1.062_3;
    let bound = BOUND * dual_mac::square_root(width) * noise.to_f32() / amplitude;
    // Where one is not a number, one of the two checks fails.
    let larger = if bound < uncertainty {
        uncertainty
    } else {
        bound
    };
    check_uncertainty(amplitude, uncertainty, width)?;
    check_uncertainty(amplitude, larger, width)
}
