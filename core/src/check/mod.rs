//! Judges a centre by its row's mirror symmetry.
//!
//! A centre can be wrong in ways that its uncertainty does not cover, because the uncertainty is only that of
//! noise. The causes are a second spot, a hot pixel, a background that rises, or light that blooms to one
//! side. A sharp test against the spot's shape would see them, but would also reject each profile that is no
//! gaussian: an exact Fresnel pattern lies 7 % from it.
//!
//! All estimators are unbiased for a symmetric spot, whatever its shape. Only the *antisymmetric* part of a
//! row moves a centre, and a good spot has no antisymmetric part. So the check compares the row with its
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
//! **Comparison.** A sample is a pixel or the sum of a few. The check takes pairs of samples, one as far to
//! the right of the centre as the other to the left, up to six widths (`pairs`). The centre lies up to a
//! quarter of a pixel from the nearest place that mirrors pixels on pixels, so samples are interpolated
//! linearly to equal distances, and corrected for what that does to a gaussian.
//!
//! **Odd part**: z = right - left. A symmetric spot has none, whatever its shape. The variance of z is 2
//! noise^2 + g p, with g the shot noise's variance a count and p = right + left the pair's own light. If two
//! pixels have equal noise, p and z are not correlated, so a weight that depends on p adds no bias. With
//! weights w = 1/variance, e = exp(-u^2/2) and u the distance in widths, z is projected on
//!
//! * u e, the *shift*: half of it is how far a weighted fit would move the centre. It may be at most
//!   `SHIFTED` times the uncertainty plus `SHIFTED_PIXELS`.
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
//! If a row fails the check, the measurement tries [`repair`]. If that finds no better centre, the spot's
//! shape makes u larger ([`crate::centre::spot_shape`]), and the row is flagged only where u cannot express
//! the error.

pub mod own_spot;
mod pairs;
pub mod repair;

use core::ops::Range;

use self::pairs::{Correction, Gaps, Noise, Pairs, Place};
use crate::base::numeric::product;
use crate::base::{Counts, Pixels, WorkBudget, numeric};
use crate::centre::gauss_newton::MaskedPixels;
use crate::centre::spot_shape::{COMPONENTS, OwnSpot, SpotShape};
use crate::centre::tables::TILTED;
use crate::centre::{Estimate, Estimator, RowCentre};
use crate::check::own_spot::Profile;
use crate::row::{Extremes, Geometry, Light, Row};
use crate::spot::Spot;

/// A narrower spot, in pixels, is flagged. Two or three bad pixels side by side look like a spot of 1.1. With
/// this limit and the other tests, all of 2000 such centres had a flag. With 1.15, four had none.
const NARROWEST_SURE: Pixels = Pixels::from_positive_f32(1.2);
/// If the sensor's edge cuts a narrower spot, in pixels, nothing tells it from bad pixels.
const NARROWEST_CUT: Pixels = Pixels::from_positive_f32(1.25);
/// If the shape's part of u exceeds this many widths, the row is flagged: u then says no more than that the
/// centre is somewhere in the spot, which has 1 % of its height left at three widths.
const LARGEST_SHAPE: i32 = 3;
/// A narrower spot, in pixels, is flagged if it is not symmetric: a single bad pixel looks like a shape
/// there.
const NARROWEST_WITH_SHAPE: Pixels = repair::NARROWEST_SURE_REFIT;

