//! The odd part: the differences of the pairs, in standard deviations, as a sum of odd functions.

use dual_mac::SixPairs;

use super::{LARGEST, halves, pair};
use crate::base::numeric;
use crate::centre::spot_shape::COMPONENTS;

/// The least norm of a column that is left without its parts along those before, over its full norm. With
/// less it is only rounding.
pub(super) const LEAST_NORM: f32 = 1e-4;

/// The products of the columns of u e, u, u^3 e, u^5 e, u^7 e and z with each other.
#[derive(Default)]
pub(in crate::check) struct Odd {
    /// The lower triangle, in the columns' units.
    products: [f32; 21],
    /// The largest z, without sign.
    largest: i32,
    /// A standard deviation in z's column.
    deviation: f32,
}

impl Odd {
    #[inline(always)]
    pub(super) fn of(table: &[SixPairs], largest: i32, deviation: f32) -> Self {
        Self {
            products: dual_mac::gram(table).map(|sum| sum as f32),
            largest,
            deviation,
        }
    }

    /// The same without the slope of a tilt in z.
    #[cold]
    #[inline(never)]
    pub(super) fn without_slope(&self, table: &mut [SixPairs]) -> Self {
        let [m11, mt1, mtt, .., z1, zt, _, _, _, _] = self.products;
        // That of the tilt without its part along the shift.
        let slope = (zt - mt1 / m11 * z1) / (mtt - mt1 * mt1 / m11);
        let mut largest = 0;
        for row in &mut *table {
            let [_, t, _, _, _, z] = &mut row.0;
            let [one, other] = [0, 1].map(|half| {
                let (t, z) = (halves(*t)[half], halves(*z)[half]);
                let rest = numeric::whole_i32(z as f32 - slope * t as f32);
                rest.clamp(-LARGEST, LARGEST)
            });
            largest = largest.max(one.abs()).max(other.abs());
            *z = pair(one, other);
        }
        Self::of(table, largest, self.deviation)
    }

    /// The sum of (u e)^2 over the pairs, weighted as if an unlit pair had the weight one.
    pub(in crate::check) fn norm_of_shift(&self) -> f32 {
        let [norm, ..] = self.products;
        norm * (1.0 / (1 << 28) as f32)
    }

    /// The square of the worst pair's deviation, in variances.
    pub(in crate::check) fn worst(&self) -> f32 {
        numeric::square(self.largest as f32 / self.deviation)
    }

    /// The sum of the squares of all pairs' deviations, in variances.
    pub(in crate::check) fn squares(&self) -> f32 {
        let [.., squares] = self.products;
        squares / numeric::square(self.deviation)
    }

    /// The components along u e, u, u^3 e, u^5 e and u^7 e, each less its parts along those before, in
    /// standard deviations. By Cholesky's method: if A = L L^T are the functions' products, the components
    /// are L^-1 z. Zero for a function that only rounding tells from those before.
    pub(in crate::check) fn components(&self) -> [f32; COMPONENTS] {
        let inverse_root = |pivot: f32, element: f32| {
            if pivot > LEAST_NORM * element {
                1.0 / dual_mac::square_root(pivot)
            } else {
                0.0
            }
        };
        let [m11, mt1, mtt, m31, m3t, m33, m51, m5t, m53, m55, ..] = self.products;
        let [.., m71, m7t, m73, m75, m77, z1, zt, z3, z5, z7, _] = self.products;
        let p1 = inverse_root(m11, 0.0);
        let (t1, l31, l51, l71) = (mt1 * p1, m31 * p1, m51 * p1, m71 * p1);
        let y1 = z1 * p1;
        let pt = inverse_root(mtt - t1 * t1, mtt);
        let l3t = (m3t - l31 * t1) * pt;
        let l5t = (m5t - l51 * t1) * pt;
        let l7t = (m7t - l71 * t1) * pt;
        let yt = (zt - t1 * y1) * pt;
        let p3 = inverse_root(m33 - l31 * l31 - l3t * l3t, m33);
        let l53 = (m53 - l51 * l31 - l5t * l3t) * p3;
        let l73 = (m73 - l71 * l31 - l7t * l3t) * p3;
        let y3 = (z3 - l31 * y1 - l3t * yt) * p3;
        let p5 = inverse_root(m55 - l51 * l51 - l5t * l5t - l53 * l53, m55);
        let l75 = (m75 - l71 * l51 - l7t * l5t - l73 * l53) * p5;
        let y5 = (z5 - l51 * y1 - l5t * yt - l53 * y3) * p5;
        let rest = m77 - l71 * l71 - l7t * l7t - l73 * l73 - l75 * l75;
        let p7 = inverse_root(rest, m77);
        let y7 = (z7 - l71 * y1 - l7t * yt - l73 * y3 - l75 * y5) * p7;
        let per_deviation = 1.0 / self.deviation;
        [y1, yt, y3, y5, y7].map(|component| component * per_deviation)
    }
}
