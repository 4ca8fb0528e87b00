//! The centroid of the counts above the black level, eq. (2) of the paper: what most firmware does.
//!
//! The window reaches three widths to either side and moves with the centroid until both rest. Its two end
//! pixels count by the part of them that it covers, so that it moves smoothly and pixels do not show in the
//! centre. The paper's black threshold t is the spot's [`black_level`](crate::spot::Spot::black_level). It is
//! subtracted, and counts below it are negative. The paper takes max(0, y - t) instead. That turns the noise
//! of unlit pixels into light, which pulls the centroid to the middle of the window. It makes the error in
//! white noise 1.5 to 2.7 times the bound, even if the window is not moved after it.
//!
//! The background b of the row may be above t, by ambient light or by a t that is set too low. Then the
//! window holds 2 h (b - t) of light besides the spot's. This light is even about the middle of the window
//! but for the pixels at the window's ends, so it moves the centroid by (b - t) / 8M at most. Width, height,
//! uncertainty and the steps of the window are those of the spot's own light: the height is above the
//! background.
//!
//! Uncertainty: with y' = y - b, M = sum w y' and weights w of the window, the centre c solves sum w (x - c)
//! y' = 0. Moving the window brings light in at one end and out at the other. So that sum falls by kM a pixel
//! and not by M, with k = 1 - 2 * 3 phi(3) / (2 Phi(3) - 1) = 0.9733 for a gaussian. The sum's variance is
//! that of its pixels, sum w^2 (x - c)^2 (noise^2 + g y'): with ends that slope over a pixel, noise^2 (2/3
//! h^3 - h^2/3) for h = 3 sigma, and g M 0.9733 sigma^2 (the second moment of a gaussian cut at three sigma
//! has the same k). So
//!
//! u^2 = (noise^2 (2/3 h^3 - h^2/3) + g k M sigma^2) / (kM)^2,
//!
//! which is 1.6 times the bound in white noise, and 1.01 in shot noise. The window's ends on whole pixels
//! leave an error of up to 0.005 pixel for a width of 0.8, 0.003 for 1.2 and 0.001 for 2. u does not include
//! that error. All of it is integers.

use crate::base::numeric::{self, product, root, saturated};
use crate::base::{Counts, Fault, Pixels};
use crate::centre::{RowCentre, check_saturation, check_uncertainty, half_width, position_on_row};
use crate::row::{Geometry, LARGEST_COUNT, Light, Row, level_bits};
use crate::spot::Spot;

/// Half of the window over sigma.
const HALF_WINDOW: i32 = 3;
/// k above, for three sigma: 0.9733 in Q16.
const WINDOW_FACTOR: i64 = 63_786;
/// Height times sigma over a gaussian's light within three sigma, 1 / (sqrt(2 pi) (2 Phi(3) - 1)): 1 / 2.4999
/// in Q30.
const HEIGHT: i32 = 429_513_910;
/// The window is moved at most this often. Each pass leaves 1 - k of the distance, and noise.
const MAX_PASSES: usize = 6;
/// A window that moves by less than this rests: 2^-8 pixel. The last pass leaves some 3 % of its step.
const REST: u32 = 1 << 8;

/// Finds the centre of a spot that [`crate::spot::find`] found.
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let light = row.light();
    let mut at = position_on_row(light, spot)?;
    let width = half_width::width(light, spot, before)?;
    check_saturation(row, at, width)?;
    let level = level_bits(spot.black_level);
    // At most 510 pixels, because a width is at most 170.
    let half_window = Pixels::from_bits(numeric::mul_i32(HALF_WINDOW, width.to_bits()));
    // The window's light besides the spot's, in the format of `Moments::light`: within 2^46.
    let ambient = numeric::mul_i64(
        i64::from(spot.background.level_bits()) - i64::from(level),
        2 * i64::from(half_window.to_bits()),
    );
    let (mut gathered, mut rests) = (0, false);
    for _ in 0..MAX_PASSES {
        let moments =
            moments(light, level, at, half_window).ok_or(Fault::SpotAtEdge { centre: at })?;
        // Within 2^48, and 2^61 for the moment, because the window's middle is within half a pixel of the
        // origin.
        let light_of_spot = numeric::sub_i64(moments.light, ambient);
        let off_origin = numeric::sub_i32(at.to_bits(), moments.origin.to_bits());
        let moment_of_ambient = numeric::mul_i64(ambient, off_origin.into()) >> Pixels::FRACTION;
        let moment_of_spot = numeric::sub_i64(moments.moment, moment_of_ambient);
        if light_of_spot <= 0 {
            return Err(spot.no_spot());
        }
        let shift = quotient(moment_of_spot, light_of_spot, half_window);
        let next = (moments.origin.to_bits()).saturating_add(shift);
        rests = next.abs_diff(at.to_bits()) <= REST;
        at = Pixels::from_bits(next);
        gathered = light_of_spot;
        if rests {
            break;
        }
    }
    check_saturation(row, at, width)?;
    let uncertainty = uncertainty(spot.background.noise, gathered, width, geometry);
    // Q24 over Q16.
    let height = gathered.checked_div(width.to_bits().into());
    let height = product(saturated(height.unwrap_or_default()), HEIGHT) >> 30;
    let amplitude = Counts::from_bits(saturated(height));
    check_uncertainty(amplitude, uncertainty, width)?;
    if !rests {
        return Err(spot.no_spot());
    }
    Ok(RowCentre {
        centre: at,
        uncertainty,
        amplitude,
        width: half_width::follow(light, spot, at, width),
        ..RowCentre::default()
    })
}