/// How far the pairs reach from the centre, in widths.
const REACH: i32 = 6;
/// Samples in a width. A sample has at least one pixel, so a narrow spot has fewer samples.
const SAMPLES_A_WIDTH: i32 = 6;
/// How much the third derivative of real profiles differs from a gaussian's: a standard deviation, as a share
/// of the correction for that derivative, Q8. For sinc^2 of a width of 0.8 pixels, the correction is 5 % of
/// the height, and the difference is less than a third of the correction.
const OTHER_PROFILE: i32 = 77;
const FEWEST_PAIRS: i32 = 3;
/// The fewest pairs for a check where samples were masked so that the others fit.
const FEWEST_OF_A_PART: i32 = 5;
/// Limits of tilt and skew, in standard deviations, Q12: 3.8 and 3.7. Noise exceeds them in one row of 7000
/// and in one of 5000.
const TILT: i32 = 15_565;
const SKEW: i32 = 15_155;
/// Limit of the worst pair, in standard deviations, Q7: 4.7. Noise exceeds it in one row of 12,000 that have
/// 32 pairs.
const WORST: i32 = 602;
/// The sum of squares of n pairs may exceed n by so many standard deviations, and by a constant more, because
/// a chi-square is skewed: (2/3)(3.7^2 - 1), after Cornish and Fisher. Q8.
const SCATTER: i32 = 947;
const SCATTER_SKEWED: i32 = 2176;
/// Limit of the shift: so many times the uncertainty, and [`SHIFTED_PIXELS`] more.
const SHIFTED: i32 = 4;
/// Pixels by which profiles other than the gaussian, and a table's rounding, move a centre: 0.02, Q24.
const SHIFTED_PIXELS: i64 = 335_544;
/// The largest leverage of a pair, for a distance of one width between the pairs: the maximum of (u e)^2 over
/// its integral, e^-1 / (sqrt(pi) / 4), Q8.
const LEVERAGE_A_PITCH: i32 = 212;
/// The lowest k4, times -2^16: 0.05, between that of sinc^2 (-0.040) and that of two equal spots 1.8 widths
/// apart.
const FLAT: i32 = 3277;
/// Limit of the shape's misfit, Q16, which is the mean square that the fit leaves of the even part, over that
/// of the spot: 0.018. Fresnel's patterns have 0.003 at the nominal slit's Fresnel number of 0.33, and 0.011
/// at 0.55 if the width is that of the gaussian that fits best. With the widths and the heights that the
/// estimators find there, they have up to 0.015.
const SHAPE_MISFIT: i32 = 1180;
/// The same for a spot so narrow that it may be bad pixels, 0.006: twice that of the nominal slit's pattern.
const SHAPE_MISFIT_OF_NARROW: i32 = 393;
/// How many standard deviations k4 and the shape's misfit may be beyond their limits, Q4.
const EVEN: i32 = 64;
/// The same for a spot so narrow that it may be bad pixels, 2.5: these are likelier than so much noise.
const EVEN_OF_NARROW: i32 = 40;
/// Factor of all other limits for such a spot, Q8: 0.7.
const TRUST_OF_NARROW: i32 = 179;

/// What the check says of a centre.
#[derive(Clone, Copy, Debug)]
pub struct Verdict {
    /// The spot's shape. The estimate's own one where the check had too few pairs.
    pub shape: SpotShape,
    /// The height of the gaussian that fits the symmetric light best. The estimate's own one where the check
    /// had too few pairs, or the sensor's edge or saturation cuts the spot.
    pub height: Counts,
    /// Nothing is wrong with the centre.
    pub is_clean: bool,
    /// The light is no spot, or the shape's part of u is too large.
    pub misfit: bool,
    /// Something is wrong, and a repair may find a better centre.
    pub may_be_repaired: bool,
}

impl Verdict {
    /// The centre with its height, its shape and its flag. The centroid keeps its height, which is above the
    /// black level.
    #[inline(always)]
    pub fn of(&self, estimator: Estimator, found: &RowCentre) -> RowCentre {
        RowCentre {
            amplitude: match estimator {
                Estimator::Centroid => found.amplitude,
                _ => self.height,
            },
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
            height: found.amplitude,
            is_clean: false,
            misfit: true,
            may_be_repaired: false,
        };
    }
    let verdict = by_symmetry(row, spot, found, geometry, profile);
    if *is_cut {
        return Verdict {
            height: found.amplitude,
            misfit: !verdict.is_clean || !is_certain_cut(row, found),
            may_be_repaired: false,
            ..verdict
        };
    }
    verdict
}

