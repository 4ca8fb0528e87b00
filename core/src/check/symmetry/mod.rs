//! Compares a row with its own mirror image about the spot's centre.
//!
//! A sample is a pixel or the sum of a few. The check takes pairs of samples, one as far to the right of the
//! centre as the other to the left, up to [`REACH`] widths. The centre lies up to a quarter of a pixel from
//! the nearest place that mirrors pixels on pixels, so samples are interpolated linearly to equal distances,
//! and corrected for what that does to a gaussian ([`Correction`]).
//!
//! **Odd part**: z = right - left. A symmetric spot has none, whatever its shape. The variance of z is 2
//! noise^2 + g p, with g the shot noise's variance a count and p = right + left the pair's own light. If two
//! pixels have equal noise, p and z are not correlated, so a weight that depends on p adds no bias. With
//! weights w = 1/variance, e = exp(-u^2/2) and u the distance in widths, z is projected on
//!
//! * u e, the *shift*: half of it is how far a weighted fit would move the centre. It may be at most
//!   [`SHIFTED`] times the uncertainty plus [`SHIFTED_PIXELS`].
//! * u, the *tilt*, u^3 e, the *skew*, u^5 e and u^7 e, each less its parts along those before. A component
//!   with the product r and the norm s = sum w f^2 has the variance s, so r^2 / s is a chi-square of one
//!   degree of freedom. The last two have no limit of their own: they count in the spot's shape
//!   ([`crate::centre::spot_shape`]).
//!
//! In what remains, no single pair may stand out (w z^2 has the variance 1), and the sum of squares must be
//! one that noise explains: that of n pairs has the variance 2 n + (0.06 n)^2.
//!
//! **Even part**: p is fitted by b + A e (1 + k2 u^2 + k4 u^4), unweighted. Optics make k4 as low as -0.040
//! (sinc^2; Fresnel -0.022); two equal spots 2 widths apart have -0.077. The fit without k4 leaves a rest,
//! whose mean square is compared with that of A e. For optical shapes it is at most 0.015: that is for a
//! Fresnel number of 0.55. A blue laser or a slit of 250 um has less, the nominal slit 0.0031. For a box it
//! is 0.04 and more.
//!
//! The pairs are most of the check's work, and the check is part of each row's. So [`mirror_pairs`] goes over
//! the pixels once, for both parts, and leaves a short list for the products of the [`antisymmetric`] part:
//! the sums of both parts need more registers than the chip has. The norms of the [`symmetric`] part need no
//! loop.

mod antisymmetric;
mod mirror_pairs;
mod symmetric;

use self::mirror_pairs::{Correction, Gaps, Noise, Pairs, Place};
use crate::base::{Pixels, numeric};
use crate::centre::RowCentre;
use crate::centre::gauss_newton::MaskedPixels;
use crate::centre::spot_shape::{COMPONENTS, OwnSpot, SpotShape};
use crate::centre::tables::TILTED;
use crate::row::{Extremes, Geometry, Light, Row};
use crate::spot::Spot;

