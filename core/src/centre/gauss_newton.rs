//! Fits eq. (5) on a level by weighted least squares: centre, width, height and level by the Gauss-Newton
//! method, in f32.
//!
//! This estimator also fits a spot that the sensor's edge cuts, or whose top is saturated: it uses the
//! pixels that are left. Its uncertainty is that of the four parameters together, so it grows where those
//! pixels cannot tell the parameters apart.
//!
//! **Model.** y(x) = b + A e(u), u = (x - c) / s, e = exp(-u^2 / 2). A pixel's own width is in s: s^2 =
//! sigma^2 + 1/12, which leaves an error of at most 0.0003 pixel for a width of 0.8, and none from 1.2.
//!
//! **Weights.** 1 / (noise^2 + g A e), from the model and not from the pixel: pixels that noise makes low
//! must not weigh more. `noise` is measured on the row, rounding to counts included. Saturated pixels
//! weigh nothing. In white noise this is the least-squares fit, in shot noise nearly the maximum-likelihood
//! one.
//!
//! **Scaling.** The unknowns are b / A, ln A, ln s and c / s: the derivatives by them are A times 1, e, u^2 e
//! and u e. The condition number of the normal equations is 22 then (10^9 for pixels and counts), and f32
//! solves them to a thousandth of a step.
//!
//! **Exponential.** Outwards from the pixel nearest to the centre e(k + 1) = e(k) r(k), r(k + 1) = r(k) q,
//! with q = exp(-1 / s^2): two multiplications a pixel. A relative error of 2^-24 in q becomes one of k 2^-24
//! in r(k), and of k^2/2 2^-24 in e(k). As e(k) itself is exp(-k^2 / 2s^2), the error is at most 2^-24 s^2 /
//! 2.7 of the height. For the widest spot that a window is made for, 13 samples, this is 4e-6: a sixtieth of
//! a count of 4095. This error is the same on both sides, like an error of s. The roundings of each step
//! differ between the sides, but add up to less.
//!
//! **Window.** 128 samples, as in the paper. A sample is one pixel up to a width of 12.8. Beyond, it has as
//! many pixels as make the window five widths to either side: at most a sixth of the width, which costs 0.1 %
//! in uncertainty. Sums of n pixels have n^2 / 12 in s^2 in place of 1/12.
//!
//! **Steps.** A step changes c by at most a width, and s and A by at most a half. The fit ends after a step
//! that is shorter than a tenth of a standard deviation in the metric of the normal equations. The error that
//! is left is far smaller, because the method converges quadratically.
//!
//! **Other profiles.** A slit's diffraction pattern is no gaussian. What the fit leaves of a bright one is 30
//! times the noise, and the method converges only linearly. So a step's standard deviation is that of the
//! noise or that of what the fit leaves, whichever is larger; but the step of the centre alone must be short
//! beside the noise too. In shot noise the side lobes weigh most, and the fit widens to cover them: to 1.4
//! widths at a Fresnel number of 0.55. A fit that is wider than the half maximum says therefore weighs the
//! spot's flanks less: see `LEAST_MIX`.

use core::ops::Range;

use crate::base::fault::Fault;
use crate::base::numeric;
use crate::base::numeric::limited;
use crate::base::units::{Counts, Pixels};
use crate::centre::half_width::{self, WIDTHS};
use crate::centre::plausible::{check_uncertainty, count_saturated_pixels};
use crate::centre::{RowCentre, WidthClass};
use crate::row::{Geometry, LARGEST_COUNT, Row};
use crate::spot::Spot;

/// Samples in a window.
pub const SAMPLES: usize = 128;

/// A width has at most so many samples: half of a window then has at least five widths.
const SAMPLES_A_WIDTH: f32 = 12.8;

/// The most pixels in a sample. The widest spot needs 170 * 10 / 128 = 13.3. The sum of this many counts is
/// below 2^16.
const LARGEST_SAMPLE: usize = 16;

// This sum fits in Q8, and is exact in an f32.
const _: () = assert!(
    LARGEST_COUNT as u64 * LARGEST_SAMPLE as u64 * (1 << Counts::FRACTION)
        <= 1 << f32::MANTISSA_DIGITS
);

/// s in samples: from half a pixel to half of the window.
const SMALLEST_S: f32 = 0.57;
/// See [`SMALLEST_S`].
const LARGEST_S: f32 = 64.0;

/// The most steps. Two or three are usual, and four for a spot that is cut off.
pub(crate) const MAX_STEPS: usize = 8;

/// The last step's square in standard deviations is at most this.
const LAST_STEP: f32 = 0.01;

/// The same for a repair, which fits a row many times. What such a step leaves is still far below the noise.
const LAST_STEP_OF_REPAIR: f32 = 0.06;

/// A fit whose last step was longer than half a standard deviation has not arrived.
const ARRIVED: f32 = 0.25;

/// A profile whose fit is so much wider than its half maximum has brighter flanks than a gaussian.
const BRIGHT_FLANKS: f32 = 1.06;

/// The least ratio of the read noise's variance to that of the shot noise at the peak, in the weights of a
/// profile with bright flanks: that of the tables of the estimator `phase-table`, which finds the width of
/// such a profile to 3 %. A fit of a gaussian would lose 9 % in pure shot noise.
const LEAST_MIX: f32 = 0.23;

/// The centre's variance in pure shot noise with weights of [`LEAST_MIX`], over the variance where the noise
/// is what the weights say: the sum of u^2 e^3 / (e + m)^2 over that of u^2 e^2 / (e + m), m = 0.23.
const OTHER_MIX_VARIANCE: f32 = 0.611;

