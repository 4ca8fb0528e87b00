//! Recognises a spot whose top is cut off below full scale, at a level that nobody stated.
//!
//! A full well holds the same charge in every row. So the pixels of a flat top show the read noise, but
//! neither the light's shot noise nor the spot's curvature. The test takes the K pixels about the centre that
//! differ little from the middle one, and the sum S of the squares of their deviations from their mean.
//!
//! **A spot that is not cut.** With the read noise's variance n^2, the height A and the shot noise's variance
//! g for a count, a pixel has the variance v = n^2 + g A. The parabola A i^2 / (2 w^2) at the pixel i has the
//! sum of squares L = (A / (2 w^2))^2 K (K^2 - 1) (K^2 - 4) / 180 about its mean. S / v is a noncentral
//! chi-square of k = K - 1 degrees of freedom with the noncentrality l = L / v. Chernoff's bound says: so
//! small an s = S / v has at most the probability e^-x, with
//!
//! 2 x = k ln q + l (1 - 1 / q) - s (q - 1)
//!
//! for any q of 1 or more. It is sharpest at the root q of s q^2 - k q - l.
//!
//! K comes from the row, but has only [`MOST_BESIDE`] values. With x = ln(32 * 10^5) noise makes at most one
//! row of 10^5 look flat. Some spots are flatter than a gaussian: see [`FLATTER`].
//!
//! **A flat top.** S / n^2 is a chi-square of k degrees of freedom. It exceeds k + 2 sqrt(k y) + 2 y with a
//! probability of at most e^-y (B. Laurent, P. Massart, Ann. Statist. 28, 1302 (2000), lemma 1). With
//! y = ln(1000) the test misses at most one flat top of 1000 here.
//!
//! The top counts as flat if S passes both tests.
//!
//! Most rows end at the first comparison: the middle pixel differs by more than [`NEAR`] from one of two
//! pixels beside it.

use crate::base::{Counts, Pixels, numeric};
use crate::centre::RowCentre;
use crate::row::{Geometry, Light, Row};
use crate::spot::Spot;

/// The most pixels on one side of the centre. With 64 degrees of freedom, shot noise alone shows that a spot
/// is not cut, however wide and flat its top is.
const MOST_BESIDE: usize = 32;
/// The pixels of the first comparison are so many sixteenths of the width from the centre. A gaussian is 5 %
/// lower there. A spot of 1.05 times the well is flat so far.
const SIXTEENTHS: i32 = 5;
/// The most by which a pixel of a flat top differs from the middle one, in standard deviations of the read
/// noise: 4.2 of the difference.
const NEAR: i32 = 6;
/// A spot's top may have so much of a gaussian's curvature.
const FLATTER: f32 = 0.5;
/// 2 x: x = ln(32 * 10^5).
const FALSE_ALARM: f32 = 29.957;
/// y: at most one miss in 1000.
const MISS: f32 = 6.908;
/// The noise's variance may be so much larger than the row's estimate. The noise is known to 3 %: this is two
/// standard deviations.
const NOISE: f32 = 1.12;
/// The variance of rounding to a count, in counts squared.
const ROUNDING: f32 = 1.0 / 12.0;
/// The least read noise for the test, rounding included: a standard deviation in counts. With less, the steps
/// of the converter hide the noise, and pixels are equal although none is saturated.
const LEAST_NOISE: f32 = 0.5;
/// The least height in standard deviations of the read noise. The width of a dimmer spot is not known well
/// enough.
const LEAST_HEIGHT: f32 = 16.0;
/// How far below the mean of a flat top its pixels are, in standard deviations of the read noise: all but one
/// pixel in 30,000.
const BELOW: f32 = 4.0;

/// Finds the count from which the pixels of a spot are saturated, if the spot's top is flat. `None` if the
/// top is not flat, or is at the row's own saturation, or the pixels are not all on the row.
#[inline(always)]
pub(super) fn find(
    row: &Row<'_>,
    spot: &Spot,
    found: &RowCentre,
    geometry: &Geometry,
) -> Option<u16> {
    const HALF: i32 = 1 << (Pixels::FRACTION - 1);
    const SHIFT: u32 = Pixels::FRACTION + 4;
    // A place off the row is no pixel.
    let middle = found.centre.to_bits().wrapping_add(HALF) >> Pixels::FRACTION;
    let middle = middle.cast_unsigned() as usize;
    // A width is at most 2^12 pixels in Q16.
    let beside = found.width.to_bits().wrapping_mul(SIXTEENTHS) >> SHIFT;
    let beside = (beside.cast_unsigned() as usize).clamp(1, MOST_BESIDE);
    let light = row.light();
    let count = light.get(middle)?;
    let near = most_difference(spot);
    let is_near = |other: u16| u32::from(other.abs_diff(count)) <= near;
    if !is_near(light.get(middle.wrapping_sub(beside))?)
        || !is_near(light.get(middle.wrapping_add(beside))?)
        || count >= row.saturated_from()
    {
        return None;
    }
    level_of_flat(light, middle, spot, found, geometry)
}

