//! The phase-table score with weights that follow the row: the width of its spot, its noise, and the
//! background under the spot.
//!
//! Each set in [`MIXES`] is the best for one ratio r, the variance of the read noise over that of the shot
//! noise at the peak. The row's own r chooses the set. The third product, smoothed over the rows, gives the
//! width. If the background beside the spot is tilted, the set [`TILTED`] takes over: a tilt changes neither
//! its score nor its slope. This set costs 5 % of accuracy in white noise. With the other sets, a tilt of one
//! count a pixel would shift a centre by hundredths of a pixel (narrow spots) to whole ones (wide, dim ones).
//! As long as the tilt lasts, each row takes two more measurements.

use crate::base::{Counts, Fault, Pixels, numeric};
use crate::centre::RowCentre;
use crate::centre::phase_table::{self, Fit, WidthSource};
use crate::centre::plausible::check_uncertainty;
use crate::centre::tables::{MIXES, Sampling, TILTED, TableSet};
use crate::row::{Geometry, Light, Row};
use crate::spot::Spot;

/// Finds the centre of a spot.
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    fit(row, spot, before, geometry)?.with_uncertainty(spot.background.noise, geometry)
}

/// Finds the table that fits, in the set that serves the row best.
#[inline(always)]
pub(super) fn fit(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<Fit<'static>, Fault> {
    let noise = spot.background.noise;
    let expected = before.map_or(spot.height, |before| before.amplitude);
    let tables = for_mix(noise, expected.to_f32(), geometry);
    let mut fit = phase_table::fit(
        row,
        spot,
        before,
        geometry,
        tables,
        WidthSource::Measured,
        Sampling::Fine,
    )?;
    if before.is_none() {
        // The coarse search may know only half of the spot's height.
        let better = for_mix(noise, fit.amplitude(), geometry);
        fit = phase_table::refit(row.light(), &fit, better).unwrap_or(fit);
    }
    if is_tilted(row.light(), &fit, noise) {
        // Noise may look like a spot to one set of tables. It seldom does to two.
        let uncertainty = LEAST_EVIDENCE * fit.uncertainty(noise, geometry);
        check_uncertainty(fit.amplitude(), uncertainty, fit.width)?;
        fit = phase_table::refit(row.light(), &fit, &TILTED).unwrap_or(fit);
    }
    Ok(fit)
}

/// The least evidence of a spot on a tilt, in the tables that do not know of the tilt: this part of what a
/// spot without a tilt must have. Nearly all spots that [`TILTED`] shows have more. Where light rises along
/// the row, noise that [`TILTED`] takes for a spot, or nearly, has 0.3 to 0.77.
const LEAST_EVIDENCE: f32 = 0.8;

/// The tables for the noise of a spot of this height in counts.
fn for_mix(noise: Counts, height: f32, geometry: &Geometry) -> &'static TableSet<'static> {
    let read = noise.to_f32() * noise.to_f32();
    let shot = height * f32::from(geometry.shot_variance_per_count_q16) / 65536.0;
    let [white, ..] = &MIXES;
    MIXES
        .iter()
        .find(|mix| read >= mix.least * shot)
        .unwrap_or(white)
        .tables
}

/// Pixels in a flank: the background on one side of the spot, which is tested for a tilt.
const FLANK: usize = 16;
/// The standard deviation of the flanks' difference, over that of a pixel: sqrt(2 * FLANK).
const DEVIATION: f32 = 5.657;
/// The least difference of the flanks that is a tilt, in standard deviations. Noise alone gets there in one
/// row of 16,000.
const TILT: f32 = 4.0;
/// Widths from the centre to the flanks. The side lobes of a slit's diffraction pattern, which are 4.5 % of
/// its peak at four widths, are 1 % there.
const CLEAR: f32 = 6.0;

/// Whether the background is higher on one side of the spot than on the other. `false` where a flank reaches
/// over the sensor's edge.
fn is_tilted(light: Light<'_>, fit: &Fit<'_>, noise: Counts) -> bool {
    let Some((left, right)) = flanks(light, fit) else {
        return false;
    };
    let difference = sum(right) as f32 - sum(left) as f32;
    difference.abs() > TILT * DEVIATION * noise.to_f32()
        && is_straight(left, right, difference, fit.width, noise)
}

/// Whether each flank rises as steeply as the difference between the two says. A second spot on one flank
/// makes a difference too, but not that rise.
#[cold]
fn is_straight(
    left: Light<'_>,
    right: Light<'_>,
    difference: f32,
    width: f32,
    noise: Counts,
) -> bool {
    // Counts a pixel: `tilt` from flank to flank, `within` from one half of a flank to the other.
    let tilt = difference / FLANK as f32 / (2.0 * CLEAR * width + FLANK as f32);
    const HALF: usize = FLANK / 2;
    let within = |flank: Light<'_>| {
        let (first, second) = flank.split(HALF);
        (sum(second) as f32 - sum(first) as f32) / (HALF * HALF) as f32
    };
    // The standard deviation within a flank is sqrt(2 HALF) / HALF^2 = 1/16 of a pixel's.
    let allowed = 0.5 * tilt.abs() + TILT / 16.0 * noise.to_f32();
    (within(left) - tilt).abs() <= allowed && (within(right) - tilt).abs() <= allowed
}

/// The flanks to the left and to the right, equally far from the centre to half a pixel, so that the light of
/// a symmetric spot does not look like a tilt.
fn flanks<'a>(light: Light<'a>, fit: &Fit<'_>) -> Option<(Light<'a>, Light<'a>)> {
    const HALF: i32 = 1 << (Pixels::FRACTION - 1);
    // A centre is below 2^13 pixels, a width below 2^8.
    let centre = fit.centre.to_bits();
    let reach = Pixels::from_positive_f32(CLEAR * fit.width).to_bits();
    let right = (numeric::add_i32(centre, reach) >> Pixels::FRACTION) + 1;
    // The mirror image of the pixel before `right`: there the left flank ends.
    let left =
        (numeric::add_i32(numeric::mul_i32(2, centre), 3 * HALF) >> Pixels::FRACTION) - right;
    let from = usize::try_from(left).ok()?.checked_sub(FLANK)?;
    let to = usize::try_from(right).ok()? + FLANK;
    let pixels = light.slice(from..to)?;
    let end = pixels.len().checked_sub(FLANK)?;
    Some((pixels.slice(..FLANK)?, pixels.slice(end..)?))
}

/// The sum of a flank, or of half of one: below 2^16.
fn sum(flank: Light<'_>) -> u32 {
    flank.iter().map(u32::from).fold(0, numeric::add_u32)
}