/// A moment over the light, in pixels of Q16, rounded to the nearest step. Limited to half of the window. The
/// light is positive.
fn quotient(moment: i64, light: i64, half_window: Pixels) -> i32 {
    // The quotient has one bit more than the result, for rounding. If the moment cannot move to the left by
    // 17 bits, the light moves to the right: it then is 2^37 or more, or the window moves by all it may.
    let size = moment.unsigned_abs();
    let room = size.leading_zeros().saturating_sub(1).min(17);
    let divisor = light.unsigned_abs() >> 17u32.wrapping_sub(room);
    let twice = size.wrapping_shl(room).checked_div(divisor);
    let most = half_window.to_bits().unsigned_abs().into();
    let shift = twice.map_or(most, |twice| (twice >> 1).wrapping_add(twice & 1).min(most));
    let shift = saturated(shift.cast_signed());
    if moment < 0 {
        shift.wrapping_neg()
    } else {
        shift
    }
}

/// u, of the noise of the pixels and that of the light. The light has Q24.
fn uncertainty(noise: Counts, light: i64, width: Pixels, geometry: &Geometry) -> Pixels {
    // kM, Q24: light is below 2^46.
    let slope = numeric::mul_i64(light >> 16, WINDOW_FACTOR);
    // A width is at most 170 pixels: its square fits Q16.
    let square = saturated(product(width.to_bits(), width.to_bits()) >> 16);
    // 2/3 h^3 - h^2/3 is 3 sigma^2 (6 sigma - 1): Q32, below 2^59. The root has Q16.
    let six = numeric::sub_i32(numeric::mul_i32(6, width.to_bits()), 1 << 16);
    let of_window = root(numeric::mul_i64(3, product(square, six)));
    // Noise is below 2^12 counts. So its product is below 2^50, Q24. Q36 over Q16 is Q20.
    let of_noise = product(noise.to_bits().clamp(0, 1 << 20), of_window);
    let of_noise = numeric::mul_i64(of_noise, 1 << 12);
    let of_noise = saturated(of_noise.checked_div(slope >> 8).unwrap_or(i64::MAX));
    // Below 2^47, Q32. Q44 over Q8 is Q36.
    let per_count = geometry.shot_variance_per_count_q16.into();
    let of_light = numeric::mul_i64(product(square, per_count), 1 << 12);
    let of_light = of_light.checked_div(slope >> 16).unwrap_or(i64::MAX);
    let squares = product(of_noise, of_noise).saturating_add(of_light.saturating_mul(1 << 4));
    // The root has Q20. It is rounded to Q16.
    Pixels::from_bits(root(squares).saturating_add(1 << 3) >> 4)
}

/// The sums of eq. (2) over a window.
struct Moments {
    /// The sum of the counts above the level, Q24 (see [`LIGHT_FRACTION`]).
    light: i64,
    /// The sum of those counts times their distance from `origin` in pixels, in the same format.
    moment: i64,
    /// The pixel nearest to the window's middle.
    origin: Pixels,
}

/// Bits after the binary point of [`Moments`]: 8 of a count, 16 of a weight.
const LIGHT_FRACTION: u32 = Counts::FRACTION + Pixels::FRACTION;

