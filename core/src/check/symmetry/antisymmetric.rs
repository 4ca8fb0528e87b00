//! The odd part of a row: its antisymmetric light, projected on u e, u, u^3 e, u^5 e and u^7 e.

use super::LEAST_NORM;
use super::mirror_pairs::Pair;
use crate::centre::spot_shape::COMPONENTS;

/// Sums of the odd part, weighted: products of u e, u^3 e, u^5 e, u^7 e and u with each other and with z. The
/// product of u^j e and u^k e depends on j + k alone: `m1` is that of u e with itself, `m7` of u^7 e with
/// itself. `t1` is the product of u with u e.
#[derive(Default)]
pub(super) struct Odd {
    pub(super) m1: f32,
    m2: f32,
    m3: f32,
    m4: f32,
    m5: f32,
    m6: f32,
    m7: f32,
    tt: f32,
    t1: f32,
    t3: f32,
    t5: f32,
    t7: f32,
    z1: f32,
    z3: f32,
    z5: f32,
    z7: f32,
    zt: f32,
    pub(super) squares: f32,
    pub(super) worst: f32,
}

impl Odd {
    /// Adds a pair's w z^2.
    #[inline(always)]
    pub(super) fn add_square(&mut self, square: f32) {
        self.squares += square;
        if square > self.worst {
            self.worst = square;
        }
    }

    #[inline(always)]
    pub(super) fn add_products(&mut self, pairs: &[Pair]) {
        for pair in pairs {
            self.add(*pair);
        }
    }

    /// Subtracts a slope from z, and sums the pairs again.
    #[cold]
    #[inline(never)]
    pub(super) fn without(slope: f32, pairs: &mut [Pair]) -> Self {
        let mut odd = Self::default();
        for pair in &mut *pairs {
            let z = pair.weighted_z / pair.weight - slope * pair.u;
            pair.weighted_z = pair.weight * z;
            odd.add_square(pair.weighted_z * z);
        }
        odd.add_products(pairs);
        odd
    }

    /// The slope of the tilt, in units of z for each u.
    pub(super) fn slope(&self) -> f32 {
        (self.zt - self.t1 / self.m1 * self.z1) / (self.tt - self.t1 * self.t1 / self.m1)
    }

    /// The product of u^j e and u^k e depends on j + k alone, so each sum takes the product of a function and
    /// of another that has the weight already.
    #[inline(always)]
    fn add(&mut self, pair: Pair) {
        let Pair {
            weight,
            weighted_z: wz,
            u,
            ue: f1,
        } = pair;
        let uu = u * u;
        let f3 = f1 * uu;
        let f5 = f3 * uu;
        let f7 = f5 * uu;
        let (w1, w7, wu) = (weight * f1, weight * f7, weight * u);
        self.m1 += w1 * f1;
        self.m2 += w1 * f3;
        self.m3 += w1 * f5;
        self.m4 += w1 * f7;
        self.m5 += w7 * f3;
        self.m6 += w7 * f5;
        self.m7 += w7 * f7;
        self.tt += wu * u;
        self.t1 += wu * f1;
        self.t3 += wu * f3;
        self.t5 += wu * f5;
        self.t7 += wu * f7;
        self.z1 += wz * f1;
        self.z3 += wz * f3;
        self.z5 += wz * f5;
        self.z7 += wz * f7;
        self.zt += wz * u;
    }

    /// The components along u e, u, u^3 e, u^5 e and u^7 e, each less its parts along those before, in
    /// standard deviations. By Cholesky's method: if A = L L^T are the functions' products, the components
    /// are L^-1 z. Zero for a function that only rounding tells from those before.
    pub(super) fn components(&self) -> [f32; COMPONENTS] {
        let inverse_root = |pivot: f32, element: f32| {
            if pivot > LEAST_NORM * element {
                1.0 / dual_mac::square_root(pivot)
            } else {
                0.0
            }
        };
        let p1 = inverse_root(self.m1, 0.0);
        let (t1, l31, l51, l71) = (self.t1 * p1, self.m2 * p1, self.m3 * p1, self.m4 * p1);
        let y1 = self.z1 * p1;
        let pt = inverse_root(self.tt - t1 * t1, self.tt);
        let l3t = (self.t3 - l31 * t1) * pt;
        let l5t = (self.t5 - l51 * t1) * pt;
        let l7t = (self.t7 - l71 * t1) * pt;
        let yt = (self.zt - t1 * y1) * pt;
        let p3 = inverse_root(self.m3 - l31 * l31 - l3t * l3t, self.m3);
        let l53 = (self.m4 - l51 * l31 - l5t * l3t) * p3;
        let l73 = (self.m5 - l71 * l31 - l7t * l3t) * p3;
        let y3 = (self.z3 - l31 * y1 - l3t * yt) * p3;
        let p5 = inverse_root(self.m5 - l51 * l51 - l5t * l5t - l53 * l53, self.m5);
        let l75 = (self.m6 - l71 * l51 - l7t * l5t - l73 * l53) * p5;
        let y5 = (self.z5 - l51 * y1 - l5t * yt - l53 * y3) * p5;
        let rest = self.m7 - l71 * l71 - l7t * l7t - l73 * l73 - l75 * l75;
        let p7 = inverse_root(rest, self.m7);
        let y7 = (self.z7 - l71 * y1 - l7t * yt - l73 * y3 - l75 * y5) * p7;
        [y1, yt, y3, y5, y7]
    }
}

#[cfg(test)]
impl Odd {
    pub(super) fn all(&self) -> [f32; 19] {
        let it = self;
        let [squares, worst] = [it.squares, it.worst];
        [
            it.m1, it.m2, it.m3, it.m4, it.m5, it.m6, it.m7, it.tt, it.t1, it.t3, it.t5, it.t7,
            it.z1, it.z3, it.z5, it.z7, it.zt, squares, worst,
        ]
    }
}