/// How far the pairs reach from the centre, in widths.
const REACH: f32 = 6.0;
/// Samples in a width. A sample has at least one pixel, so a narrow spot has fewer samples.
const SAMPLES_A_WIDTH: f32 = 6.0;
/// How much the third derivative of real profiles differs from a gaussian's: a standard deviation, as a share
/// of the correction for that derivative. For sinc^2 of a width of 0.8 pixels, the correction is 5 % of the
/// height, and the difference is less than a third of the correction.
const OTHER_PROFILE: f32 = 0.3;
/// The fewest pairs for a check.
const FEWEST_PAIRS: f32 = 3.0;
/// The fewest pairs for a check where samples were masked so that the others fit.
const FEWEST_OF_A_PART: f32 = 5.0;
/// Limits of tilt and skew, in standard deviations. Noise exceeds them in one row of 7000 and in one of 5000.
const TILT: f32 = 3.8;
/// See [`TILT`].
const SKEW: f32 = 3.7;
/// Limit of the worst pair, in standard deviations. Noise exceeds it in one row of 12,000 that have 32 pairs.
const WORST: f32 = 4.7;
/// The sum of squares of n pairs may exceed n by so many standard deviations, and by a constant more, because
/// a chi-square is skewed: (2/3)(3.7^2 - 1), after Cornish and Fisher.
const SCATTER: f32 = 3.7;
/// See [`SCATTER`].
const SCATTER_SKEWED: f32 = 8.5;
/// The square of the relative uncertainty of the noise's variance. That uncertainty is 6 %, because the noise
/// is known to 3 % (see [`crate::spot::find`]).
const NOISE_VARIANCE_UNCERTAINTY_SQUARED: f32 = 0.0036;
/// Limit of the shift: so many times the uncertainty, and [`SHIFTED_PIXELS`] more.
const SHIFTED: f32 = 4.0;
/// Pixels by which profiles other than the gaussian, and a table's rounding, move a centre.
const SHIFTED_PIXELS: f32 = 0.02;
/// The largest leverage of a pair, for a distance of one width between the pairs: the maximum of (u e)^2 over
/// its integral, e^-1 / (sqrt(pi) / 4).
const LEVERAGE_A_PITCH: f32 = 0.83;
/// The lowest k4: between that of sinc^2 (-0.040) and that of two equal spots 1.8 widths apart.
const FLAT: f32 = -0.05;
/// Limit of the shape's misfit, which is the mean square that the fit leaves of the even part, over that of
/// the spot. Fresnel's patterns have 0.003 at the nominal slit's Fresnel number of 0.33, and 0.011 at 0.55 if
/// the width is that of the gaussian that fits best. With the widths and the heights that the estimators find
/// there, they have up to 0.015.
const SHAPE_MISFIT: f32 = 0.018;
/// The same for a spot so narrow that it may be bad pixels: twice that of the nominal slit's pattern.
const SHAPE_MISFIT_OF_NARROW: f32 = 0.006;
/// How many standard deviations k4 and the shape's misfit may be beyond their limits.
const EVEN: f32 = 4.0;
/// The same for a spot so narrow that it may be bad pixels: these are likelier than so much noise.
const EVEN_OF_NARROW: f32 = 2.5;
/// Factor of all other limits for such a spot.
const TRUST_OF_NARROW: f32 = 0.7;
/// The least norm of u^4 e that is left without its parts along the other functions, over its full norm. With
/// less, k4 is only rounding: three or four pairs have too few samples for the four functions of the even
/// part.
const LEAST_NORM: f32 = 1e-5;

/// What the check finds about a centre.
#[derive(Clone, Copy, Default)]
pub(super) struct Verdict {
    /// The light has the shape of a spot, as far as the check can tell.
    pub is_spot: bool,
    /// Noise explains how the row differs from its mirror image, beyond the sensor's own spot.
    pub is_symmetric: bool,
    /// The row does not show the spot's shape, so no repair can help.
    pub is_hopeless: bool,
    /// The spot's shape, with the sensor's own antisymmetric light in it.
    pub shape: SpotShape,
}

impl Verdict {
    /// Whether nothing is wrong with the centre.
    pub const fn is_clean(&self) -> bool {
        self.is_spot && self.is_symmetric
    }
}

/// Tests whether the row is its own mirror image about a centre, and has the shape of a spot there. `None`
/// where the sensor's edge or the masked samples leave too few pairs.
pub(super) fn check(
    row: &Row<'_>,
    spot: &Spot,
    found: &RowCentre,
    geometry: &Geometry,
    own: Option<&OwnSpot>,
    masked: &MaskedPixels,
) -> Option<Verdict> {
    let extremes = extremes_near(row, found);
    // A repair begins only if the first centre has passed these tests.
    let is_first = masked.samples == 0;
    if is_first
        && (extremes.zero && is_cut_at_zero(row.light(), found)
            || is_row_too_short(row.light(), found)
            || is_coarse(row.light(), spot, found))
    {
        return Some(Verdict {
            is_hopeless: true,
            ..Verdict::default()
        });
    }
    let mut symmetry = Symmetry::of(row, spot, found, geometry, masked, extremes.saturated);
    let fewest = if is_first {
        FEWEST_PAIRS
    } else {
        FEWEST_OF_A_PART
    };
    if symmetry.pairs < fewest {
        return None;
    }
    let shape = symmetry.shape();
    if let Some(own) = own {
        symmetry.subtract(own);
    }
    let is_sharp = is_first && is_sharp(row.light(), spot, found, geometry);
    let trust = Trust::of(found, masked);
    Some(Verdict {
        is_spot: !is_sharp && symmetry.is_spot(trust),
        is_symmetric: symmetry.is_symmetric(found, trust),
        is_hopeless: false,
        shape,
    })
}

