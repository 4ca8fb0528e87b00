//! The even part: the pairs' light, fitted by b + A e (1 + k2 u^2 + k4 u^4).
//!
//! The products with the light are integers. Those of the functions with each other depend on the distances
//! of the samples alone, and need no loop if all pairs count.

use dual_mac::upper_product;

use super::Steps;

/// The least norm of u^4 e that is left without its parts along the other functions, over its full norm. With
/// less, k4 is only rounding: three or four pairs have too few samples for the four functions.
const LEAST_NORM: f32 = 1e-5;

/// Sums of the even part: those of the functions alone, and the products of 1, e, u^2 e and u^4 e with p.
#[derive(Default)]
pub(in crate::check) struct Even {
    pub(in crate::check) norms: Norms,
    pub(in crate::check) p: f32,
    pub(super) p0: f32,
    pub(super) p1: f32,
    pub(super) p2: f32,
    pub(super) squares: f32,
}

/// The number of samples, and the sums of u^k e (`l`) and of u^k e^2 (`m`) over them, for even k. They depend
/// on the distances of the samples alone.
#[derive(Clone, Copy, Default)]
pub(in crate::check) struct Norms {
    pub(in crate::check) samples: f32,
    pub(super) l0: f32,
    pub(super) l1: f32,
    pub(super) l2: f32,
    pub(in crate::check) m0: f32,
    pub(super) m1: f32,
    pub(super) m2: f32,
    pub(super) m3: f32,
    pub(super) m4: f32,
}

/// Up to this distance between pairs, the sums over all pairs are integrals, to a few parts in a million.
pub(super) const FINE_PITCH: f32 = 0.5;

impl Norms {
    /// The sums over all `number` pairs up to [`REACH`](crate::check::REACH) widths, the first at `u`, without a loop.
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

    pub(super) fn add(&mut self, at: &Steps) {
        let (e1, e2) = at.even(at.square());
        let e = at.e as f32 * (1.0 / (1u32 << 31) as f32);
        let e1 = e1 as f32 * (1.0 / (1 << 30) as f32);
        let e2 = e2 as f32 * (1.0 / (1 << 28) as f32);
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

pub(in crate::check) struct Shape {
    /// The coefficient of u^2 e over that of e: how much wider the light is than the spot.
    pub(in crate::check) wider: f32,
    /// The coefficient of u^4 e, and the norm of the part that u^4 e shares with no other function. `None` if
    /// rounding is all of it.
    pub(in crate::check) k4: Option<(f32, f32)>,
    /// The sum of squares that the fit without k4 leaves.
    pub(in crate::check) rest: f32,
}

impl Even {
    /// The middle has u = 0 and e = 1.
    pub(in crate::check) fn add_middle(&mut self, p: f32) {
        self.norms.samples += 1.0;
        self.norms.l0 += 1.0;
        self.norms.m0 += 1.0;
        self.p += p;
        self.p0 += p;
        self.squares += p * p;
    }

    /// Subtracts from each function in turn its parts along those before.
    pub(in crate::check) fn solve(&self) -> Shape {
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

/// Products of p with the even functions, in integers: p / 4 is below 2^28, and the sums of the functions, of
/// at most [`MOST_PAIRS`](super::MOST_PAIRS) pairs with a pitch of a sixth or more, are at most 8 (e), 8 (u^2 e) and 23 (u^4 e).
/// So no sum exceeds 2^31, and that of the squares is below 2^62.
#[derive(Default)]
pub(super) struct EvenSums {
    /// Of p in 2^6 units, and of its products with the functions in 2^3, 2^4 and 2^6 units.
    p: i32,
    p0: i32,
    p1: i32,
    p2: i32,
    squares: i64,
}

impl EvenSums {
    #[inline(always)]
    pub(super) fn add(&mut self, p: i32, at: &Steps, square: i32) {
        let p = p >> 2;
        let (e1, e2) = at.even(square);
        self.p = self.p.wrapping_add(p >> 4);
        self.p0 = self.p0.wrapping_add(upper_product(p, at.e));
        self.p1 = self.p1.wrapping_add(upper_product(p, e1));
        self.p2 = self.p2.wrapping_add(upper_product(p, e2));
        self.squares = (self.squares).wrapping_add(i64::from(p).wrapping_mul(p.into()));
    }

    pub(super) fn even(&self, norms: Norms) -> Even {
        Even {
            norms,
            p: 64.0 * self.p as f32,
            p0: 8.0 * self.p0 as f32,
            p1: 16.0 * self.p1 as f32,
            p2: 64.0 * self.p2 as f32,
            squares: 16.0 * self.squares as f32,
        }
    }
}
