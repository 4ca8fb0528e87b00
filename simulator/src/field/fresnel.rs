//! The Fresnel integrals.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

use super::complex::phasor;

/// C(v) + i S(v) = int_0^v exp(i pi t^2 / 2) dt, as (C, S), for any v.
///
/// Up to |v| = 1.8 the power series; above, (1 + i)/2 - exp(i pi v^2 / 2) (g + i f) with the auxiliary
/// functions f and g from the continued fraction of the complementary error function (NIST Digital Library of
/// Mathematical Functions, 7.5.7, 7.6.4, 7.6.6, 7.9.3).
pub fn fresnel(v: f64) -> (f64, f64) {
    let x = v.abs();
    let (c, s) = if x < 1.8 {
        series(x)
    } else {
        let (f, g) = auxiliary(x);
        let (sin, cos) = libm::sincos(FRAC_PI_2 * (x * x).rem_euclid(4.0));
        (0.5 + f * sin - g * cos, 0.5 - f * cos - g * sin)
    };
    (c.copysign(v), s.copysign(v))
}

/// sum i^n (pi/2)^n x^(2n+1) / (n! (2n + 1)): real parts make C, imaginary ones S.
fn series(x: f64) -> (f64, f64) {
    let (mut c, mut s) = (0.0, 0.0);
    let mut power = x;
    for n in 0..40 {
        let term = power / f64::from(2 * n + 1);
        match n % 4 {
            0 => c += term,
            1 => s += term,
            2 => c -= term,
            _ => s -= term,
        }
        power *= FRAC_PI_2 * x * x / f64::from(n + 1);
    }
    (c, s)
}

/// f and g for x >= 0: g + i f = (1 + i)/2 exp(z^2) erfc z with z = (1 - i) x sqrt(pi)/2.
fn auxiliary(x: f64) -> (f64, f64) {
    if x < 1.8 {
        let (c, s) = series(x);
        let (sin, cos) = libm::sincos(FRAC_PI_2 * x * x);
        let (c, s) = (0.5 - c, 0.5 - s);
        return (s * cos - c * sin, c * cos + s * sin);
    }
    // exp(z^2) erfc z = 1/sqrt(pi) / (z + (1/2) / (z + 1 / (z + (3/2) / (z + ...)))), from the end.
    let z = 0.5 * PI.sqrt() * x;
    let (mut re, mut im) = (z, -z);
    for n in (1..=150).rev() {
        let factor = 0.5 * f64::from(n) / (re * re + im * im);
        (re, im) = (z + factor * re, -z - factor * im);
    }
    let scale = 1.0 / (PI.sqrt() * (re * re + im * im));
    let (re, im) = (re * scale, -im * scale);
    // Times (1 + i)/2.
    (0.5 * (re + im), 0.5 * (re - im))
}

/// Where the table of f and g ends and their asymptotic series serve.
const REACH: f64 = 8.0;
/// Knots of the table from 1 to 1: a cubic through four of them is good to 1e-7.
const KNOTS_PER_UNIT: f64 = 64.0;

/// f and g at knots from one before 0 on.
static TABLE: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    let knots = (REACH * KNOTS_PER_UNIT) as i32 + 3;
    let at = |knot| {
        // f and g go on smoothly through zero; one knot before it the series still holds.
        let (f, g) = auxiliary(f64::from(knot) / KNOTS_PER_UNIT);
        [f as f32, g as f32]
    };
    (-1..knots).map(at).collect()
});

/// The same for many arguments: from a table, within 1e-6.
#[inline]
pub fn fresnel_by_table(v: f64) -> (f32, f32) {
    let x = v.abs();
    let (f, g) = auxiliary_by_table(x);
    let (cos, sin) = phasor(0.25 * x * x);
    let sign = if v < 0.0 { -1.0 } else { 1.0 };
    (
        sign * (0.5 + f * sin - g * cos),
        sign * (0.5 - f * cos - g * sin),
    )
}

#[inline]
fn auxiliary_by_table(x: f64) -> (f32, f32) {
    if x >= REACH {
        // Asymptotic series (DLMF 7.12.2, 7.12.3). The terms that are left out are below 1e-6 of the sum.
        let u = (1.0 / (PI * x * x)) as f32;
        let f = (1.0 / (PI * x)) as f32;
        return (f * (1.0 - 3.0 * u * u), f * u * (1.0 - 15.0 * u * u));
    }
    let place = x * KNOTS_PER_UNIT;
    let knot = place as usize;
    let t = (place - knot as f64) as f32;
    let [a, b, c, d] = [0, 1, 2, 3].map(|i| TABLE[knot + i]);
    // Lagrange's cubic through four knots, t from the second.
    let wa = -t * (t - 1.0) * (t - 2.0) / 6.0;
    let wb = (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0;
    let wc = -(t + 1.0) * t * (t - 2.0) / 2.0;
    let wd = (t + 1.0) * t * (t - 1.0) / 6.0;
    let cubic = |i: usize| wa * a[i] + wb * b[i] + wc * c[i] + wd * d[i];
    (cubic(0), cubic(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gauss-Legendre panels of a tenth over exp(i pi t^2 / 2).
    #[test]
    fn integrals_are_those_of_quadrature() {
        let nodes = super::super::quadrature::gauss_legendre(12);
        let (mut c, mut s) = (0.0, 0.0);
        let (mut worst, mut worst_fast) = (0.0f64, 0.0f64);
        for panel in 0..400 {
            let middle = 0.1 * (f64::from(panel) + 0.5);
            for &(x, weight) in &nodes {
                for t in [middle - 0.05 * x, middle + 0.05 * x] {
                    c += 0.05 * weight * (FRAC_PI_2 * t * t).cos();
                    s += 0.05 * weight * (FRAC_PI_2 * t * t).sin();
                }
            }
            for sign in [-1.0, 1.0] {
                let v = sign * (middle + 0.05);
                let off = |(re, im): (f64, f64)| (re - sign * c).abs().max((im - sign * s).abs());
                worst = worst.max(off(fresnel(v)));
                let (fast_c, fast_s) = fresnel_by_table(v);
                worst_fast = worst_fast.max(off((fast_c.into(), fast_s.into())));
            }
        }
        println!("Fresnel integrals up to 40: within {worst:.1e}, from the table {worst_fast:.1e}");
        assert!(worst < 1e-12 && worst_fast < 1e-6);
    }
}