/// A spot with saturated pixels needs this many other samples within three widths: one more than the
/// unknowns that only the spot's own pixels tell.
const FEWEST_SAMPLES: usize = 4;

/// The sum of squares may exceed its expectation by this many standard deviations. For n degrees of freedom
/// the expectation is n.
const MISFIT: f32 = 5.0;

/// The relative uncertainty of the noise's variance: [`crate::spot::find`] knows the noise to 3 % on a row of
/// 3648 pixels. The variance of the sum of squares is 2 n from its own scatter, and (this times n)^2 from
/// that of the noise.
const NOISE_VARIANCE_UNCERTAINTY: f32 = 0.06;

/// The variance of a saturated sample, in counts squared. It masks the sample: the sample weighs nothing
/// beside any other.
const SATURATED: f32 = 1e30;

/// The variance of a sample that the check masks. [`Window::row_centre`] still counts the sample among the
/// degrees of freedom, so a caller that masks samples must test the misfit again.
const MASKED_BY_CHECK: f32 = 2e30;

/// A sample of the window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Counts above the row's level, summed over the sample's pixels.
    pub counts: f32,
    /// Variance in counts squared, without the light's shot noise.
    pub variance: f32,
}

impl Sample {
    /// Masks the sample, until [`Window::unmask`].
    pub(crate) fn mask(&mut self) {
        if !self.is_masked() {
            self.variance = MASKED_BY_CHECK;
        }
    }

    /// Whether [`Self::mask`] masked the sample.
    pub(crate) fn is_masked_by_check(&self) -> bool {
        self.variance >= MASKED_BY_CHECK
    }

    /// Whether the sample weighs nothing: it is saturated, or the check masked it.
    pub(crate) fn is_masked(&self) -> bool {
        self.variance >= SATURATED
    }
}

/// The unknowns of the fit, in samples and counts above the row's level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// c, from the window's first sample.
    pub centre: f32,
    /// s.
    pub width: f32,
    /// A.
    pub amplitude: f32,
    /// b.
    pub level: f32,
}

/// The normal equations: the upper triangle of the matrix, the right-hand side and the sum of squares, all
/// divided by A^2. The letters of a name stand for the unknowns: b for b / A, a for ln A, s for ln s, c for c
/// / s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NormalEquations {
    bb: f32,
    ba: f32,
    bs: f32,
    bc: f32,
    aa: f32,
    /// Also the element of c / s with itself: both are the sum of u^2 e^2.
    as_: f32,
    ac: f32,
    ss: f32,
    sc: f32,
    b: f32,
    a: f32,
    s: f32,
    c: f32,
    squares: f32,
}

/// Finds the centre of a spot that [`crate::spot::find`] found.
///
/// Ignores the row before: the fit starts from the half maximum, which costs only a twentieth of a step.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where the centre is not on the sensor. [`Fault::Saturated`] where saturation leaves
/// too few pixels of the spot. [`Fault::TooDim`] where the centre is uncertain by more than an eighth of the
/// width. [`Fault::NoSpot`] where the fit does not arrive.
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    _before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let light = row.light();
    let start = Start::find(row, spot)?;
    let window = Window::around(row, spot, &start, geometry);
    let (_, shot) = spot.background.variances(geometry);
    let saturated = count_saturated_pixels(row, start.centre, start.width);
    let unfit = match saturated {
        0 => spot.no_spot(),
        pixels => Fault::Saturated { pixels },
    };
    let is_whole = start.is_whole && saturated == 0;
    let least_noise = if is_whole {
        window.variance
    } else {
        f32::INFINITY
    };
    let parameters = window.parameters(&start);
    let until = Until::PRECISE;
    let fit = fit_profile(window.samples(), parameters, shot, least_noise, &until).ok_or(unfit)?;
    let cut_off = window.cut_off(&fit.parameters);
    if cut_off == CutOff::TooMuch {
        return Err(unfit);
    }
    let found = window.row_centre(&fit);
    let sensor = -0.5..light.len() as f32 - 0.5;
    if !sensor.contains(&found.centre.to_f32()) {
        return Err(Fault::SpotAtEdge {
            centre: found.centre,
        });
    }
    let (uncertainty, width) = (found.uncertainty.to_f32(), found.width.to_f32());
    check_uncertainty(found.amplitude.to_f32(), uncertainty, width).map_err(|too_dim| {
        // The spot is cut off: the cause is not a lack of light.
        if cut_off == CutOff::No {
            too_dim
        } else {
            unfit
        }
    })?;
    if fit.has_arrived() && WIDTHS.contains(&width) {
        Ok(found)
    } else {
        Err(unfit)
    }
}

/// The start values of the fit, in pixels and counts.
pub(crate) struct Start {
    pub(crate) centre: Pixels,
    pub(crate) width: f32,
    pub(crate) amplitude: f32,
    /// Whether the half maximum is on the row on both sides.
    pub(crate) is_whole: bool,
}

impl Start {
    /// Finds the start values from the half maximum. If the sensor's edge cuts off one side of the spot, uses
    /// the other.
    pub(crate) fn find(row: &Row<'_>, spot: &Spot) -> Result<Self, Fault> {
        let light = row.light();
        let half = half_width::find(light, spot)?;
        let (offset, half_maximum) = match (half.left, half.right) {
            (Some(left), Some(right)) => (0.5 * (right - left), 0.5 * (left + right)),
            (Some(side), None) | (None, Some(side)) => (0.0, side),
            (None, None) => return Err(Fault::SpotAtEdge { centre: half.top }),
        };
        // A place below 2^13 pixels, and an offset below 2^10.
        let centre = Pixels::from_bits(numeric::add_i32(
            half.top.to_bits(),
            Pixels::from_f32(offset).to_bits(),
        ));
        let flat = flat_top(row, half.top) as f32 * 0.5;
        let (width, amplitude) = if flat > 0.5 && flat < half_maximum {
            // The counts are the saturation F at `flat` and F / 2 at the half maximum.
            let squared =
                (half_maximum * half_maximum - flat * flat) / (2.0 * core::f32::consts::LN_2);
            let above = limited(flat * flat / (2.0 * squared), 0.0, 3.0);
            (
                dual_mac::square_root(squared),
                half.height * libm::expf(above),
            )
        } else {
            (half.sigma(2.0 * half_maximum), half.height)
        };
        Ok(Self {
            centre,
            width: limited(width, *WIDTHS.start(), *WIDTHS.end()),
            amplitude,
            is_whole: half.left.is_some() && half.right.is_some(),
        })
    }
}