/// Whether the row ends within three widths on both sides: the spot then has no background beside it.
fn is_row_too_short(light: Light<'_>, found: &RowCentre) -> bool {
    // A row has at most 2^12 pixels.
    let (centre, end) = (found.centre.to_f32(), light.len() as f32 - 1.0);
    let reach = 3.0 * found.width.to_f32();
    centre < reach && end - centre < reach
}

/// Whether the steps of the converter's words are coarser than the noise.
fn is_coarse(light: Light<'_>, spot: &Spot, found: &RowCentre) -> bool {
    let width = found.width.to_f32();
    let (centre, reach) = (found.centre.to_f32(), REACH * width + 4.0);
    let (_, near) = light.split(numeric::whole_usize(centre - reach));
    let end = numeric::whole_usize(2.0 * reach);
    let near = near.slice(..end).unwrap_or(near);
    // What turns words into counts changes no difference.
    let (near, _) = near.words();
    let Some(first) = near.first() else {
        return false;
    };
    let noise = spot.background.noise.to_f32();
    let is_coarse = |changes: u16| {
        let step = f32::from(changes.isolate_lowest_one());
        step * step > 12.0 * noise * noise
    };
    // More changes never make a step coarser: a few pixels of most rows tell that it is fine.
    let mut changes = 0;
    for counts in near.chunks(8) {
        changes = (counts.iter()).fold(changes, |changes, count| changes | (count ^ first));
        if changes != 0 && !is_coarse(changes) {
            return false;
        }
    }
    is_coarse(changes)
}

/// Whether the background falls below the converter's smallest word on one side of the spot: there it is cut
/// off, so its shape is unknown. Zeros on both sides are noise that is cut off, or two dead pixels.
#[cold]
#[inline(never)]
fn is_cut_at_zero(light: Light<'_>, found: &RowCentre) -> bool {
    let reach = numeric::whole_usize(REACH * found.width.to_f32());
    let middle = numeric::whole_usize(found.centre.to_f32()).min(light.len());
    let (left, right) = light.split(middle);
    let (_, left) = left.split(left.len().saturating_sub(reach));
    let right = right.slice(..reach).unwrap_or(right);
    let (left, right) = (left.zeros(), right.zeros());
    left.abs_diff(right) > left.min(right).saturating_add(2)
}

/// Whether any count near a spot is zero or saturated. Takes the pixels as far as the pairs reach, and a few
/// more. A sample has at most a sixth of the width and a pixel, which makes the distances in widths larger by
/// half a hundredth and a third of a pixel. A pair more than [`REACH`] ends a sample further out.
fn extremes_near(row: &Row<'_>, found: &RowCentre) -> Extremes {
    let light = row.light();
    let (centre, width) = (found.centre.to_f32(), found.width.to_f32());
    let reach = (REACH + 0.2) * width + 7.0;
    let start = numeric::whole_usize(centre - reach).min(light.len());
    let end = numeric::whole_usize(centre + reach);
    // Whole eights are quicker.
    let pixels = end.saturating_sub(start).saturating_add(7) & !7;
    let (_, near) = light.split(start);
    let near = near.slice(..pixels).unwrap_or(near);
    near.extremes(row.saturated_from())
}