/// Whether a spot is so narrow that it may be a few bad pixels. The width of the gaussian that fits its light
/// best counts: the estimators' width is up to a fifth smaller if the spot is a narrow sinc^2.
#[inline(always)]
pub(crate) fn may_be_bad_pixels(found: &RowCentre) -> bool {
    let fitted = found.shape.width;
    let width = if fitted > Pixels::default() {
        fitted
    } else {
        found.width
    };
    width < NARROWEST_SURE
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
    let Some(verdict) = compare(row, spot, found, geometry, own, &nothing) else {
        let misfit = found.misfit || found.width < NARROWEST_CUT;
        return Verdict {
            shape: found.shape,
            height: found.amplitude,
            is_clean: !misfit,
            misfit,
            may_be_repaired: misfit,
        };
    };
    let shape = verdict.shape;
    let is_sound = verdict.is_spot && !(found.misfit && !is_whole(row, found));
    let is_clean = is_sound && verdict.is_symmetric;
    let is_expressed = verdict.is_symmetric || is_expressed(&shape, found, own);
    let height = verdict.height;
    Verdict {
        shape,
        height: if height.to_bits() > 0 {
            height
        } else {
            found.amplitude
        },
        is_clean,
        misfit: !(is_sound && is_expressed),
        may_be_repaired: !is_clean && !verdict.is_hopeless,
    }
}

/// Whether the shape's part of u is one that says more than that the centre is somewhere in the spot.
#[cold]
#[inline(never)]
fn is_expressed(shape: &SpotShape, found: &RowCentre, own: Option<&OwnSpot>) -> bool {
    let most = found.width.to_bits().saturating_mul(LARGEST_SHAPE);
    found.width > NARROWEST_WITH_SHAPE && shape.uncertainty(own).to_bits() <= most
}

/// Whether the part of a spot that the edge leaves is enough to tell it from a background that falls towards
/// the edge.
fn is_certain_cut(row: &Row<'_>, found: &RowCentre) -> bool {
    let (width, uncertainty) = (found.width.to_bits(), found.uncertainty.to_bits());
    let length = pixels(row.light().len());
    uncertainty.saturating_mul(32) <= width && length >= width.saturating_mul(8)
}

/// Whether all of the spot within five widths is on the row, and no pixel of it saturated.
fn is_whole(row: &Row<'_>, found: &RowCentre) -> bool {
    let (near, fits) = around(row.light(), found, found.width.to_bits().saturating_mul(5));
    fits == [true; 2] && !row.reaches_saturation(near.start..near.end.saturating_add(1))
}

/// The pixels as far from a centre as a reach, Q16.16, and whether the row has them on the left and on the
/// right.
fn around(light: Light<'_>, found: &RowCentre, reach: i32) -> (Range<usize>, [bool; 2]) {
    let centre = found.centre.to_bits();
    let (start, end) = (centre.saturating_sub(reach), centre.saturating_add(reach));
    let whole = |bits: i32| usize::try_from(bits >> Pixels::FRACTION).unwrap_or_default();
    let last = pixels(light.len().saturating_sub(1));
    (whole(start)..whole(end), [start >= 0, end <= last])
}

/// A number of pixels on a row, at most 2^12, Q16.16.
fn pixels(number: usize) -> i32 {
    numeric::to_i32(number).wrapping_mul(1 << Pixels::FRACTION)
}

#[derive(Clone, Copy, Default)]
pub(super) struct Comparison {
    /// The light has the shape of a spot, as far as the check can tell.
    pub is_spot: bool,
    /// Noise explains how the row differs from its mirror image, beyond the sensor's own spot.
    pub is_symmetric: bool,
    /// The row does not show the spot's shape, so no repair can help.
    pub is_hopeless: bool,
    /// The spot's shape, with the sensor's own antisymmetric light in it.
    pub shape: SpotShape,
    /// The height of the symmetric light. Zero if the light does not tell.
    pub height: Counts,
}

impl Comparison {
    /// Whether nothing is wrong with the centre.
    pub const fn is_clean(&self) -> bool {
        self.is_spot && self.is_symmetric
    }
}