/// Half of the window of a spot of this width, in pixels.
pub(crate) fn half_window(width: f32) -> usize {
    pixels_a_sample(width, SAMPLES_A_WIDTH) * (SAMPLES / 2)
}

/// The pixels of a sample, if a width has at most so many samples.
pub(crate) fn pixels_a_sample(width: f32, samples_a_width: f32) -> usize {
    // `as` cuts off.
    ((width / samples_a_width) as usize).min(LARGEST_SAMPLE - 1) + 1
}

/// How many pixels about a place are saturated without a gap.
fn flat_top(row: &Row<'_>, place: Pixels) -> usize {
    let saturation = row.saturated_from();
    let place = usize::try_from(place.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let (left, right) = row.light().split(place);
    let is_full = |count: &u16| *count >= saturation;
    let left = left.iter().rev().take_while(is_full).count();
    left.saturating_add(right.iter().take_while(is_full).count())
}

/// The samples that are fitted.
pub(crate) struct Window {
    /// The first sample's first pixel.
    first: usize,
    /// Pixels in a sample.
    block: usize,
    pub(crate) samples: [Sample; SAMPLES],
    /// How many there are: fewer than [`SAMPLES`] at the sensor's edge.
    length: usize,
    /// How many of them are saturated.
    saturated: usize,
    /// The variance of a sample that is not masked.
    variance: f32,
}

impl Window {
    /// No samples.
    pub(crate) fn empty() -> Self {
        Self {
            first: 0,
            block: 1,
            samples: [Sample::default(); SAMPLES],
            length: 0,
            saturated: 0,
            variance: 0.0,
        }
    }

    pub(crate) fn around(row: &Row<'_>, spot: &Spot, start: &Start, geometry: &Geometry) -> Self {
        let block = pixels_a_sample(start.width, SAMPLES_A_WIDTH);
        let mut window = Self::empty();
        window.fill_around((SAMPLES / 2, block), row, spot, start, geometry);
        window
    }

    /// Fills the window with up to `half` samples of `block` pixels on each side of the start's centre: see
    /// [`pixels_a_sample`]. In place, because a copy takes time.
    pub(crate) fn fill_around(
        &mut self,
        (half, block): (usize, usize),
        row: &Row<'_>,
        spot: &Spot,
        start: &Start,
        geometry: &Geometry,
    ) {
        let light = row.light();
        let half = half.min(SAMPLES / 2);
        let block = block.clamp(1, LARGEST_SAMPLE);
        let middle =
            usize::try_from(start.centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
        let first = middle.saturating_sub(block * half).min(light.len());
        let end = (middle + block * half).min(light.len());
        let pixels = light.slice(first..end).unwrap_or_default();
        // Below 2^16 in Q8, and 16 counts of 12 bits: 2^24 in Q8, exact in f32.
        let level = spot.background.level_bits() * block as i32;
        let (noise, _) = spot.background.variances(geometry);
        (self.first, self.block) = (first, block);
        (self.length, self.saturated) = (0, 0);
        self.variance = noise * block as f32;
        let saturation = row.saturated_from();
        if block == 1 {
            let counts = pixels.iter();
            self.fill(
                level,
                counts.map(|count| (count.into(), count >= saturation)),
            );
        } else {
            let groups = pixels.groups(block);
            self.fill(level, groups.map(|pixels| pixels.sum_of_few(saturation)));
        }
    }

    /// Makes samples of sums of counts, each with whether a pixel of it is saturated. `level` is under
    /// each sample, in Q8.
    #[inline(always)]
    fn fill(&mut self, level: i32, sums: impl Iterator<Item = (u32, bool)>) {
        for (sample, (sum, is_full)) in self.samples.iter_mut().zip(sums) {
            let sum = numeric::mul_i32(sum as i32, 1 << Counts::FRACTION);
            *sample = Sample {
                counts: numeric::sub_i32(sum, level) as f32 / 256.0,
                variance: if is_full { SATURATED } else { self.variance },
            };
            // At most SAMPLES.
            self.saturated = numeric::add_usize(self.saturated, usize::from(is_full));
            self.length = numeric::add_usize(self.length, 1);
        }
    }

    /// Whether the centre is among the samples, and so on the sensor.
    pub(crate) fn has_centre(&self, at: &Parameters) -> bool {
        (-0.5..self.length as f32 - 0.5).contains(&at.centre)
    }

    /// Unmasks the samples that [`Sample::mask`] masked. Saturated samples stay masked.
    pub(crate) fn unmask(&mut self) {
        for sample in &mut self.samples {
            if sample.is_masked_by_check() {
                sample.variance = self.variance;
            }
        }
    }

    /// The pixels of the samples that are masked.
    pub(crate) fn masked_pixels(&self) -> MaskedPixels {
        MaskedPixels {
            first: self.first,
            block: self.block,
            samples: self.bits(Sample::is_masked),
        }
    }

    /// A bit for each sample, the lowest for the first.
    // Bits move up by multiplication: builds that check for overflow test the left operand of a shift.
    pub(crate) fn bits(&self, is_set: impl Fn(&Sample) -> bool) -> u128 {
        let mut words = [0u32; SAMPLES / 32];
        for (word, samples) in words.iter_mut().zip(self.samples().chunks(32)) {
            *word = (samples.iter().rev()).fold(0, |bits, sample| {
                bits.wrapping_mul(2) | u32::from(is_set(sample))
            });
        }
        (words.iter().rev()).fold(0, |all, &word| all.wrapping_mul(1 << 32) | u128::from(word))
    }

    /// The mean of the samples within `reach` of a sample, above the row's level. The samples may lie outside
    /// the window: `sample` is within -2^8 to 2^9. `None` where they are not all on the row.
    pub(crate) fn mean(
        &self,
        row: &Row<'_>,
        spot: &Spot,
        sample: i32,
        reach: usize,
    ) -> Option<f32> {
        let samples = reach.saturating_mul(2).saturating_add(1);
        let before = sample.saturating_sub_unsigned(reach as u32);
        let before = before.saturating_mul(self.block as i32);
        let first = self.first.checked_add_signed(before as isize)?;
        let end = first.checked_add(samples.checked_mul(self.block)?)?;
        let pixels = row.light().slice(first..end)?;
        // At most 2^12 pixels, below 2^20 each in Q8: below 2^32.
        let level = spot.background.level_bits();
        let sum = pixels.iter().fold(0i64, |sum, count| {
            let above = (i32::from(count) * (1 << Counts::FRACTION)).saturating_sub(level);
            sum.saturating_add(above.into())
        });
        Some(sum as f32 / (256.0 * samples as f32))
    }

    pub(crate) fn samples(&self) -> &[Sample] {
        self.samples.get(..self.length).unwrap_or_default()
    }

    /// The distance from the middle of a sample's first pixel to the middle of the sample, in pixels.
    fn half_sample(&self) -> f32 {
        (self.block as f32 - 1.0) * 0.5
    }

    /// Converts start values to samples.
    pub(crate) fn parameters(&self, start: &Start) -> Parameters {
        let block = self.block as f32;
        // Below 2^12 pixels, in Q16.
        let first = Pixels::from_int(self.first as i32);
        let from_first = start.centre.to_bits().saturating_sub(first.to_bits());
        let width = start.width / block;
        Parameters {
            centre: (Pixels::from_bits(from_first).to_f32() - self.half_sample()) / block,
            width: dual_mac::square_root(width * width + 1.0 / 12.0),
            amplitude: start.amplitude * block,
            level: 0.0,
        }
    }

    /// How much of the spot is saturated.
    fn cut_off(&self, fit: &Parameters) -> CutOff {
        if self.saturated == 0 {
            return CutOff::No;
        }
        let (mut fitted, mut full) = (0, 0);
        for (i, sample) in self.samples().iter().enumerate() {
            let distance = (i as f32 - fit.centre).abs();
            if !sample.is_masked() {
                fitted = usize::saturating_add(fitted, (distance <= 3.0 * fit.width).into());
            } else {
                full = usize::saturating_add(full, (distance <= 2.0 * fit.width).into());
            }
        }
        match (full, fitted) {
            (0, _) => CutOff::No,
            (_, FEWEST_SAMPLES..) => CutOff::Top,
            _ => CutOff::TooMuch,
        }
    }

    /// Converts a fit to pixels.
    pub(crate) fn row_centre(&self, fit: &Fit) -> RowCentre {
        let block = self.block as f32;
        let Parameters {
            centre,
            width: s,
            amplitude,
            ..
        } = fit.parameters;
        let width = dual_mac::square_root((s * s - 1.0 / 12.0).max(0.0)) * block;
        let from_first = Pixels::from_f32(centre * block + self.half_sample());
        // No more than 128 each.
        let freedom = self.length as f32 - self.saturated as f32 - 4.0;
        let is_noise = fit.squares <= freedom + allowed_scatter(freedom);
        RowCentre {
            centre: Pixels::from_bits(
                Pixels::from_int(self.first as i32)
                    .to_bits()
                    .saturating_add(from_first.to_bits()),
            ),
            uncertainty: Pixels::from_f32(fit.uncertainty * block),
            // The light, height times width, is the same in pixels and in samples.
            amplitude: Counts::from_f32(amplitude * s / width),
            width: Pixels::from_f32(width),
            class: WidthClass::default(),
            shape: Default::default(),
            misfit: !is_noise,
        }
    }
}

/// How far the sum of squares may be above its expectation, which is that of its degrees of freedom.
pub(crate) fn allowed_scatter(freedom: f32) -> f32 {
    let known = NOISE_VARIANCE_UNCERTAINTY * freedom;
    MISFIT * dual_mac::square_root((2.0 * freedom + known * known).max(0.0))
}

/// Writes the spot's light in each sample of a window, over its height: by the recurrence of
/// [`normal_equations`].
pub(crate) fn exponentials(at: &Parameters, light: &mut [f32; SAMPLES]) {
    let middle = ((at.centre + 0.5) as usize).min(SAMPLES);
    let (left, right) = light.split_at_mut_checked(middle).unwrap_or_default();
    let pitch = 1.0 / at.width;
    let u = (middle as f32 - at.centre) * pitch;
    let falls = libm::expf(-pitch * pitch);
    let side = |u: f32, pitch: f32| {
        let first = libm::expf(-0.5 * u * u);
        (first, libm::expf(-pitch * (u + 0.5 * pitch)))
    };
    let (mut e, mut ratio) = side(u, pitch);
    for light in right {
        *light = e;
        e *= ratio;
        ratio *= falls;
    }
    let (mut e, mut ratio) = side(u - pitch, -pitch);
    for light in left.iter_mut().rev() {
        *light = e;
        e *= ratio;
        ratio *= falls;
    }
}

/// How much of a spot saturation leaves.
#[derive(Clone, Copy, PartialEq)]
enum CutOff {
    /// All of it.
    No,
    /// Flanks that can be fitted: at least [`FEWEST_SAMPLES`] within three widths.
    Top,
    /// Fewer samples than that.
    TooMuch,
}

/// The result of the fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fit {
    pub(crate) parameters: Parameters,
    /// Standard deviation of the centre in samples, with the other parameters unknown too.
    uncertainty: f32,
    /// The sum of squares over the variances.
    squares: f32,
    /// Square of the last step in standard deviations of the noise, or of what the fit leaves if that is
    /// more.
    last_step: f32,
    /// How many steps were taken.
    pub(crate) steps: usize,
}

impl Fit {
    /// Whether the last step was short.
    pub(crate) fn has_arrived(&self) -> bool {
        self.last_step <= ARRIVED
    }
}

/// Fits the samples from a start for a repair, by `most` steps at most. `None` where they do not tell the
/// four parameters apart.
pub(crate) fn fit(samples: &[Sample], start: Parameters, shot: f32, most: usize) -> Option<Fit> {
    let until = Until {
        steps: most,
        last_step: LAST_STEP_OF_REPAIR,
    };
    fit_profile(samples, start, shot, f32::INFINITY, &until)
}

/// When a fit ends.
struct Until {
    /// After so many steps.
    steps: usize,
    /// Or after a step whose square, in standard deviations, is at most this.
    last_step: f32,
}

impl Until {
    const PRECISE: Self = Self {
        steps: MAX_STEPS,
        last_step: LAST_STEP,
    };
}

/// As [`fit`], with weights for a profile with bright flanks. `noise` is a sample's variance without shot
/// noise.
#[inline(never)]
fn fit_profile(
    samples: &[Sample],
    start: Parameters,
    shot: f32,
    noise: f32,
    until: &Until,
) -> Option<Fit> {
    let mut at = start;
    let mut last = None;
    let mut has_bright_flanks = false;
    let per_sample = 1.0 / samples.len() as f32;
    for steps in 1..=until.steps {
        has_bright_flanks |= at.width > BRIGHT_FLANKS * start.width;
        // Weights need only the ratio of the two variances.
        let weighed = if has_bright_flanks {
            shot.min(noise / (LEAST_MIX * at.amplitude))
        } else {
            shot
        };
        let normal = normal_equations(samples, &at, weighed);
        let step = normal.solve()?;
        // The equations were divided by A^2.
        let squared = at.amplitude * at.amplitude;
        let squares = normal.squares * squared;
        // Not less than the noise.
        let scatter = (squares * per_sample).max(1.0);
        let of_centre = step.c * step.c / step.variance * squared;
        let last_step = step.length * squared / scatter;
        let mut variance_of_centre = step.variance / squared;
        if weighed < shot {
            variance_of_centre *= 1.0 + OTHER_MIX_VARIANCE * (shot / weighed - 1.0);
        }
        let fit = Fit {
            parameters: at.moved(&step),
            uncertainty: at.width * dual_mac::square_root(variance_of_centre),
            squares,
            last_step,
            steps,
        };
        at = fit.parameters;
        last = Some(fit);
        if last_step.max(of_centre) <= until.last_step {
            break;
        }
    }
    last
}

/// How many samples [`least_without`] finds.
pub(crate) const CANDIDATES: usize = 3;

/// Finds the samples of a range without which a step leaves the least sum of squares, the least first. A
/// sample adds a product to each sum of the normal equations, which is subtracted again.
#[inline(never)]
pub(crate) fn least_without(
    samples: &[Sample],
    range: core::ops::Range<usize>,
    at: &Parameters,
    shot: f32,
) -> [Option<usize>; CANDIDATES] {
    let all = normal_equations(samples, at, shot);
    let mut light = [0.0; SAMPLES];
    exponentials(at, &mut light);
    let (pitch, scale) = (1.0 / at.width, Scale::of(at, shot));
    let mut least: [(f32, Option<usize>); CANDIDATES] = [(f32::INFINITY, None); CANDIDATES];
    for ((i, sample), e) in (0..SAMPLES).zip(samples).zip(&light) {
        if !range.contains(&i) || sample.is_masked() {
            continue;
        }
        let mut rest = all;
        let u = (i as f32 - at.centre) * pitch;
        rest.add(sample, &scale, u, *e, -1.0);
        let Some(step) = rest.solve() else {
            continue;
        };
        let mut new = (rest.squares - step.length, Some(i));
        for place in &mut least {
            if new.0 < place.0 {
                core::mem::swap(&mut new, place);
            }
        }
    }
    least.map(|(_, sample)| sample)
}

/// A solution of the normal equations.
struct Step {
    b: f32,
    a: f32,
    s: f32,
    c: f32,
    /// Its squared length in the metric of the equations.
    length: f32,
    /// The variance of c / s: the last element of the inverse.
    variance: f32,
}

impl Parameters {
    fn moved(&self, step: &Step) -> Self {
        let grow = |step: f32| 1.0 + limited(step, -0.5, 0.5);
        Self {
            centre: self.centre + limited(step.c, -1.0, 1.0) * self.width,
            width: limited(self.width * grow(step.s), SMALLEST_S, LARGEST_S),
            amplitude: self.amplitude * grow(step.a),
            level: self.level + step.b * self.amplitude,
        }
    }
}

/// Sums up the normal equations at a point. Not inlined, so that what a step costs can be counted.
#[inline(never)]
pub fn normal_equations(samples: &[Sample], at: &Parameters, shot: f32) -> NormalEquations {
    // `as` saturates: a centre off the window makes one side empty.
    let middle = ((at.centre + 0.5) as usize).min(samples.len());
    let (left, right) = samples.split_at_checked(middle).unwrap_or_default();
    let pitch = 1.0 / at.width;
    let u = (middle as f32 - at.centre) * pitch;
    // exp(-1 / s^2), by which the ratio of neighbours changes from one to the next.
    let falls = libm::expf(-pitch * pitch);
    let side = (at, shot, u, pitch, falls);
    let mut sums = NormalEquations::default();
    add_side(&mut sums, right.iter(), side);
    let side = (at, shot, u - pitch, -pitch, falls);
    add_side(&mut sums, left.iter().rev(), side);
    sums
}

/// Adds the samples of one side, outwards from `u` in steps of `pitch`. `falls` is the factor by which the
/// ratio of neighbouring e changes at each step. Not inlined: the sums need all registers.
#[inline(never)]
fn add_side<'a>(
    sums: &mut NormalEquations,
    samples: impl Iterator<Item = &'a Sample>,
    (at, shot, mut u, pitch, falls): (&Parameters, f32, f32, f32, f32),
) {
    let mut e = libm::expf(-0.5 * u * u);
    let mut ratio = libm::expf(-pitch * (u + 0.5 * pitch));
    let scale = Scale::of(at, shot);
    let mut all = *sums;
    for sample in samples {
        all.add(sample, &scale, u, e, 1.0);
        u += pitch;
        e *= ratio;
        ratio *= falls;
    }
    *sums = all;
}