/// Whether the light changes from one pixel to the next by more than optics can: bad pixels side by side look
/// like a narrow spot.
fn is_sharp(light: Light<'_>, spot: &Spot, found: &RowCentre, geometry: &Geometry) -> bool {
    if found.width.to_f32() > SHARP_WIDTH {
        return false;
    }
    let middle = usize::try_from(found.centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let (_, near) = light.split(middle.saturating_sub(3));
    let near = near.slice(..8).unwrap_or(near);
    let (mut highest, mut rise, mut fall) = (0, 0, 0);
    for (a, b) in near.iter().zip(near.iter().skip(1)) {
        highest = highest.max(a).max(b);
        rise = rise.max(b.saturating_sub(a));
        fall = fall.max(a.saturating_sub(b));
    }
    let (noise, shot) = spot.background.variances(geometry);
    let height = f32::from(highest) - spot.background.level.to_f32();
    let beyond = f32::from(rise) + f32::from(fall) - SHARPEST * height;
    let is_smooth =
        beyond <= 0.0 || beyond * beyond <= SHARP * SHARP * 4.0 * (noise + shot * height);
    !is_smooth
}

/// Only spots this narrow, in pixels, can be bad pixels: three in a row look like one of 0.95.
const SHARP_WIDTH: f32 = 1.5;
/// The largest rise from pixel to pixel plus the largest fall, over the height of the highest pixel. A width
/// of 0.8 with a pixel's edge in its middle has 1.5, sinc^2 has 1.6. The sum of rise and fall has the noise
/// of about four pixels.
const SHARPEST: f32 = 1.6;
/// How many standard deviations of noise that sum may be beyond its limit.
const SHARP: f32 = 2.5;

/// How a row differs from its mirror image.
struct Symmetry {
    pairs: f32,
    /// The components of z, each in standard deviations of its noise: see [`crate::centre::spot_shape`].
    components: [f32; COMPONENTS],
    /// The shift in pixels that makes a component of one standard deviation.
    pixels_a_deviation: f32,
    /// The square of the worst pair's deviation, in variances.
    worst: f32,
    /// The most that the sensor's own spot makes of a pair's deviation, in standard deviations.
    own_of_a_pair: f32,
    /// The sum of squares without the shift.
    squares: f32,
    /// The largest leverage of a pair: how much of a shift's norm is its own.
    leverage: f32,
    /// The width of the symmetric light, in pixels.
    width: f32,
    /// k4 and its standard deviation, if there are enough samples for it.
    flatness: Option<(f32, f32)>,
    /// The mean square that the even fit leaves, over that of the spot, and its standard deviation.
    shape_misfit: f32,
    shape_misfit_deviation: f32,
}

impl Symmetry {
    /// Subtracts the antisymmetric light of the sensor's own spot.
    fn subtract(&mut self, own: &OwnSpot) {
        let (mut before, mut after) = (0.0, 0.0);
        // The shift is no part of the squares.
        for (i, (component, own)) in self.components.iter_mut().zip(own.components).enumerate() {
            let rest = *component - own / self.pixels_a_deviation;
            if i > 0 {
                before += *component * *component;
                after += rest * rest;
            }
            *component = rest;
        }
        self.squares -= before - after;
        // By Cauchy's inequality: no pair has more of a function's norm than `leverage`, nearly.
        let own: f32 = own.components.iter().map(|it| it * it).sum();
        let most = COMPONENTS as f32 * self.leverage * own;
        self.own_of_a_pair = dual_mac::square_root(most) / self.pixels_a_deviation;
    }

    /// Whether noise explains all of the difference. `false` if any of the numbers is not a number.
    fn is_symmetric(&self, found: &RowCentre, trust: Trust) -> bool {
        let Trust { odd: trust, .. } = trust;
        let [shift, tilt, skew, ..] = self.components;
        let shift = shift * self.pixels_a_deviation;
        let uncertainty = found.uncertainty.to_f32();
        let worst = trust * WORST + self.own_of_a_pair;
        shift.abs() <= trust * SHIFTED * uncertainty + SHIFTED_PIXELS
            && tilt.abs() <= trust * TILT
            && skew.abs() <= trust * SKEW
            && self.worst <= worst * worst
            && self.squares <= most_squares(self.pairs - 1.0, trust)
    }

    /// Whether the even part has the shape of a spot. `false` if any of the numbers is not a number.
    fn is_spot(&self, trust: Trust) -> bool {
        let Trust { even, misfit, .. } = trust;
        (self.flatness).is_none_or(|(k4, deviation)| k4 >= FLAT - even * deviation)
            && self.shape_misfit <= misfit + even * self.shape_misfit_deviation
    }

    /// The spot's shape, with the sensor's own antisymmetric light in it.
    ///
    /// The light that no component describes belongs to a few pixels. A pair that stands out by t standard
    /// deviations moves the centre by t times the root of its leverage, w f^2 / sum w f^2, which is at most
    /// that of the pairs at one width.
    fn shape(&self) -> SpotShape {
        let pixels = self.pixels_a_deviation;
        let described: f32 = self.components.iter().skip(1).map(|it| it * it).sum();
        let freedom = self.pairs - COMPONENTS as f32;
        let undescribed = self.squares - described;
        // Most spots need no limit.
        let rest = if undescribed > freedom {
            let excess = undescribed - most_squares(freedom, 1.0);
            pixels * dual_mac::square_root(self.leverage * if excess > 0.0 { excess } else { 0.0 })
        } else {
            0.0
        };
        SpotShape {
            components: self.components.map(|it| Pixels::from_f32(it * pixels)),
            width: Pixels::from_f32(self.width),
            noise: Pixels::from_f32(pixels),
            rest: Pixels::from_f32(rest),
        }
    }

    /// Compares a row, less a tilt, with its mirror image.
    #[inline(never)]
    fn of(
        row: &Row<'_>,
        spot: &Spot,
        found: &RowCentre,
        geometry: &Geometry,
        masked: &MaskedPixels,
        is_saturated: bool,
    ) -> Self {
        let width = found.width.to_f32();
        let pixels = numeric::whole_usize(width / SAMPLES_A_WIDTH).saturating_add(1);
        let block = pixels as f32;
        let mirror = Place::of(found.centre);
        let d = mirror.offset.abs();
        let s = dual_mac::square_root(width * width + block * block / 12.0);
        let per_s = 1.0 / s;
        let pitch = block * per_s;
        let pairs = Pairs {
            light: row.light(),
            mirror,
            pixels,
            u: (mirror.to_right + 0.5 * (block - 1.0)) * per_s,
            pitch,
            level: spot.background.level_bits(),
            gaps: Gaps {
                saturation: is_saturated.then(|| row.saturated_from()),
                masked,
            },
        };
        let unit = pairs.units_a_count();
        let height = found.amplitude.to_f32() * block * unit;
        let correction = Correction::of(mirror.offset, per_s, height);
        let (noise, shot) = spot.background.variances(geometry);
        let (noise, shot) = (2.0 * noise * block * unit * unit, shot * unit);
        let profile_deviation = OTHER_PROFILE * correction.third;
        let with_noise = Noise {
            correction,
            dark: noise + profile_deviation * profile_deviation,
            shot,
        };
        let is_tilted = found.class.set == TILTED.number;
        let (odd, mut even) = pairs.sums(&with_noise, is_tilted);
        let number = even.norms.samples;
        if let Some(middle) = pairs.middle() {
            even.add_middle(middle * unit);
        }
        // Interpolation lowers the variance of white noise. This factor raises it again.
        let white = 1.0 / (1.0 - 2.0 * d * (1.0 - d) / block);
        let shape = even.solve();
        let per_height = 0.5 / height;
        let per_square = per_height * per_height;
        let variance = noise + shot * even.p / even.norms.samples;
        let components = odd.components();
        let [shift, ..] = components;
        Self {
            pairs: number,
            components,
            pixels_a_deviation: s * per_height / dual_mac::square_root(odd.m1),
            worst: odd.worst * white,
            own_of_a_pair: 0.0,
            squares: (odd.squares - shift * shift) * white,
            leverage: LEVERAGE_A_PITCH * pitch,
            width: width * (1.0 + shape.wider),
            flatness: shape.k4.map(|(k4, norm)| {
                // The noise at the top, where most of it comes from.
                let deviation = dual_mac::square_root((noise + 2.0 * shot * height) / norm);
                (k4 * per_height, deviation * per_height)
            }),
            shape_misfit: (shape.rest - (even.norms.samples - 3.0) * variance) * per_square
                / even.norms.m0,
            shape_misfit_deviation: variance * dual_mac::square_root(2.0 * number) * per_square
                / even.norms.m0,
        }
    }
}

/// The most that the sum of squares of so many pairs may be by chance.
fn most_squares(freedom: f32, trust: f32) -> f32 {
    let scatter = dual_mac::square_root(
        2.0 * freedom + NOISE_VARIANCE_UNCERTAINTY_SQUARED * freedom * freedom,
    );
    freedom + trust * (SCATTER * scatter + SCATTER_SKEWED)
}

/// How far the statistics of a spot may be from those of noise.
#[derive(Clone, Copy)]
struct Trust {
    /// Standard deviations of the even statistics beyond their limits.
    even: f32,
    /// Factor of the limits of the odd ones.
    odd: f32,
    /// Limit of the shape's misfit.
    misfit: f32,
}

impl Trust {
    /// A narrow spot without some of its pixels is flagged anyway.
    fn of(found: &RowCentre, masked: &MaskedPixels) -> Self {
        let is_wide = found.width.to_f32() > SHARP_WIDTH || masked.samples != 0;
        if is_wide {
            Self {
                even: EVEN,
                odd: 1.0,
                misfit: SHAPE_MISFIT,
            }
        } else {
            Self {
                even: EVEN_OF_NARROW,
                odd: TRUST_OF_NARROW,
                misfit: SHAPE_MISFIT_OF_NARROW,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{found_at, gaussian, hash, normal, row, spot_at, tcd1304dg};

    /// Compares light with its mirror image about a centre of a width, for a spot of a height on a background
    /// of a level and a noise.
    fn symmetry_of(
        light: &[u16],
        (centre, width, height): (f32, f32, f32),
        background: (f32, f32),
    ) -> (Symmetry, RowCentre) {
        let spot = spot_at(centre as usize, 0, height, background);
        let found = RowCentre {
            uncertainty: Pixels::from_f32(0.005),
            amplitude: spot.height,
            ..found_at(centre, width)
        };
        let nothing = MaskedPixels::default();
        let symmetry = Symmetry::of(&row(light), &spot, &found, &tcd1304dg(), &nothing, true);
        (symmetry, found)
    }

    /// Sigma of samples of a gaussian that pixels integrate.
    fn with_pixel(width: f32) -> f32 {
        libm::sqrtf(width * width + 1.0 / 12.0)
    }

    /// Compares a symmetric spot with its mirror image: the width is in pixels, the noise is a count.
    fn symmetry(width: f32, centre: f32, seed: usize) -> (Symmetry, RowCentre) {
        let light: [u16; 64] = core::array::from_fn(|i| {
            let spot = 200.5 + 2000.0 * gaussian(i, centre, with_pixel(width));
            spot as u16 + (hash(i + 64 * seed) >> 30) as u16
        });
        symmetry_of(&light, (centre, width, 2000.0), (201.5, 1.1))
    }

    fn is_clean(symmetry: &Symmetry, found: &RowCentre) -> bool {
        let trust = Trust::of(found, &MaskedPixels::default());
        symmetry.is_spot(trust) && symmetry.is_symmetric(found, trust)
    }

    /// Compares spots with shot and read noise with their mirror images. The module gives the variance of
    /// each statistic. So the mean square of each component is 1. The squares of n pairs have a
    /// mean of n - 1, because the shift takes one. The mean of 4000 squares is known to 2.2 %; the test
    /// allows five times this.
    #[test]
    fn statistics_of_noise_have_the_variances_that_the_check_assumes() {
        const ROWS: usize = 4000;
        // That of the TCD1304DG, in counts^2 a count.
        let shot = f32::from(tcd1304dg().shot_variance_per_count_q16) / 65536.0;
        let (level, height, read_noise) = (300.0f32, 2000.0f32, 8.0f32);
        // With the rounding of a word.
        let noise = libm::sqrtf(read_noise * read_noise + 1.0 / 12.0);
        let mut state = 1;
        for width in [3.0f32, 4.3, 9.0] {
            let mut sums = [0.0f64; 9];
            for number in 0..ROWS {
                // At all places within a pixel.
                let centre = 63.0 + number as f32 / ROWS as f32;
                let light: [u16; 128] = core::array::from_fn(|i| {
                    let spot = height * gaussian(i, centre, with_pixel(width));
                    let noise = libm::sqrtf(read_noise * read_noise + shot * spot);
                    (level + spot + noise * normal(&mut state) + 0.5) as u16
                });
                let (it, _) = symmetry_of(&light, (centre, width, height), (level, noise));
                let (k4, deviation) = it.flatness.expect("many pairs");
                let flatness = (k4 / deviation).powi(2);
                let misfit = it.shape_misfit / it.shape_misfit_deviation;
                let squares = it.squares / (it.pairs - 1.0);
                let others = [squares, flatness, misfit, misfit * misfit];
                let statistics = it.components.map(|it| it * it).into_iter().chain(others);
                for (sum, statistic) in sums.iter_mut().zip(statistics) {
                    *sum += f64::from(statistic);
                }
            }
            let means = sums.map(|sum| sum / ROWS as f64);
            println!("width {width}: {means:.3?}");
            for mean in &means[..6] {
                assert!((mean - 1.0).abs() < 0.11, "{width}: {means:?}");
            }
            // The check takes the noise at the spot's top for all samples, so k4 is more certain than that.
            assert!((0.35..0.6).contains(&means[6]), "{width}: {means:?}");
            // The fit leaves less than it should where the noise is less than the mean noise: by up to one
            // deviation. The limit is four.
            assert!((-1.0..0.0).contains(&means[7]), "{width}: {means:?}");
            assert!((0.8..2.0).contains(&means[8]), "{width}: {means:?}");
        }
    }

    #[test]
    fn a_row_is_too_short_if_three_widths_fit_on_neither_side() {
        let light = [300; 101];
        for (centre, width, is_too_short) in [
            (50.0, 16.5, false),
            (50.0, 17.0, true),
            (45.0, 17.0, false),
            (55.0, 17.0, false),
            // Exactly three widths on one side.
            (51.0, 17.0, false),
            (49.0, 17.0, false),
            (49.5, 16.75, false),
            (49.5, 17.0, true),
        ] {
            let found = is_row_too_short((&light).into(), &found_at(centre, width));
            assert_eq!(found, is_too_short, "{centre} {width}");
        }
    }

    /// Steps of 8 counts have a noise of 8 / sqrt(12) = 2.31 counts. Only pixels within six widths and four
    /// pixels matter.
    #[test]
    fn steps_are_coarse_if_their_noise_exceeds_the_rows_noise() {
        let mut light: [u16; 101] = core::array::from_fn(|i| 320 + 8 * (i as u16 % 3));
        let is_coarse = |light: &[u16], noise| {
            let spot = spot_at(50, 0, 1000.0, (320.0, noise));
            is_coarse(row(light).light(), &spot, &found_at(50.0, 4.0))
        };
        assert!(is_coarse(&light, 2.2) && !is_coarse(&light, 2.4));
        // 6 * 4 + 4 = 28 pixels: the 29th does not matter, the 27th does.
        light[50 - 29] += 1;
        light[50 + 29] += 1;
        assert!(is_coarse(&light, 2.2));
        for at in [50 - 27, 50 + 27] {
            light[at] += 1;
            assert!(!is_coarse(&light, 2.2), "{at}");
            light[at] -= 1;
        }
    }

    /// The rise to a single pixel and the fall behind it are each as large as its height, together twice the
    /// height: 400 counts beyond the limit. A spot with a sigma of one pixel has 0.94 of its height. A noise
    /// of 100 counts gives the limit SHARP times 200 counts of room. Wider spots are no bad pixels.
    #[test]
    fn a_single_bright_pixel_is_sharper_than_any_spot() {
        let pixel: [u16; 101] = core::array::from_fn(|i| if i == 50 { 1300 } else { 300 });
        let spot = core::array::from_fn(|i| 300 + (1000.0 * gaussian(i, 50.0, 1.0)) as u16);
        for (light, width, noise, is_sharp) in [
            (pixel, 1.0, 2.0, true),
            (pixel, 1.6, 2.0, false),
            (spot, 1.0, 2.0, false),
            (pixel, 1.0, 100.0, false),
        ] {
            let (spot, found) = (
                spot_at(50, 0, 1000.0, (300.0, noise)),
                found_at(50.0, width),
            );
            let found = super::is_sharp((&light).into(), &spot, &found, &tcd1304dg());
            assert_eq!(found, is_sharp, "{width} {noise}");
        }
    }

    /// With three or four pairs the norm of u^4 e is often nothing but rounding, and its root not a number.
    #[test]
    fn flatness_is_a_number_or_is_not_tested() {
        let (mut few, mut without, mut flagged) = (0, 0, 0);
        for seed in 0..200 {
            // So near the row's end that it has few pixels on one side.
            let width = 0.7 + 0.01 * (seed % 60) as f32;
            let (symmetry, found) = symmetry(width, 3.5 + 0.05 * (seed % 33) as f32, seed);
            let is_number = |(k4, deviation): (f32, f32)| k4.is_finite() && deviation > 0.0;
            assert!(symmetry.flatness.is_none_or(is_number), "{width}");
            if symmetry.pairs <= 4.0 {
                few += 1;
                without += usize::from(symmetry.flatness.is_none());
                flagged += usize::from(!is_clean(&symmetry, &found));
            }
        }
        println!("of {few} with three or four pairs {without} have no flatness, {flagged} a flag");
        assert!(without > 0 && flagged <= few / 50);
    }

    #[test]
    fn not_a_number_is_not_clean() {
        let (good, found) = symmetry(4.0, 32.0, 1);
        assert!(is_clean(&good, &found));
        let spoil: [fn(&mut Symmetry); 9] = [
            |it| it.pairs = f32::NAN,
            |it| it.components[0] = f32::NAN,
            |it| it.components[1] = f32::NAN,
            |it| it.components[2] = f32::NAN,
            |it| it.pixels_a_deviation = f32::NAN,
            |it| it.worst = f32::NAN,
            |it| it.squares = f32::NAN,
            |it| it.flatness = Some((f32::NAN, 1.0)),
            |it| it.shape_misfit = f32::NAN,
        ];
        for (i, spoil) in spoil.into_iter().enumerate() {
            let mut spoiled = symmetry(4.0, 32.0, 1).0;
            spoil(&mut spoiled);
            assert!(!is_clean(&spoiled, &found), "{i}");
        }
    }

    /// Compares a spot without noise, lopsided by `skewness`, with its mirror image. A pixel at two widths is
    /// brighter by `flaw` counts.
    fn lopsided(width: f32, skewness: f32, flaw: u16) -> (Symmetry, RowCentre) {
        let (centre, height, level) = (64.0, 3000.0, 200.0);
        let mut light: [u16; 129] = core::array::from_fn(|i| {
            let u = (i as f32 - centre) / with_pixel(width);
            let lopsided = 1.0 + skewness / 6.0 * (u * u * u - 3.0 * u);
            (level + height * libm::expf(-0.5 * u * u) * lopsided + 0.5) as u16
        });
        light[(centre + 2.0 * width) as usize] += flaw;
        let (symmetry, found) = symmetry_of(&light, (centre, width, height), (level, 1.0));
        let uncertainty = Pixels::from_f32(0.25);
        (
            symmetry,
            RowCentre {
                uncertainty,
                ..found
            },
        )
    }

    /// An own spot without deviations.
    fn own_spot(width: f32, components: [f32; COMPONENTS]) -> OwnSpot {
        OwnSpot {
            width,
            width_deviation: 0.0,
            components,
            deviation: 0.0,
        }
    }

    #[test]
    fn the_own_spots_light_leaves_the_components_and_the_squares() {
        let mut symmetry = symmetry(4.0, 32.0, 1).0;
        symmetry.components = [1.0, 2.0, 3.0, 4.0, 5.0];
        (symmetry.pixels_a_deviation, symmetry.leverage) = (0.25, 0.2);
        symmetry.squares = 100.0;
        symmetry.subtract(&own_spot(4.0, [0.0; COMPONENTS]));
        assert_eq!(symmetry.components, [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!((symmetry.squares, symmetry.own_of_a_pair), (100.0, 0.0));
        // 1, 2, 1, 0 and -1 standard deviations. Without the shift, the sum of the components' squares rises
        // from 4 + 9 + 16 + 25 to 0 + 4 + 16 + 36.
        symmetry.subtract(&own_spot(4.0, [0.25, 0.5, 0.25, 0.0, -0.25]));
        assert_eq!(symmetry.components, [0.0, 0.0, 2.0, 4.0, 6.0]);
        assert_eq!(symmetry.squares, 102.0);
        // The root of 5 functions times the leverage times the sum of squares 1 + 4 + 1 + 1.
        assert!((symmetry.own_of_a_pair - libm::sqrtf(5.0 * 0.2 * 7.0)).abs() < 1e-5);
    }

    /// All of this row's difference from its mirror image is that of the own spot. So no pair may differ by
    /// more than `own_of_a_pair`, and nothing else is left.
    #[test]
    fn the_own_spot_explains_a_lopsided_row_and_no_pixel_that_stands_out() {
        for (width, skewness) in [(3.0, 0.1), (3.0, -0.3), (5.5, 0.2), (9.0, 0.1), (9.0, -0.3)] {
            let (mut row, found) = lopsided(width, skewness, 0);
            let trust = Trust::of(&found, &MaskedPixels::default());
            let shape = row.shape();
            let own = own_spot(shape.width.to_f32(), shape.components.map(Pixels::to_f32));
            assert!(!row.is_symmetric(&found, trust), "{width} {skewness}");
            row.subtract(&own);
            assert!(row.is_symmetric(&found, trust), "{width} {skewness}");
            // The components were rounded to 2^-16 px.
            let rounding = 1.0 / 65536.0 / row.pixels_a_deviation;
            assert!(row.components.iter().all(|it| it.abs() <= rounding));
            let worst = libm::sqrtf(row.worst);
            println!("{width} {skewness}: {worst} of {}", row.own_of_a_pair);
            // The limit is a few times the most that the own spot makes of a pair, not without end.
            let limits = worst..5.0 * worst;
            assert!(limits.contains(&row.own_of_a_pair), "{width} {skewness}");

            let mut flawed = lopsided(width, skewness, 900).0;
            flawed.subtract(&own);
            assert!(!flawed.is_symmetric(&found, trust), "{width} {skewness}");
        }
    }
}