/// Sums the pixels within `half_window` of a place. A pixel at distance d has the weight half_window + 1/2 -
/// d, but at least 0 and at most 1. `None` where one of those pixels is not on the row.
fn moments(light: Light<'_>, level: i32, at: Pixels, half_window: Pixels) -> Option<Moments> {
    const HALF: i32 = 1 << (Pixels::FRACTION - 1);
    const ONE: i32 = 1 << Pixels::FRACTION;
    let (at, half_window) = (at.to_bits(), half_window.to_bits());
    // From here to there all pixels count in full.
    let from = at.checked_sub(half_window)?.checked_add(HALF)?;
    let to = at.checked_add(half_window)?.checked_sub(HALF)?;
    let first = from.checked_add(ONE - 1)? >> Pixels::FRACTION;
    let last = to >> Pixels::FRACTION;
    let left_weight = (first * ONE).checked_sub(from)?;
    let right_weight = to.checked_sub(last * ONE)?;
    let left_end = usize::try_from(first.checked_sub(1)?).ok()?;
    let right_end = usize::try_from(last.checked_add(1)?).ok()?;
    let pixels = light.slice(left_end.checked_add(1)?..right_end)?;
    let (left, right) = (light.get(left_end)?, light.get(right_end)?);
    // At most MOST_PIXELS, for which the sums are proven.
    let (mut sum, mut sum_of_sums) = (0u32, 0u32);
    for count in pixels.iter() {
        sum = numeric::add_u32(sum, u32::from(count));
        sum_of_sums = numeric::add_u32(sum_of_sums, sum);
    }
    let (n, level) = (numeric::to_u32(pixels.len()), i64::from(level));
    let n_sums = numeric::mul_i64(i64::from(n), i64::from(n) + 1) / 2;
    let n = i64::from(n);
    // The sum of sums takes the first pixel n times and the last once. A level is below 2^20: within 2^31 and
    // 2^40.
    let light = numeric::sub_i64(i64::from(sum) * COUNT, n * level);
    let level_of_sums = numeric::mul_i64(n_sums, level);
    let light_of_sums = numeric::sub_i64(i64::from(sum_of_sums) * COUNT, level_of_sums);
    let origin = at.checked_add(HALF)? >> Pixels::FRACTION;
    let distance_past_last = i64::from(first) + n - i64::from(origin);
    // Within 2^10 pixels of the origin: within 2^41.
    let moment = numeric::sub_i64(numeric::mul_i64(distance_past_last, light), light_of_sums);
    // Q24.8 below 2^20, times weights of at most 2^16: within 2^36, and 2^46 at the window's ends.
    let end = |count: u16, weight: i32| {
        numeric::mul_i64(i64::from(count) * COUNT - level, i64::from(weight))
    };
    let (left, right) = (end(left, left_weight), end(right, right_weight));
    let ends = numeric::add_i64(
        numeric::mul_i64(left, i64::from(first - 1 - origin)),
        numeric::mul_i64(right, i64::from(last + 1 - origin)),
    );
    // So these are within 2^48 and 2^58.
    let whole = i64::from(ONE);
    Some(Moments {
        light: numeric::add_i64(
            numeric::mul_i64(light, whole),
            numeric::add_i64(left, right),
        ),
        moment: numeric::add_i64(numeric::mul_i64(moment, whole), ends),
        origin: Pixels::from_bits(origin * ONE),
    })
}

/// A count in Q24.8.
const COUNT: i64 = 1 << Counts::FRACTION;

/// The most pixels in a window: three widths to either side, the widest being 170, and what rounding adds.
const MOST_PIXELS: u64 = 2
    * HALF_WINDOW as u64
    * (half_width::WIDTHS.end().to_bits().cast_unsigned() as u64 >> Pixels::FRACTION)
    + 2;

// The running sum of counts, summed up once more, fits 32 bits.
const _: () =
    assert!(LARGEST_COUNT as u64 * MOST_PIXELS * (MOST_PIXELS + 1) / 2 <= u32::MAX as u64);
// Light and moment fit 63 bits, the moment's factor being a distance from the window's middle.
const _: () =
    assert!((LARGEST_COUNT as u64 * MOST_PIXELS * MOST_PIXELS) << LIGHT_FRACTION < 1 << 62);

#[cfg(test)]
mod tests {
    use super::*;

    fn moments_of(light: &[u16], level: i32, at: f32, half_window: f32) -> Option<Moments> {
        let [at, half_window] = [at, half_window].map(Pixels::from_f32);
        moments(light.into(), level, at, half_window)
    }