/// What the equations are divided by.
struct Scale {
    /// 1 / A.
    per_height: f32,
    /// b / A.
    level: f32,
    /// The variance of the shot noise where e is 1.
    shot: f32,
}

impl Scale {
    fn of(at: &Parameters, shot: f32) -> Self {
        let per_height = 1.0 / at.amplitude;
        Self {
            per_height,
            level: at.level * per_height,
            shot: shot * at.amplitude,
        }
    }
}

impl NormalEquations {
    /// Adds a sample with this sign.
    #[inline(always)]
    fn add(&mut self, sample: &Sample, scale: &Scale, u: f32, e: f32, sign: f32) {
        let weight = sign / (sample.variance + scale.shot * e);
        let residual = sample.counts * scale.per_height - scale.level - e;
        let ue = u * e;
        let uue = u * ue;
        let (we, wue, wuue) = (weight * e, weight * ue, weight * uue);
        self.bb += weight;
        self.ba += we;
        self.bs += wuue;
        self.bc += wue;
        self.aa += we * e;
        self.as_ += wue * ue;
        self.ac += we * ue;
        self.ss += wuue * uue;
        self.sc += wuue * ue;
        let weighted = weight * residual;
        self.b += weighted;
        self.a += weighted * e;
        self.s += weighted * uue;
        self.c += weighted * ue;
        self.squares += weighted * residual;
    }

