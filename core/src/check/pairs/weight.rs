//! The weight of a pair of samples: one over the variance of their difference.

/// A variance with the unit that [`root_of_weight`] takes: that of a pair without light. It lies in the
/// middle of its entry, so the root of an unlit pair's weight is exact.
pub(super) const UNLIT: u32 = 4096 + 32;

/// 2^16 over the root of a variance in units of [`UNLIT`], for one with 18 leading zeros, by its eight bits from
/// there on. Entries below 64 are not used.
static ROOTS: [u16; 256] = roots();

#[expect(clippy::cast_possible_truncation, reason = "the root is below 2^16")]
const fn roots() -> [u16; 256] {
    let mut roots = [u16::MAX; 256];
    let mut bits = 65;
    while bits < 256 {
        // The middle of the entry is bits + 1/2, and that of UNLIT's entry 64 + 1/2. Below 2^16.
        let square = (129u64 << 32) / (2 * bits as u64 + 1);
        roots[bits] = square.isqrt() as u16;
        bits += 1;
    }
    roots
}

/// The root of one over a variance, which is at least [`UNLIT`] / 1.008 and below 2^31: Q30, one for `UNLIT`,
/// to 0.4 %.
#[inline(always)]
pub(super) fn root_of_weight(variance: u32) -> i32 {
    // An even number of leading zeros, at most 18: so many as the variance of an unlit pair has.
    let zeros = variance.leading_zeros() & !1;
    let [.., highest] = variance.wrapping_shl(zeros).to_le_bytes();
    let root = i32::from(ROOTS[usize::from(highest)]);
    // Below 2^16 * 2^9 * 2^5.
    root.wrapping_shl(zeros >> 1).wrapping_mul(1 << 5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_root_is_right_to_half_a_percent() {
        assert_eq!(root_of_weight(UNLIT), 65535 << 14);
        let (mut worst, mut mean, mut number) = (0.0f64, 0.0, 0);
        for step in 0..6000 {
            let variance = f64::from(UNLIT) * libm::exp(f64::from(step) * 0.002);
            let exact = f64::from(1 << 30) * libm::sqrt(f64::from(UNLIT) / variance);
            let error = f64::from(root_of_weight(variance as u32)) / exact - 1.0;
            worst = worst.max(error.abs());
            mean += error;
            number += 1;
        }
        mean /= f64::from(number);
        println!("worst {worst:.4}, mean {mean:.5}");
        assert!(worst < 5e-3 && mean.abs() < 5e-4);
    }
}