    /// The sums as eq. (2) defines them, in f64.
    #[test]
    fn moments_are_those_of_the_window() {
        let light: [u16; 400] = core::array::from_fn(|i| (crate::tests::hash(i) >> 20) as u16);
        let level = 1234.5f64;
        for (at, half_window) in [(200.0, 30.0), (200.3, 30.7), (57.77, 1.5), (199.51, 190.2)] {
            let found = moments_of(&light, (level * 256.0) as i32, at, half_window);
            let found = found.expect("on the row");
            let [at, half_window] = [at, half_window].map(|it| Pixels::from_f32(it).to_f64());
            let (mut gathered, mut moment) = (0.0, 0.0);
            for (i, &count) in light.iter().enumerate() {
                let distance = (i as f64 - at).abs();
                let weight = (half_window + 0.5 - distance).clamp(0.0, 1.0);
                gathered += weight * (f64::from(count) - level);
                moment += weight * (f64::from(count) - level) * (i as f64 - at.round());
            }
            let scale = f64::from(1 << LIGHT_FRACTION);
            assert_eq!(found.light as f64 / scale, gathered, "{at} {half_window}");
            assert_eq!(found.moment as f64 / scale, moment, "{at} {half_window}");
            assert_eq!(found.origin.to_f64(), at.round());
        }
    }

    #[test]
    fn the_largest_window_does_not_overflow() {
        for level in [0, 4095 << 8] {
            let found = moments_of(&[4095; 1100], level, 550.0, 510.0);
            assert_eq!(found.expect("on the row").moment, 0);
        }
    }

    /// Against f64, from the narrowest to the widest spot, from one count of light to the largest window full
    /// of it.
    #[test]
    fn quotient_and_uncertainty_are_those_of_their_definitions() {
        let (mut worst, mut worst_u) = (0.0f64, 0.0f64);
        for (width, light_log2, noise, shot) in (0..4000u64).map(|i| {
            let number = u64::from(crate::tests::hash(i as usize));
            let width = [0.5, 170.0, 0.5 + (number % 1690) as f64 / 10.0][i as usize % 3];
            let noise = [0, 4095 << 8, 20 + (number >> 12) as i32 % 5000][i as usize / 3 % 3];
            (
                width,
                24.0 + (number % 221) as f64 / 10.0,
                noise,
                (number % 65536) as u16,
            )
        }) {
            let light = libm::exp2(light_log2) as i64;
            let width = Pixels::from_f32(width as f32);
            let half_window = Pixels::from_bits(3 * width.to_bits());
            for part in [-2.0, -0.9, -1e-4, 0.0, 1e-5, 0.3, 1.0] {
                let moment = (light as f64 * part * half_window.to_f64()) as i64;
                let exact = (moment as f64 / light as f64)
                    .clamp(-half_window.to_f64(), half_window.to_f64());
                let found = f64::from(quotient(moment, light, half_window));
                worst = worst.max((found - exact * 65536.0).abs());
            }
            let geometry = crate::tests::tcd1304dg();
            let geometry = Geometry {
                shot_variance_per_count_q16: shot,
                ..geometry
            };
            let found = uncertainty(Counts::from_bits(noise), light, width, &geometry).to_f64();
            let slope = 63_786.0 / 65536.0 * libm::ldexp(light as f64, -24);
            let (s, noise) = (width.to_f64(), f64::from(noise) / 256.0);
            let of_noise = noise * noise * 3.0 * s * s * (6.0 * s - 1.0) / (slope * slope);
            let exact = (of_noise + f64::from(shot) / 65536.0 * s * s / slope).sqrt();
            if exact < 2000.0 {
                // The light loses 16 bits: of one count, Q24, eight are left.
                let allowed = libm::ldexp(1.0, -16) + exact * (2e-5 + 1.0 / (light >> 16) as f64);
                worst_u = worst_u.max((found - exact).abs() / allowed);
            }
        }
        println!("{worst:.3} steps, {worst_u:.2} of what is allowed");
        assert!(worst <= 0.51 && worst_u < 1.0);
        // A moment at its limit, 2^61.
        let window = Pixels::from_int(510);
        assert_eq!(quotient(i64::MIN / 4, 1, window), -window.to_bits());
    }

    #[test]
    fn a_window_over_the_edge_has_no_moments() {
        for (at, half_window, is_whole) in [
            (50.0, 49.0, true),
            (50.0, 50.0, false),
            (49.0, 49.0, true),
            (10.0, 11.0, false),
            (f32::MAX, 510.0, false),
            (f32::MIN, 510.0, false),
        ] {
            let found = moments_of(&[100; 100], 0, at, half_window);
            assert_eq!(found.is_some(), is_whole, "{at} {half_window}");
        }
    }
}