    /// Solves the equations by Cholesky's method without square roots (L D L^T). c comes last, so that its
    /// pivot is one over the last element of the inverse. `None` where rounding destroys a pivot: the samples
    /// do not tell the parameters apart.
    fn solve(&self) -> Option<Step> {
        // A pivot is lost if it is 1e-5 of its element or less.
        let pivot = |pivot: f32, element: f32| (pivot > 1e-5 * element).then_some(pivot);
        let pb = pivot(self.bb, 0.0)?;
        let (lab, lsb, lcb) = (self.ba / pb, self.bs / pb, self.bc / pb);
        let pa = pivot(self.aa - lab * self.ba, self.aa)?;
        let (sa, ca) = (self.as_ - lab * self.bs, self.ac - lab * self.bc);
        let (lsa, lca) = (sa / pa, ca / pa);
        let ps = pivot(self.ss - lsb * self.bs - lsa * sa, self.ss)?;
        let cs = self.sc - lsb * self.bc - lsa * ca;
        let lcs = cs / ps;
        let cc = self.as_;
        let pc = pivot(cc - lcb * self.bc - lca * ca - lcs * cs, cc)?;
        let b = self.b;
        let a = self.a - lab * b;
        let s = self.s - lsb * b - lsa * a;
        let c = self.c - lcb * b - lca * a - lcs * s;
        let (zb, za, zs, zc) = (b / pb, a / pa, s / ps, c / pc);
        let length = b * zb + a * za + s * zs + c * zc;
        let step_s = zs - lcs * zc;
        let step_a = za - lsa * step_s - lca * zc;
        Some(Step {
            b: zb - lab * step_a - lsb * step_s - lcb * zc,
            a: step_a,
            s: step_s,
            c: zc,
            length,
            variance: 1.0 / pc,
        })
    }
}

