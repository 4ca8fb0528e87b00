//! The normal equations of the fit, and the step that solves them.

use crate::base::numeric::{self, limited};

/// Samples in a window.
pub const SAMPLES: usize = 128;
/// s in samples: from half a pixel to half of the window.
const SMALLEST_S: f32 = 0.57;
const LARGEST_S: f32 = 64.0;
/// The variance of a saturated sample, in counts squared. It masks the sample: the sample weighs nothing
/// beside any other.
pub(super) const SATURATED: f32 = 1e30;
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

impl Parameters {
    pub(super) fn moved(&self, step: &Step) -> Self {
        let grow = |step: f32| 1.0 + limited(step, -0.5, 0.5);
        Self {
            centre: self.centre + limited(step.c, -1.0, 1.0) * self.width,
            width: limited(self.width * grow(step.s), SMALLEST_S, LARGEST_S),
            amplitude: self.amplitude * grow(step.a),
            level: self.level + step.b * self.amplitude,
        }
    }
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
    pub(super) squares: f32,
}

pub(super) struct Step {
    pub(super) b: f32,
    pub(super) a: f32,
    pub(super) s: f32,
    pub(super) c: f32,
    /// Its squared length in the metric of the equations.
    pub(super) length: f32,
    /// The variance of c / s: the last element of the inverse.
    pub(super) variance: f32,
}

/// Sums up the normal equations at a point. Not inlined, so that what a step costs can be counted.
#[inline(never)]
pub fn normal_equations(samples: &[Sample], at: &Parameters, shot: f32) -> NormalEquations {
    // A centre off the window makes one side empty.
    let middle = numeric::whole_usize(at.centre + 0.5).min(samples.len());
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
pub(super) struct Scale {
    /// 1 / A.
    per_height: f32,
    /// b / A.
    level: f32,
    /// The variance of the shot noise where e is 1.
    shot: f32,
}

impl Scale {
    pub(super) fn of(at: &Parameters, shot: f32) -> Self {
        let per_height = 1.0 / at.amplitude;
        Self {
            per_height,
            level: at.level * per_height,
            shot: shot * at.amplitude,
        }
    }
}

impl NormalEquations {
    #[inline(always)]
    pub(super) fn add(&mut self, sample: &Sample, scale: &Scale, u: f32, e: f32, sign: f32) {
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
    pub(super) fn solve(&self) -> Option<Step> {
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

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub const AT: Parameters = Parameters {
        centre: 63.37,
        width: 10.5,
        amplitude: 2000.0,
        level: 3.0,
    };

    pub fn model(at: &Parameters, i: usize) -> f64 {
        let u = (i as f64 - f64::from(at.centre)) / f64::from(at.width);
        f64::from(at.level) + f64::from(at.amplitude) * libm::exp(-0.5 * u * u)
    }

    /// Samples of a light and a variance.
    pub fn samples_of(light: impl Fn(usize) -> f64, variance: f32) -> [Sample; SAMPLES] {
        core::array::from_fn(|i| Sample {
            counts: light(i) as f32,
            variance,
        })
    }

    /// A spot that is a little off the model, so that all sums have something to add.
    pub fn samples(at: &Parameters) -> [Sample; SAMPLES] {
        let mut all = samples_of(|i| model(at, i) + (i * i * i % 11) as f64 * 10.0, 4.0);
        all[60].variance = SATURATED;
        all
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
            let off = (left - right[j]) / (m[j][j] * squares).sqrt();
            assert!(off.abs() < 1e-4, "{j}: {left} {}", right[j]);
        }
        // If level, height and width were known, the variance of the centre would be one over its own
        // element. It cannot be smaller.
        assert!(f64::from(step.variance) * m[3][3] > 0.999);
    }
}