/// The most by which a pixel of a flat top differs from the middle one, in counts.
#[inline(always)]
fn most_difference(spot: &Spot) -> u32 {
    let noise = spot.background.noise.to_bits().saturating_mul(NEAR);
    (noise >> Counts::FRACTION).cast_unsigned()
}

/// The count from which the pixels about a place are saturated, if they form a flat top.
#[cold]
#[inline(never)]
fn level_of_flat(
    light: Light<'_>,
    place: usize,
    spot: &Spot,
    found: &RowCentre,
    geometry: &Geometry,
) -> Option<u16> {
    let (left, right) = light.split(place);
    let mut right = right.iter();
    let middle = right.next()?;
    let near = most_difference(spot);
    // Within a width a gaussian falls by more than the parabola with `FLATTER`.
    let most = numeric::whole_usize(found.width.to_f32()).clamp(1, MOST_BESIDE);
    // At most 65 differences of 12 bits, and 65 squares of 24 bits: below 2^31.
    let (mut sum, mut squares, mut pairs) = (0i32, 0i32, 0u16);
    for (left, right) in left.iter().rev().zip(right).take(most) {
        if u32::from(left.abs_diff(middle).max(right.abs_diff(middle))) > near {
            break;
        }
        for count in [left, right] {
            let difference = i32::from(count) - i32::from(middle);
            sum = numeric::add_i32(sum, difference);
            squares = numeric::add_i32(squares, numeric::mul_i32(difference, difference));
        }
        pairs = pairs.saturating_add(1);
    }
    let freedom = 2.0 * f32::from(pairs);
    let pixels = freedom + 1.0;
    let offset = sum as f32 / pixels;
    let scatter = (squares as f32 - sum as f32 * offset).max(ROUNDING);
    let mean = f32::from(middle) + offset;
    let (noise, shot) = spot.background.variances(geometry);
    let of_flat = freedom + 2.0 * dual_mac::square_root(freedom * MISS) + 2.0 * MISS;
    let height = (mean - spot.background.level.to_f32()).max(0.0);
    let variance = noise + shot * height;
    let width = found.width.to_f32();
    let bend = FLATTER * height / (2.0 * width * width);
    let squared = pixels * pixels;
    let curvature = bend * bend * pixels * (squared - 1.0) * (squared - 4.0) / 180.0;
    let (scattered, bent) = (scatter / variance, curvature / variance);
    let root = dual_mac::square_root(freedom * freedom + 4.0 * bent * scattered);
    let q = (freedom + root) / (2.0 * scattered);
    let evidence = freedom * libm::logf(q) + bent * (1.0 - 1.0 / q) - scattered * (q - 1.0);
    let deviation = spot.background.noise.to_f32();
    let below = BELOW * deviation;
    let is_flat = deviation >= LEAST_NOISE && scatter <= NOISE * noise * of_flat;
    let is_bright = height >= LEAST_HEIGHT * deviation;
    let is_cut = q > 1.0 && evidence >= FALSE_ALARM;
    (is_flat && is_bright && is_cut).then_some(numeric::whole_u16(mean - below).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::fault::Fault;
    use crate::centre::Estimator;
    use crate::measurement::{centre_of_spot, robust_centre};
    use crate::row::LARGEST_COUNT;
    use crate::tests::{found_at, gaussian, normal, row, tcd1304dg};

    const LEVEL: f32 = 300.0;
    const NOISE_OF_ROW: f32 = 3.0;

    /// A gaussian in the middle of 1000 pixels, with shot noise. A pixel holds at most `well` counts of
    /// light.
    fn spot_of(height: f32, width: f32, well: f32, seed: u64) -> [u16; 1000] {
        let shot = f32::from(tcd1304dg().shot_variance_per_count_q16) / 65536.0;
        let mut state = seed;
        core::array::from_fn(|i| {
            let light = height * gaussian(i, 500.3, width);
            let light = light + libm::sqrtf(shot * light) * normal(&mut state);
            (LEVEL + light.min(well) + NOISE_OF_ROW * normal(&mut state) + 0.5) as u16
        })
    }

    fn level_of(light: &[u16], width: f32, saturation: u16) -> Option<u16> {
        let row = row(light).with_saturation(saturation);
        let (spot, _) = crate::spot::find(&row).expect("a spot");
        find(&row, &spot, &found_at(500.3, width), &tcd1304dg())
    }

    /// Tops of 1.5 times the well, at three levels and three widths, and the same spots without a well. The
    /// count that is found is below nearly all pixels of the top, by four standard deviations of 3.01
    /// (rounding included), with 0.5 for the mean's own error and for rounding down.
    #[test]
    fn only_tops_that_are_cut_are_flat() {
        let (mut flat, mut rows) = (0, 0);
        for (well, width) in [1000.0, 1700.0, 2300.0]
            .into_iter()
            .flat_map(|well| [5.0, 10.5, 30.0].map(|width| (well, width)))
        {
            for seed in 1..=20 {
                let whole = spot_of(1.5 * well, width, f32::INFINITY, seed);
                assert_eq!(level_of(&whole, width, LARGEST_COUNT), None);
                let cut = spot_of(1.5 * well, width, well, seed);
                // The width that an estimator finds is larger: the half maximum is lower.
                rows += 1;
                if let Some(found) = level_of(&cut, 1.3 * width, LARGEST_COUNT) {
                    flat += 1;
                    let below = LEVEL + well - f32::from(found);
                    assert!((9.5..=16.5).contains(&below), "{well} {width}: {below}");
                }
            }
        }
        println!("{flat} of {rows} flat tops");
        assert!(flat * 20 >= rows * 19);
    }

    #[test]
    fn what_cannot_be_judged_is_not_flat() {
        let cut = spot_of(3000.0, 10.0, 2000.0, 7);
        let width = 12.0;
        assert!(level_of(&cut, width, LARGEST_COUNT).is_some());
        // The row's own saturation is known already.
        assert_eq!(level_of(&cut, width, 2290), None);
        let row = row(&cut);
        let (spot, _) = crate::spot::find(&row).expect("a spot");
        let (noise, nothing) = (spot.background.noise.to_f32(), f32::NAN);
        // Pixels that are not all on the row; no width; steps of the converter that hide the noise; a spot
        // that is dim beside the noise.
        for (centre, width, noise, is_judged) in [
            (500.3, width, noise, true),
            (-5.0, width, noise, false),
            (0.0, width, noise, false),
            (999.0, width, noise, false),
            (1000.0, width, noise, false),
            (20_000.0, width, noise, false),
            (500.3, 0.0, noise, false),
            (500.3, nothing, noise, false),
            (500.3, width, 0.4, false),
            (500.3, width, 126.0, false),
        ] {
            let mut spot = spot;
            spot.background.noise = Counts::from_f32(noise);
            let found = find(&row, &spot, &found_at(centre, width), &tcd1304dg());
            assert_eq!(found.is_some(), is_judged, "{centre} {width} {noise}");
        }
    }

    /// What a saturation does that is known: the fit measures by the flanks, and the others have no centre.
    #[test]
    fn a_flat_top_counts_as_saturated() {
        let cut = spot_of(3000.0, 10.0, 2000.0, 3);
        let (row, geometry) = (row(&cut), tcd1304dg());
        let (spot, mut budget) = crate::spot::find(&row).expect("a spot");
        let is_right =
            |found: &RowCentre| !found.misfit && (found.centre.to_f32() - 500.3).abs() <= 0.2;
        for estimator in Estimator::ALL {
            match centre_of_spot(estimator, &row, &spot, None, &geometry, None, budget) {
                Ok(found) if estimator == Estimator::GaussNewton => {
                    // The light that the well cut off is in the height.
                    let off = found.amplitude.to_f32() - 3000.0;
                    assert!(is_right(&found) && off.abs() < 150.0, "{found:?}");
                }
                // 0.9 widths to either side: 18 pixels.
                Err(Fault::Saturated { pixels }) if estimator != Estimator::GaussNewton => {
                    assert!((16..=20).contains(&pixels));
                }
                found => panic!("{}: {found:?}", estimator.name()),
            }
        }
        let repaired = robust_centre(&row, &spot, None, &geometry, None, &mut budget);
        let found = repaired.expect("a centre");
        assert!(is_right(&found), "{found:?}");
    }
}