/// The pixels of a window's masked samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct MaskedPixels {
    /// The first pixel of the first sample.
    pub(crate) first: usize,
    /// Pixels in a sample.
    pub(crate) block: usize,
    /// A bit for each sample, the lowest for the first.
    pub(crate) samples: u128,
}

impl MaskedPixels {
    /// The pixels of masked samples, of those side by side together.
    pub(crate) fn runs(&self) -> impl Iterator<Item = Range<usize>> {
        let Self {
            first,
            block,
            mut samples,
        } = *self;
        let runs = core::iter::from_fn(move || {
            if samples == 0 {
                return None;
            }
            let start = samples.trailing_zeros();
            // The carry goes on through the run, to the first sample that is not masked.
            let (carried, is_last) = samples.overflowing_add(1u128.wrapping_shl(start));
            let end = if is_last {
                u128::BITS
            } else {
                (carried & !samples).trailing_zeros()
            };
            samples &= carried;
            Some((start, end))
        });
        runs.map(move |(start, end)| {
            let pixel = |sample: u32| first.saturating_add((sample as usize).saturating_mul(block));
            pixel(start)..pixel(end)
        })
    }

    /// Whether a pixel of the row is in a masked sample.
    pub(crate) fn has(&self, pixel: usize) -> bool {
        let from_first = pixel.checked_sub(self.first);
        let sample = from_first.and_then(|pixels| pixels.checked_div(self.block));
        let bit = sample.and_then(|sample| self.samples.checked_shr(u32::try_from(sample).ok()?));
        bit.is_some_and(|bits| bits & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: Parameters = Parameters {
        centre: 63.37,
        width: 10.5,
        amplitude: 2000.0,
        level: 3.0,
    };

    fn model(at: &Parameters, i: usize) -> f64 {
        let u = (i as f64 - f64::from(at.centre)) / f64::from(at.width);
        f64::from(at.level) + f64::from(at.amplitude) * libm::exp(-0.5 * u * u)
    }

    /// A spot that is a little off the model, so that all sums have something to add.
    fn samples(at: &Parameters) -> [Sample; SAMPLES] {
        core::array::from_fn(|i| Sample {
            counts: (model(at, i) + (i * i * i % 11) as f64 * 10.0) as f32,
            variance: if i == 60 { SATURATED } else { 4.0 },
        })
    }

    /// The sums with an exponential for each pixel, in f64.
    fn reference(samples: &[Sample], at: &Parameters, shot: f64) -> ([[f64; 4]; 4], [f64; 4], f64) {
        let (mut matrix, mut right, mut squares) = ([[0.0; 4]; 4], [0.0; 4], 0.0);
        let amplitude = f64::from(at.amplitude);
        for (i, sample) in samples.iter().enumerate() {
            let u = (i as f64 - f64::from(at.centre)) / f64::from(at.width);
            let e = libm::exp(-0.5 * u * u);
            let weight = 1.0 / (f64::from(sample.variance) + shot * amplitude * e);
            let residual = (f64::from(sample.counts) - model(at, i)) / amplitude;
            let derivatives = [1.0, e, u * u * e, u * e];
            for j in 0..4 {
                for k in 0..4 {
                    matrix[j][k] += weight * derivatives[j] * derivatives[k];
                }
                right[j] += weight * derivatives[j] * residual;
            }
            squares += weight * residual * residual;
        }
        (matrix, right, squares)
    }

    /// Compares the recurrence in f32 with that reference: every sum agrees to 2e-5 of the sum of its terms'
    /// magnitudes (for a product, at most the root of the product of the sums of squares).
    /// Runs of all lengths, up to the last sample.
    #[test]
    fn runs_have_the_pixels_of_all_masked_samples() {
        let mut samples = 0x9E37_79B9_7F4A_7C15_F39C_C060_5CED_C834u128;
        // Miri takes its time.
        let rounds = if cfg!(miri) { 6 } else { 60 };
        for round in 0..rounds {
            let masked = MaskedPixels {
                first: 7,
                block: 3,
                samples,
            };
            let mut last = 0;
            let mut found = std::vec::Vec::new();
            for run in masked.runs() {
                assert!(run.start > last && !run.is_empty(), "{run:?}");
                last = run.end;
                found.extend(run);
            }
            let all: std::vec::Vec<usize> = (0..500).filter(|&it| masked.has(it)).collect();
            assert_eq!(found, all, "{samples:x}");
            samples = match round {
                0 => 0,
                1 => u128::MAX,
                2 => 1 << 127,
                _ => samples.rotate_left(13) ^ samples.wrapping_mul(5) | samples >> 1,
            };
        }
    }

    #[test]
    fn sums_are_those_of_the_definition() {
        let mut worst = 0.0f64;
        for (centre, width) in [
            (63.37, 10.5),
            (63.5, 0.8),
            (64.0, 2.0),
            (0.2, 12.8),
            (-3.0, 10.0),
            (127.4, 5.0),
            (131.0, 12.8),
        ] {
            for shot in [0.0, 0.2] {
                let at = Parameters {
                    centre,
                    width,
                    ..AT
                };
                let samples = samples(&at);
                let found = normal_equations(&samples, &at, shot);
                let (m, r, squares) = reference(&samples, &at, f64::from(shot));
                for (sum, j, k) in [
                    (found.bb, 0, 0),
                    (found.ba, 0, 1),
                    (found.bs, 0, 2),
                    (found.bc, 0, 3),
                    (found.aa, 1, 1),
                    (found.as_, 1, 2),
                    (found.ac, 1, 3),
                    (found.ss, 2, 2),
                    (found.sc, 2, 3),
                    (found.as_, 3, 3),
                ] {
                    let scale = (m[j][j] * m[k][k]).sqrt();
                    worst = worst.max((f64::from(sum) - m[j][k]).abs() / scale);
                }
                for (sum, j) in [(found.b, 0), (found.a, 1), (found.s, 2), (found.c, 3)] {
                    let scale = (m[j][j] * squares).sqrt();
                    worst = worst.max((f64::from(sum) - r[j]).abs() / scale);
                }
                worst = worst.max((f64::from(found.squares) / squares - 1.0).abs());
            }
        }
        println!("sums off by {worst:.1e} at most");
        assert!(worst < 2e-5, "{worst}");
    }

    /// The step solves the equations, as nearly as the sums are right, and the variance is the last element
    /// of the inverse.
    #[test]
    fn the_step_solves_the_equations() {
        let samples = samples(&AT);
        let step = normal_equations(&samples, &AT, 0.2)
            .solve()
            .expect("a step");
        let (m, right, squares) = reference(&samples, &AT, f64::from(0.2f32));
        let x = [step.b, step.a, step.s, step.c].map(f64::from);
        let length: f64 = (0..4).map(|j| x[j] * right[j]).sum();
        assert!((f64::from(step.length) / length - 1.0).abs() < 1e-3);
        for j in 0..4 {
            let left: f64 = (0..4).map(|k| m[j][k] * x[k]).sum();
            let scale = (m[j][j] * squares).sqrt();
            assert!(
                (left - right[j]).abs() < 1e-4 * scale,
                "{j}: {left} {}",
                right[j]
            );
        }
        // If level, height and width were known, the variance of the centre would be one over its own
        // element. It cannot be smaller.
        assert!(f64::from(step.variance) * m[3][3] > 0.999);
    }

    #[test]
    fn four_parameters_need_more_than_a_flank() {
        let at = Parameters {
            centre: -60.0,
            ..AT
        };
        assert!(normal_equations(&samples(&at), &at, 0.0).solve().is_none());
        assert!(normal_equations(&[], &AT, 0.0).solve().is_none());
        let all_full = [Sample {
            counts: 4000.0,
            variance: SATURATED,
        }; SAMPLES];
        let fitted = fit(&all_full, AT, 0.0, MAX_STEPS);
        let uncertain = fitted.is_none_or(|fit| fit.uncertainty > 1e6);
        assert!(uncertain, "{fitted:?}");
    }

    #[test]
    fn steps_arrive() {
        let truth = Parameters { level: -2.0, ..AT };
        let samples: [Sample; SAMPLES] = core::array::from_fn(|i| Sample {
            counts: model(&truth, i) as f32,
            variance: 4.0,
        });
        for (off, width, amplitude) in [(0.0, 1.0, 1.0), (0.8, 0.6, 0.5), (-0.8, 1.5, 1.5)] {
            let start = Parameters {
                centre: truth.centre + off * truth.width,
                width: truth.width * width,
                amplitude: truth.amplitude * amplitude,
                level: 0.0,
            };
            let found = fit(&samples, start, 0.1, MAX_STEPS).expect("a fit");
            println!("{found:?}");
            assert!((found.parameters.centre - truth.centre).abs() < 1e-3);
            assert!((found.parameters.level - truth.level).abs() < 0.1);
            assert!(found.last_step <= LAST_STEP);
        }
    }

    /// A spot with a flare of a tenth of its height, three times as wide. In shot noise, the fit without a
    /// limit on the mix widens to cover the flare.
    #[test]
    fn bright_flanks_widen_the_fit_little() {
        let samples: [Sample; SAMPLES] = core::array::from_fn(|i| {
            let u = (i as f64 - 63.37) / 8.0;
            let light = libm::exp(-u * u / 2.0) + 0.1 * libm::exp(-u * u / 18.0);
            Sample {
                counts: (3000.0 * light) as f32,
                variance: 4.0,
            }
        });
        let start = Parameters {
            centre: 62.5,
            width: 8.0,
            amplitude: 3200.0,
            level: 0.0,
        };
        let fitted =
            |noise| fit_profile(&samples, start, 0.1, noise, &Until::PRECISE).expect("a fit");
        let [without, with] = [f32::INFINITY, 4.0].map(fitted);
        println!("{without:?}\n{with:?}");
        for found in [&without, &with] {
            assert!(found.has_arrived(), "{found:?}");
            assert!((found.parameters.centre - 63.37).abs() < 0.002, "{found:?}");
        }
        assert!(with.parameters.width < 1.15 * 8.0);
        assert!(without.parameters.width > 1.05 * with.parameters.width);
    }

    /// The claim with the limited mix is the centre's standard deviation with these weights in this noise:
    /// the root of the sum of (w f)^2 v over that of w f^2, with f = u e and the variance v.
    #[test]
    fn the_claim_with_a_limited_mix_is_that_of_its_weights() {
        let (noise, shot) = (4.0, 0.1f32);
        let samples: [Sample; SAMPLES] = core::array::from_fn(|i| Sample {
            counts: model(&AT, i) as f32,
            variance: noise,
        });
        // Too narrow, so that the fit seems to have bright flanks.
        let start = Parameters {
            width: 0.9 * AT.width,
            ..AT
        };
        let found = fit_profile(&samples, start, shot, noise, &Until::PRECISE).expect("a fit");
        let (mut product, mut norm) = (0.0, 0.0);
        for i in 0..SAMPLES {
            let u = (i as f64 - f64::from(AT.centre)) / f64::from(AT.width);
            let e = libm::exp(-0.5 * u * u);
            let f = f64::from(AT.amplitude / AT.width) * u * e;
            let peak = f64::from(shot * AT.amplitude);
            let weight = 1.0 / (f64::from(LEAST_MIX) * peak + peak * e);
            product += (weight * f).powi(2) * (f64::from(noise) + peak * e);
            norm += weight * f * f;
        }
        let expected = product.sqrt() / norm;
        let ratio = f64::from(found.uncertainty) / expected;
        println!("{found:?}, expected {expected}: {ratio}");
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }

    #[test]
    fn a_bit_is_a_sample() {
        let masked = MaskedPixels {
            first: 10,
            block: 2,
            samples: 0b101,
        };
        let pixels: std::vec::Vec<usize> = (0..400).filter(|&pixel| masked.has(pixel)).collect();
        assert_eq!(pixels, [10, 11, 14, 15]);
        assert!(!MaskedPixels::default().has(0));
    }
}
