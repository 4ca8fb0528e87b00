//! The even part of a row: the sums p of the pairs, fitted by a level and by e, u^2 e and u^4 e.

use super::LEAST_NORM;

/// Sums of the even part: those of the functions alone, and the products of 1, e, u^2 e and u^4 e with p.
#[derive(Default)]
pub(super) struct Even {
    pub(super) norms: Norms,
    pub(super) p: f32,
    p0: f32,
    p1: f32,
    p2: f32,
    squares: f32,
}

/// The number of samples, and the sums of u^k e (`l`) and of u^k e^2 (`m`) over them, for even k. They depend
/// on the distances of the samples alone.
#[derive(Clone, Copy, Default)]
pub(super) struct Norms {
    pub(super) samples: f32,
    l0: f32,
    l1: f32,
    l2: f32,
    pub(super) m0: f32,
    m1: f32,
    m2: f32,
    m3: f32,
    m4: f32,
}

/// Up to this distance between pairs, the sums over all pairs are integrals, to a few parts in a million.
pub(super) const FINE_PITCH: f32 = 0.5;

impl Norms {
    /// The sums over all `number` pairs up to [`super::REACH`] widths, the first at `u`, without a loop.
    ///
    /// The sum of a function over u, u + h, u + 2h ... follows from its integral, after Euler and Maclaurin.
    /// If the function is even, the integral from zero is I, and f, f2, f4 ... are its value and derivatives
    /// at zero, the sum is I/h - B1(x) f - B3(x)/3! h^2 f2 - B5(x)/5! h^4 f4 ..., with x = u/h and
    /// Bernoulli's polynomials B. Less than a millionth of a sum lies beyond the reach.
    pub(super) fn of_all(u: f32, pitch: f32, number: usize) -> Self {
        // Integrals from zero, without their common factor: of u^k e over sqrt(pi/2), of u^k e^2 over
        // sqrt(pi)/2.
        const GAUSSIAN: f32 = 1.253_314_1;
        const SQUARED: f32 = 0.886_226_9;
        let per_pitch = 1.0 / pitch;
        let x = u * per_pitch;
        // From the middle of the range, where the polynomials are zero.
        let y = x - 0.5;
        let (yy, hh) = (y * y, pitch * pitch);
        // B1 = y, B3 = y (y^2 - 1/4), B5 = B3 (y^2 - 7/12), B7 = B3 (y^4 - 3/2 y^2 + 31/48).
        let b3 = y * (yy - 0.25);
        let h2 = hh * b3 * (1.0 / 6.0);
        let h4 = hh * hh * b3 * (yy - 7.0 / 12.0) * (1.0 / 120.0);
        let h6 = hh * hh * hh * b3 * (yy * (yy - 1.5) + 31.0 / 48.0) * (1.0 / 5040.0);
        let (e, ee) = (GAUSSIAN * per_pitch, SQUARED * per_pitch);
        Self {
            samples: number as f32,
            l0: e - y + h2 - 3.0 * h4 + 15.0 * h6,
            l1: e - 2.0 * h2 + 12.0 * h4 - 90.0 * h6,
            l2: 3.0 * e - 24.0 * h4 + 360.0 * h6,
            m0: ee - y + 2.0 * h2 - 12.0 * h4 + 120.0 * h6,
            m1: 0.5 * ee - 2.0 * h2 + 24.0 * h4 - 360.0 * h6,
            m2: 0.75 * ee - 24.0 * h4 + 720.0 * h6,
            m3: 1.875 * ee - 720.0 * h6,
            m4: 6.5625 * ee,
        }
    }

    #[inline(always)]
    fn add(&mut self, e: f32, e1: f32, e2: f32) {
        self.samples += 1.0;
        self.l0 += e;
        self.l1 += e1;
        self.l2 += e2;
        self.m0 += e * e;
        self.m1 += e * e1;
        self.m2 += e1 * e1;
        self.m3 += e1 * e2;
        self.m4 += e2 * e2;
    }
}

pub(super) struct Shape {
    /// The coefficient of u^2 e over that of e: how much wider the light is than the spot.
    pub(super) wider: f32,
    /// The coefficient of u^4 e, and the norm of the part that u^4 e shares with no other function. `None` if
    /// rounding is all of it.
    pub(super) k4: Option<(f32, f32)>,
    /// The sum of squares that the fit without k4 leaves.
    pub(super) rest: f32,
}

