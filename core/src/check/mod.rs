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

use self::pairs::{Correction, Gaps, Noise, Pairs, Place};
use crate::base::{Pixels, WorkBudget, numeric};
use crate::centre::gauss_newton::MaskedPixels;
use crate::centre::spot_shape::{COMPONENTS, OwnSpot, SpotShape};
use crate::centre::tables::TILTED;
use crate::centre::{Estimate, RowCentre};
use crate::check::own_spot::Profile;
use crate::row::{Extremes, Geometry, Light, Row};
use crate::spot::Spot;

/// A narrower spot, in pixels, is flagged. Two or three bad pixels side by side look like a spot of 1.1. With
/// this limit and the other tests, all of 2000 such centres had a flag. With 1.15, four had none.
const NARROWEST_SURE: f32 = 1.2;
/// If the sensor's edge cuts a narrower spot, in pixels, nothing tells it from bad pixels.
const NARROWEST_CUT: f32 = 1.25;
/// If the shape's part of u exceeds this many widths, the row is flagged: u then says no more than that the
/// centre is somewhere in the spot, which has 1 % of its height left at three widths.
const LARGEST_SHAPE: f32 = 3.0;
/// A narrower spot, in pixels, is flagged if it is not symmetric: a single bad pixel looks like a shape
/// there.
const NARROWEST_WITH_SHAPE: f32 = repair::NARROWEST_SURE_REFIT;

/// How far the pairs reach from the centre, in widths.
const REACH: f32 = 6.0;
/// Samples in a width. A sample has at least one pixel, so a narrow spot has fewer samples.
const SAMPLES_A_WIDTH: f32 = 6.0;
/// How much the third derivative of real profiles differs from a gaussian's: a standard deviation, as a share
/// of the correction for that derivative. For sinc^2 of a width of 0.8 pixels, the correction is 5 % of the
/// height, and the difference is less than a third of the correction.
const OTHER_PROFILE: f32 = 0.3;
const FEWEST_PAIRS: f32 = 3.0;
/// The fewest pairs for a check where samples were masked so that the others fit.
const FEWEST_OF_A_PART: f32 = 5.0;
/// Limits of tilt and skew, in standard deviations. Noise exceeds them in one row of 7000 and in one of 5000.
const TILT: f32 = 3.8;
const SKEW: f32 = 3.7;
/// Limit of the worst pair, in standard deviations. Noise exceeds it in one row of 12,000 that have 32 pairs.
const WORST: f32 = 4.7;
/// The sum of squares of n pairs may exceed n by so many standard deviations, and by a constant more, because
/// a chi-square is skewed: (2/3)(3.7^2 - 1), after Cornish and Fisher.
const SCATTER: f32 = 3.7;
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
    width.to_f32() < NARROWEST_SURE
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
        self.width > 0.0
            && (self.flatness).is_none_or(|(k4, deviation)| k4 >= FLAT - even * deviation)
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
        let offset = mirror.offset.to_f32();
        let d = offset.abs();
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
        let correction = Correction::of(offset, per_s, height);
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
            pixels_a_deviation: s
                * per_height
                * dual_mac::square_root(with_noise.dark / odd.norm_of_shift()),
            worst: odd.worst() * white,
            own_of_a_pair: 0.0,
            squares: (odd.squares() - shift * shift) * white,
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
mod tests;
