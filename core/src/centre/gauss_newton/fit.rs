//! Steps from start values to the fit of a window's samples.

use super::normal_equations::{Parameters, SAMPLES, Sample, Scale, normal_equations};
use crate::base::numeric;

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

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fit {
    pub(crate) parameters: Parameters,
    /// Standard deviation of the centre in samples, with the other parameters unknown too.
    pub(super) uncertainty: f32,
    /// The sum of squares over the variances.
    pub(super) squares: f32,
    /// Square of the last step in standard deviations of the noise, or of what the fit leaves if that is
    /// more.
    last_step: f32,
    pub(crate) steps: usize,
}

impl Fit {
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

pub(super) struct Until {
    /// After so many steps.
    steps: usize,
    /// Or after a step whose square, in standard deviations, is at most this.
    last_step: f32,
}

impl Until {
    pub(super) const PRECISE: Self = Self {
        steps: MAX_STEPS,
        last_step: LAST_STEP,
    };
}

/// As [`fit`], with weights for a profile with bright flanks. `noise` is a sample's variance without shot
/// noise.
#[inline(never)]
pub(super) fn fit_profile(
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
        let Some(step) = rest.solve() else { continue };
        let mut new = (rest.squares - step.length, Some(i));
        for place in &mut least {
            if new.0 < place.0 {
                core::mem::swap(&mut new, place);
            }
        }
    }
    least.map(|(_, sample)| sample)
}

/// Writes the spot's light in each sample of a window, over its height: by the recurrence of
/// [`normal_equations`].
pub(crate) fn exponentials(at: &Parameters, light: &mut [f32; SAMPLES]) {
    let middle = numeric::whole_usize(at.centre + 0.5).min(SAMPLES);
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

#[cfg(test)]
mod tests {
    use super::super::normal_equations::SATURATED;
    use super::super::normal_equations::tests::{AT, model, samples, samples_of};
    use super::*;

    #[test]
    fn four_parameters_need_more_than_a_flank() {
        let centre = -60.0;
        let at = Parameters { centre, ..AT };
        assert!(normal_equations(&samples(&at), &at, 0.0).solve().is_none());
        assert!(normal_equations(&[], &AT, 0.0).solve().is_none());
        let fitted = fit(&samples_of(|_| 4000.0, SATURATED), AT, 0.0, MAX_STEPS);
        assert!(fitted.is_none_or(|fit| fit.uncertainty > 1e6), "{fitted:?}");
    }

    #[test]
    fn steps_arrive() {
        let truth = Parameters { level: -2.0, ..AT };
        let samples = samples_of(|i| model(&truth, i), 4.0);
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
        let light = |i: usize| {
            let u = (i as f64 - 63.37) / 8.0;
            3000.0 * (libm::exp(-u * u / 2.0) + 0.1 * libm::exp(-u * u / 18.0))
        };
        let start = Parameters {
            centre: 62.5,
            width: 8.0,
            amplitude: 3200.0,
            level: 0.0,
        };
        let [without, with] = [f32::INFINITY, 4.0].map(|noise| {
            let samples = samples_of(light, 4.0);
            let found = fit_profile(&samples, start, 0.1, noise, &Until::PRECISE).expect("a fit");
            println!("{found:?}");
            assert!(found.has_arrived());
            assert!((found.parameters.centre - 63.37).abs() < 0.002);
            found.parameters.width
        });
        assert!(with < 1.15 * 8.0 && without > 1.05 * with);
    }

    /// The claim with the limited mix is the centre's standard deviation with these weights in this noise:
    /// the root of the sum of (w f)^2 v over that of w f^2, with f = u e and the variance v.
    #[test]
    fn the_claim_with_a_limited_mix_is_that_of_its_weights() {
        let (noise, shot) = (4.0, 0.1f32);
        // Too narrow, so that the fit seems to have bright flanks.
        let width = 0.9 * AT.width;
        let (samples, start) = (
            samples_of(|i| model(&AT, i), noise),
            Parameters { width, ..AT },
        );
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
}