impl Even {
    /// Adds a pair, and its norms unless [`Norms::of_all`] sums these.
    #[inline(always)]
    pub(super) fn add<const WITH_NORMS: bool>(&mut self, p: f32, u: f32, e: f32) {
        let uu = u * u;
        let e1 = uu * e;
        let e2 = uu * e1;
        if WITH_NORMS {
            self.norms.add(e, e1, e2);
        }
        self.p += p;
        self.p0 += p * e;
        self.p1 += p * e1;
        self.p2 += p * e2;
        self.squares += p * p;
    }

    pub(super) fn add_middle(&mut self, p: f32) {
        self.add::<true>(p, 0.0, 1.0);
    }

    /// Subtracts from each function in turn its parts along those before.
    pub(super) fn solve(&self) -> Shape {
        let norms = &self.norms;
        let samples = norms.samples;
        let (l0, l1, l2, p) = (
            norms.l0 / samples,
            norms.l1 / samples,
            norms.l2 / samples,
            self.p / samples,
        );
        let c00 = norms.m0 - l0 * norms.l0;
        let c01 = norms.m1 - l0 * norms.l1;
        let c02 = norms.m2 - l0 * norms.l2;
        let p0 = self.p0 - p * norms.l0;
        let (f1, f2) = (c01 / c00, c02 / c00);
        let c11 = norms.m2 - l1 * norms.l1 - f1 * c01;
        let c12 = norms.m3 - l1 * norms.l2 - f1 * c02;
        let p1 = self.p1 - p * norms.l1 - f1 * p0;
        let f = c12 / c11;
        let norm = norms.m4 - l2 * norms.l2 - f2 * c02 - f * c12;
        let p2 = self.p2 - p * norms.l2 - f2 * p0 - f * p1;
        let (second, first) = (p1 / c11, p0 / c00);
        Shape {
            // p0 has the part of u^2 e along e.
            wider: second / (first - f1 * second),
            k4: (norm > LEAST_NORM * norms.m4).then(|| (p2 / norm, norm)),
            rest: self.squares - p * self.p - p0 * p0 / c00 - p1 * p1 / c11,
        }
    }
}

#[cfg(test)]
impl Norms {
    fn sums(&self) -> [f32; 8] {
        let it = self;
        [it.l0, it.l1, it.l2, it.m0, it.m1, it.m2, it.m3, it.m4]
    }
}

#[cfg(test)]
impl Even {
    /// All sums, the norms first.
    pub(super) fn all(&self) -> impl Iterator<Item = f32> {
        let norms = [self.norms.samples].into_iter().chain(self.norms.sums());
        norms.chain([self.p, self.p0, self.p1, self.p2, self.squares])
    }
}

#[cfg(test)]
mod tests {
    use super::super::REACH;
    use super::*;

    /// The sums over all pairs in f64, one after the other. Beyond the reach lies less than 1e-6 of a sum,
    /// and the rounding of single precision is 2e-7.
    #[test]
    fn the_series_gives_the_sums_over_all_pairs() {
        let mut worst = 0.0f64;
        // A sample has one pixel below a width of six, two below twelve, and so on.
        for (pixels, width) in [
            (1, 2.0f32),
            (1, 3.0),
            (1, 5.9),
            (2, 6.0),
            (2, 10.5),
            (3, 12.0),
            (3, 17.9),
            (4, 18.0),
            (5, 25.0),
            (6, 35.9),
        ] {
            let block = pixels as f32;
            let s = libm::sqrtf(width * width + block * block / 12.0);
            let pitch = block / s;
            // The mirror between two pixels, and in the middle of a pixel.
            for to_right in [0.5, 1.0] {
                let first = (to_right + 0.5 * (block - 1.0)) / s;
                let number = (REACH / pitch) as usize + 1;
                let mut sums = [0.0f64; 8];
                for i in 0..number {
                    let u = f64::from(first) + i as f64 * f64::from(pitch);
                    let e = libm::exp(-0.5 * u * u);
                    let parts = [0, 2, 4].map(|power| (power, e)).into_iter();
                    let parts = parts.chain([0, 2, 4, 6, 8].map(|power| (power, e * e)));
                    for (sum, (power, part)) in sums.iter_mut().zip(parts) {
                        *sum += u.powi(power) * part;
                    }
                }
                let norms = Norms::of_all(first, pitch, number);
                assert_eq!(norms.samples, number as f32);
                for (norm, sum) in norms.sums().into_iter().zip(sums) {
                    let error = (f64::from(norm) / sum - 1.0).abs();
                    worst = worst.max(error);
                    assert!(error < 1.5e-6, "{width} {to_right}: {norm} {sum}");
                }
            }
        }
        println!("{worst:.1e}");
    }
}