/// Tests whether the row is its own mirror image about a centre, and has the shape of a spot there. `None`
/// where the sensor's edge or the masked samples leave too few pairs.
pub(super) fn compare(
    row: &Row<'_>,
    spot: &Spot,
    found: &RowCentre,
    geometry: &Geometry,
    own: Option<&OwnSpot>,
    masked: &MaskedPixels,
) -> Option<Comparison> {
    let extremes = extremes_near(row, found);
    // A repair begins only if the first centre has passed these tests.
    let is_first = masked.samples == 0;
    if is_first
        && (extremes.zero && is_cut_at_zero(row.light(), found)
            || is_row_too_short(row.light(), found)
            || is_coarse(row.light(), spot, found))
    {
        return Some(Comparison {
            is_hopeless: true,
            ..Comparison::default()
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
    Some(Comparison {
        is_spot: !is_sharp && symmetry.is_spot(trust),
        is_symmetric: symmetry.is_symmetric(found, trust),
        is_hopeless: false,
        shape,
        height: symmetry.height,
    })
}

/// Whether the row ends within three widths on both sides: the spot then has no background beside it.
fn is_row_too_short(light: Light<'_>, found: &RowCentre) -> bool {
    let (_, fits) = around(light, found, found.width.to_bits().saturating_mul(3));
    fits == [false; 2]
}

/// Whether the steps of the converter's words are coarser than the noise.
fn is_coarse(light: Light<'_>, spot: &Spot, found: &RowCentre) -> bool {
    let reach = found
        .width
        .to_bits()
        .saturating_mul(REACH)
        .saturating_add(pixels(4));
    let (near, _) = around(light, found, reach);
    let near = light
        .slice(near.start..near.end.min(light.len()))
        .unwrap_or(light);
    // What turns words into counts changes no difference.
    let (near, _) = near.words();
    let Some(first) = near.first() else {
        return false;
    };
    // A step of the root of 12 times the noise, Q8.
    let finest = spot.background.noise.to_bits().saturating_mul(887) >> 8;
    let is_coarse =
        |changes: u16| i32::from(changes.isolate_lowest_one()) * (1 << Counts::FRACTION) > finest;
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
    let (near, _) = around(light, found, found.width.to_bits().saturating_mul(REACH));
    let (middle, _) = around(light, found, 0);
    let (left, right) = light.split(middle.start);
    let (_, left) = left.split(near.start);
    let right = right
        .slice(..near.end.saturating_sub(middle.start))
        .unwrap_or(right);
    let (left, right) = (left.zeros(), right.zeros());
    left.abs_diff(right) > left.min(right).saturating_add(2)
}

/// Whether any count near a spot is zero or saturated. Takes the pixels as far as the pairs reach, and a few
/// more. A sample has at most a sixth of the width and a pixel, which makes the distances in widths larger by
/// half a hundredth and a third of a pixel. A pair more than [`REACH`] ends a sample further out.
fn extremes_near(row: &Row<'_>, found: &RowCentre) -> Extremes {
    let light = row.light();
    // Widths of 6.25.
    let reach = (found.width.to_bits() / 4).saturating_mul(4 * REACH + 1);
    let (near, _) = around(light, found, reach.saturating_add(pixels(7)));
    // Whole eights are quicker.
    let number = near.len().saturating_add(7) & !7;
    let (_, near) = light.split(near.start.min(light.len()));
    let near = near.slice(..number).unwrap_or(near);
    near.extremes(row.saturated_from())
}

/// Whether the light changes from one pixel to the next by more than optics can: bad pixels side by side look
/// like a narrow spot.
fn is_sharp(light: Light<'_>, spot: &Spot, found: &RowCentre, geometry: &Geometry) -> bool {
    if found.width > SHARP_WIDTH {
        return false;
    }
    let (middle, _) = around(light, found, 0);
    let (_, near) = light.split(middle.start.saturating_sub(3));
    let near = near.slice(..8).unwrap_or(near);
    let (mut highest, mut rise, mut fall) = (0, 0, 0);
    for (a, b) in near.iter().zip(near.iter().skip(1)) {
        highest = highest.max(a).max(b);
        rise = rise.max(b.saturating_sub(a));
        fall = fall.max(a.saturating_sub(b));
    }
    let counts = |it: u16| i64::from(it) * (1 << Counts::FRACTION);
    let height = counts(highest).saturating_sub(spot.background.level_bits().into());
    // Five times what is beyond the limit, Q8.
    let change = counts(rise).saturating_add(counts(fall));
    let beyond = change
        .saturating_mul(5)
        .saturating_sub(height.saturating_mul(SHARPEST));
    // That of four pixels, Q16.
    let variance = i64::from(spot.background.noise.to_bits())
        .saturating_pow(2)
        .saturating_add(
            height.saturating_mul(geometry.shot_variance_per_count_q16.into()) >> Counts::FRACTION,
        );
    beyond > 0 && beyond.saturating_pow(2) > variance.saturating_mul(4 * SHARP_SQUARED)
}

/// Only spots this narrow, in pixels, can be bad pixels: three in a row look like one of 0.95.
const SHARP_WIDTH: Pixels = Pixels::from_positive_f32(1.5);
/// Five times the largest rise from pixel to pixel plus the largest fall, over the height of the highest
/// pixel. A width of 0.8 with a pixel's edge in its middle has 5 * 1.5, sinc^2 has 5 * 1.6. The sum of rise
/// and fall has the noise of about four pixels.
const SHARPEST: i64 = 8;
/// How many standard deviations of noise that sum may be beyond its limit: the square of five times 2.5.
const SHARP_SQUARED: i64 = 156;

/// How a row differs from its mirror image.
struct Symmetry {
    pairs: i32,
    /// The components of z, in standard deviations of its noise, Q12: see [`crate::centre::spot_shape`].
    components: [i32; COMPONENTS],
    /// The standard deviations that a shift of a pixel makes, Q14, and one over it, Q24, at most 128 pixels.
    /// Zero and the largest if no pair tells of a shift.
    deviations_a_pixel: i32,
    pixels_a_deviation: i32,
    /// The square of the worst pair's deviation, in variances, Q14.
    worst: i64,
    /// The most that the sensor's own spot makes of a pair's deviation, in standard deviations, Q7.
    own_of_a_pair: i32,
    /// The sum of squares without the shift, in variances, Q8.
    squares: i64,
    /// The largest leverage of a pair, Q16: how much of a shift's norm is its own.
    leverage: i32,
    /// The width and the height of the symmetric light.
    width: Pixels,
    height: Counts,
    even: Even,
}

/// The tests of the even part, in the units of [`pairs::Shape`]. Variances have Q16.
#[derive(Clone, Copy, Debug)]
struct Even {
    /// The part along u^4 e, what it is for a k4 of one, both Q15, and its variance, if there are enough
    /// samples for it.
    fourth: Option<(i32, i64, i64)>,
    /// The sum of squares that the fit leaves, without what noise leaves, that of the spot, and the variance
    /// of a pair. Q16.
    rest: i64,
    spot: i64,
    variance: i64,
}

impl Even {
    /// `unlit` is the variance of an unlit pair, and `height` is in 4 units of z.
    fn of(shape: &pairs::Shape, height: i32, unlit: i64, shot: u16, fraction: u32) -> Self {
        let pairs::Shape { unit, samples, .. } = *shape;
        let sum = numeric::add_i32;
        // Variances, Q16, and the shot noise's for each Q4 of p, Q32. The limits leave room for all products.
        let unlit = numeric::shifted(unlit, sum(sum(unit, unit), 16)).min(1 << 46);
        let shot = numeric::shifted(shot.into(), sum(sum(unit, fraction.cast_signed()), 12));
        let shot = shot.min(1 << 38);
        let variance = |p: i32| numeric::add_i64(unlit, numeric::mul_i64(p.into(), shot) >> 16);
        // Q4. The root of the sum of the light's squares is 2^18 to 2^19 (`pairs::Even::solve`), and the
        // height that a fit of the flanks claims up to 32 times as much.
        let in_units =
            |p: i32, more: i32| numeric::shifted_32(p, sum(unit, more)).clamp(-(1 << 24), 1 << 24);
        let (peak, mean) = (in_units(height, 4 + 3), in_units(shape.mean, 4));
        let of_noise = variance(mean);
        let squares = numeric::i64_to_i32(product(peak, peak) >> 18);
        Self {
            fourth: (shape.fourth)
                .map(|(norm, along)| (along, product(peak, norm) >> 4, variance(peak))),
            rest: numeric::sub_i64(
                product(shape.rest, 1 << 16),
                numeric::mul_i64(sum(samples, -3).into(), of_noise),
            ),
            spot: numeric::mul_i64(product(squares, shape.squares_of_e), 1 << 2),
            variance: of_noise,
        }
    }
}

impl Symmetry {
    /// Subtracts the antisymmetric light of the sensor's own spot.
    fn subtract(&mut self, own: &OwnSpot) {
        let (mut change, mut sum) = (0i64, 0i64);
        // The shift is no part of the squares.
        for (i, (component, own)) in self.components.iter_mut().zip(own.components).enumerate() {
            // From Q16 and Q14.
            let own = product(own.to_bits(), self.deviations_a_pixel) >> 18;
            let own = numeric::saturated(own);
            let rest = component.saturating_sub(own);
            if i > 0 {
                let squared = |it: i32| product(it, it) >> 16;
                change = change
                    .saturating_add(squared(rest))
                    .saturating_sub(squared(*component));
            }
            let limited = own.clamp(-(1 << 24), 1 << 24);
            sum = numeric::add_i64(sum, product(limited, limited) >> 8);
            *component = rest;
        }
        self.squares = self.squares.saturating_add(change);
        // By Cauchy's inequality: no pair has more of a function's norm than `leverage`, nearly. Q16 each.
        let leverages = numeric::mul_i32(self.leverage, numeric::to_i32(COMPONENTS));
        let most = sum.saturating_mul(leverages.into());
        self.own_of_a_pair = numeric::root(most) >> 9;
    }

    /// Whether noise explains all of the difference.
    fn is_symmetric(&self, found: &RowCentre, trust: Trust) -> bool {
        let Trust { odd: trust, .. } = trust;
        let [shift, tilt, skew, ..] = self.components.map(i32::saturating_abs);
        let shift = product(shift, self.pixels_a_deviation) >> 12;
        let worst = ((trust * WORST) >> 8).saturating_add(self.own_of_a_pair);
        self.deviations_a_pixel > 0
            && shift <= product(trust * SHIFTED, found.uncertainty.to_bits()) + SHIFTED_PIXELS
            && tilt <= (trust * TILT) >> 8
            && skew <= (trust * SKEW) >> 8
            && self.worst <= product(worst, worst)
            && self.squares <= most_squares(self.pairs - 1, trust).into()
    }

    /// Whether the even part has the shape of a spot.
    fn is_spot(&self, trust: Trust) -> bool {
        let (even, misfit) = (i64::from(trust.even), i64::from(trust.misfit));
        let Even {
            fourth,
            rest,
            spot,
            variance,
        } = self.even;
        let is_flat = |(along, one, variance): (i32, i64, i64)| {
            let limit = numeric::mul_i64(one, FLAT.into()) >> 16;
            let below = numeric::saturated(numeric::add_i64(limit, along.into()));
            // From Q30 and Q16 to Q16.
            let noise = numeric::mul_i64(even * even, variance) >> 8;
            below < 0 && product(below, below) >> 14 > noise
        };
        let scatter = (even * i64::from(root_of_double(self.pairs))) >> 4;
        let by_noise = numeric::mul_i64(scatter, variance) >> 8;
        self.width > Pixels::default()
            && self.deviations_a_pixel > 0
            && !fourth.is_some_and(is_flat)
            && rest <= numeric::add_i64(misfit * (spot >> 16), by_noise)
    }

    /// The spot's shape, with the sensor's own antisymmetric light in it.
    ///
    /// The light that no component describes belongs to a few pixels. A pair that stands out by t standard
    /// deviations moves the centre by t times the root of its leverage, w f^2 / sum w f^2, which is at most
    /// that of the pairs at one width.
    fn shape(&self) -> SpotShape {
        // From a number with 12 bits after the point.
        let in_pixels = |it: i32| {
            let pixels = product(it, self.pixels_a_deviation) >> 20;
            Pixels::from_bits(numeric::saturated(pixels))
        };
        let squares = self.components.map(|it| product(it, it) >> 16);
        let described: i64 = squares.into_iter().skip(1).sum();
        let most = most_squares(self.pairs - numeric::to_i32(COMPONENTS), 1 << 8);
        let excess = numeric::sub_i64(self.squares, described + i64::from(most));
        let rest = if excess > 0 {
            numeric::root(product(self.leverage, numeric::saturated(excess)))
        } else {
            0
        };
        SpotShape {
            components: self.components.map(in_pixels),
            width: self.width,
            noise: in_pixels(1 << 12),
            rest: in_pixels(rest),
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
        let width = found.width.to_bits().max(0);
        // At most 2^15 / 6.
        let block = ((width / SAMPLES_A_WIDTH) >> Pixels::FRACTION) + 1;
        // s^2 = width^2 + block^2 / 12, in samples: Q24, below 37.
        let width_in_samples = numeric::mul_i32(width / block, 1 << 12);
        let s_squared =
            dual_mac::add_upper_product((1 << 24) / 12, width_in_samples, width_in_samples);
        // 1 / s, in samples: below 3.5.
        let (root, halvings) = numeric::inverse_root(s_squared.cast_unsigned());
        let pitch = root >> 7u32.saturating_sub(halvings);
        let mirror = Place::of(found.centre);
        let pairs = Pairs {
            light: row.light(),
            mirror,
            pixels: usize::try_from(block).unwrap_or_default(),
            pitch,
            per_pitch: numeric::mul_i32(
                dual_mac::upper_product(s_squared, numeric::mul_i32(pitch, 1 << 3)),
                1 << 3,
            ),
            level: spot.background.level_bits(),
            gaps: Gaps {
                saturation: is_saturated.then(|| row.saturated_from()),
                masked,
            },
        };
        let fraction = pairs.fraction();
        // In units of z, with so many bits fewer: below 2^30 for 2^15 counts and two of a block's pixels.
        let in_units = |counts: i32, fewer: i32| {
            let by = fraction.cast_signed() - Counts::FRACTION.cast_signed() - fewer;
            numeric::shifted_32(counts, by)
        };
        let height = found.amplitude.to_bits().clamp(0, 1 << 23);
        let height = numeric::mul_i32(in_units(height, 2), block);
        let per_s = pitch / block;
        let correction = (block == 1).then(|| {
            Correction::of(
                mirror.offset,
                per_s,
                numeric::mul_i32(height.min(1 << 28), 4),
            )
        });
        // Quantisation alone has 0.29 counts, and 2^12 are more than a row has.
        let noise = spot.background.noise.to_bits().clamp(74, 1 << 20);
        let noise = in_units(noise, 0);
        // Below 2^59.
        let unlit = numeric::mul_i64(product(noise, noise), (2 * block).into());
        let third = correction.map_or(0, |correction| correction.third);
        let of_profile = numeric::i64_to_i32(product(OTHER_PROFILE, third) >> 8);
        let dark = numeric::add_i64(unlit, product(of_profile, of_profile)).unsigned_abs();
        let noise = Noise {
            correction,
            per_root: numeric::inverse_root_of_64(dark),
            shot: geometry.shot_variance_per_count_q16,
        };
        let is_tilted = found.class.set == TILTED.number;
        let (odd, mut even) = pairs.sums(&noise, is_tilted);
        let number = even.number();
        if let Some(middle) = pairs.middle() {
            even.add_middle(middle);
        }
        // Interpolation lowers the variance of white noise by 2 d (1 - d) / block. This factor, Q16, raises
        // it again.
        let d = mirror.offset.to_bits().unsigned_abs().min(1 << 14);
        let lowered = ((d * ((1 << 16) - d)) >> 15) / block.cast_unsigned();
        let white = (u32::MAX / (1u32 << 16).saturating_sub(lowered).max(1)).cast_signed();
        let shape = even.solve();
        let (components, squares) = odd.components(white);
        let worst = odd.worst();
        // 2 height norm per_s / deviation, Q14.
        let (norm, bits) = odd.norm_of_shift();
        let (root, halvings) = noise.per_root;
        let shifts = product(
            dual_mac::upper_product(norm, numeric::mul_i32(per_s, 1 << 3)),
            dual_mac::upper_product(height, root),
        );
        let by = numeric::sub_i32(halvings.cast_signed(), numeric::add_i32(bits, 9));
        let deviations_a_pixel = numeric::saturated(numeric::shifted(shifts, by));
        let pixels_a_deviation = if deviations_a_pixel > 0 {
            let root = numeric::inverse_root(deviations_a_pixel.cast_unsigned());
            let (inverse, doublings) = numeric::inverse(root);
            numeric::shifted_32(inverse, doublings - 22)
        } else {
            i32::MAX
        };
        let wider = (shape.wider).map_or(i64::MIN, |(wider, log2)| {
            numeric::shifted(product(wider, width), log2)
        });
        // p is the sum of two samples. A sample's own length makes the spot of its samples lower than that of
        // the light, by s / width: 1 + 1/24 s^2, to 0.1 % for widths from 1.2 pixels on.
        let (peak, log2) = shape.peak;
        let by = numeric::sub_i32(log2, numeric::add_i32(fraction.cast_signed(), 1));
        let by = numeric::add_i32(by, Counts::FRACTION.cast_signed());
        let of_sample = numeric::shifted_32(peak, by) / block;
        let lower = numeric::mul_i32(dual_mac::upper_product(pitch, pitch), (1 << 11) / 24);
        let more = numeric::mul_i32(dual_mac::upper_product(of_sample, lower), 2);
        Self {
            pairs: number,
            components,
            deviations_a_pixel,
            pixels_a_deviation,
            worst: numeric::mul_i64(product(worst, worst), white.into()) >> 16,
            own_of_a_pair: 0,
            squares,
            leverage: ((pitch >> 10) * LEVERAGE_A_PITCH) >> 8,
            width: Pixels::from_bits(numeric::saturated(wider.saturating_add(width.into()))),
            height: Counts::from_bits(of_sample.saturating_add(more)),
            even: Even::of(&shape, height, unlit, noise.shot, fraction),
        }
    }
}

/// The most that the sum of squares of so many pairs may be by chance, Q8.
fn most_squares(freedom: i32, trust: i32) -> i32 {
    let by_chance = ((SCATTER * root_of_double(freedom)) >> 8) + SCATTER_SKEWED;
    let freedom = numeric::mul_i32(freedom, 256);
    numeric::add_i32(freedom, numeric::mul_i32(trust, by_chance) >> 8)
}

/// The standard deviation of the sum of the squares of so many deviations, Q8: the root of 2 n, and of the
/// noise's variance, which is known to 6 %, because the noise is known to 3 % (see [`crate::spot::find`]).
fn root_of_double(number: i32) -> i32 {
    static ROOTS: [u16; pairs::MOST_PAIRS + 1] = {
        let mut roots = [0; pairs::MOST_PAIRS + 1];
        let mut n = 0;
        while n < roots.len() {
            // 0.0036 n^2, Q16.
            let square = 2 * n * (1 << 16) + 236 * n * n;
            roots[n] = numeric::to_u16(square.isqrt());
            n += 1;
        }
        roots
    };
    let place = usize::try_from(number).unwrap_or_default();
    ROOTS.get(place).copied().unwrap_or(u16::MAX).into()
}

/// How far the statistics of a spot may be from those of noise.
#[derive(Clone, Copy)]
struct Trust {
    /// Standard deviations of the even statistics beyond their limits, Q4.
    even: i32,
    /// Factor of the limits of the odd ones, Q8.
    odd: i32,
    /// Limit of the shape's misfit, Q16.
    misfit: i32,
}

impl Trust {
    /// A narrow spot without some of its pixels is flagged anyway.
    fn of(found: &RowCentre, masked: &MaskedPixels) -> Self {
        let is_wide = found.width > SHARP_WIDTH || masked.samples != 0;
        if is_wide {
            Self {
                even: EVEN,
                odd: 1 << 8,
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
mod tests;
