//! Gauss-Legendre quadrature.

use std::f64::consts::PI;

/// The positive nodes on [-1, 1] and their weights, for an even number of nodes: the others are their
/// negatives.
pub fn gauss_legendre(nodes: usize) -> Vec<(f64, f64)> {
    assert!(nodes.is_multiple_of(2), "an even number of nodes");
    let n = nodes as f64;
    let node = |i| {
        let mut x = libm::cos(PI * (i as f64 + 0.75) / (n + 0.5));
        let mut slope = 1.0;
        // Newton's method; five steps are enough for the last digit.
        for _ in 0..6 {
            let (mut p, mut before) = (x, 1.0);
            for degree in 2..=nodes {
                let m = degree as f64;
                (p, before) = (((2.0 * m - 1.0) * x * p - (m - 1.0) * before) / m, p);
            }
            slope = n * (before - x * p) / (1.0 - x * x);
            x -= p / slope;
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..nodes / 2).map(node).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2n nodes integrate even powers up to x^(4n - 2): 2 / (power + 1).
    #[test]
    fn powers_are_integrated_exactly() {
        for nodes in [2, 8, 12, 24] {
            for power in (0..2 * nodes as i32).step_by(2) {
                let term = |(x, weight): &(f64, f64)| 2.0 * weight * x.powi(power);
                let sum: f64 = gauss_legendre(nodes).iter().map(term).sum();
                let exact = 2.0 / f64::from(power + 1);
                assert!((sum - exact).abs() < 1e-13, "{nodes} {power}: {sum}");
            }
        }
    }
}
