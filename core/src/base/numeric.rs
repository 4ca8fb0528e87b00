//! Sums and products that cannot overflow, and integers that fit a smaller type, for a reason that the
//! compiler does not see. The reason stands beside each use, but not for a place on a row or a count of what
//! a row or a frame holds: at most 2^12. The `whole_...` functions cut a float off to an integer: they
//! saturate, and make 0 of NaN, as `as` does.
//!
//! Elsewhere the core uses the plain operators, and the program `panic-free` checks that none of them can
//! overflow: the compiler adds a panic wherever it cannot exclude an overflow, and the program links only if
//! no panic is reachable. These functions have no such panic. With debug assertions, as in all tests and in
//! fuzzing, they panic on an overflow.

#![expect(
    clippy::cast_possible_truncation,
    reason = "`as` saturates, or keeps the number"
)]
#![expect(clippy::cast_sign_loss, reason = "`as` makes a negative float 0")]

macro_rules! exact {
    ($($name:ident: $number:ty, $checked:ident, $wrapping:ident;)*) => {
        $(
            /// The sum, difference or product.
            #[inline(always)]
            pub(crate) const fn $name(a: $number, b: $number) -> $number {
                debug_assert!(a.$checked(b).is_some());
                a.$wrapping(b)
            }
        )*
    };
}

exact! {
    add_u32: u32, checked_add, wrapping_add;
    add_u64: u64, checked_add, wrapping_add;
    sub_u64: u64, checked_sub, wrapping_sub;
    mul_u64: u64, checked_mul, wrapping_mul;
    add_i32: i32, checked_add, wrapping_add;
    sub_i32: i32, checked_sub, wrapping_sub;
    mul_i32: i32, checked_mul, wrapping_mul;
    add_i64: i64, checked_add, wrapping_add;
    sub_i64: i64, checked_sub, wrapping_sub;
    mul_i64: i64, checked_mul, wrapping_mul;
    add_usize: usize, checked_add, wrapping_add;
}

macro_rules! same_number {
    ($($name:ident: $from:ty as $to:ty;)*) => {
        $(
            /// The same number in another type.
            #[inline(always)]
            pub(crate) const fn $name(value: $from) -> $to {
                debug_assert!(value as i64 == value as $to as i64);
                value as $to
            }
        )*
    };
}

same_number! {
    to_u8: usize as u8;
    to_u16: usize as u16;
    to_u32: usize as u32;
    to_i32: usize as i32;
    i64_to_i32: i64 as i32;
    i32_to_u16: i32 as u16;
}

macro_rules! whole_part {
    ($($name:ident: $to:ty;)*) => {
        $(
            /// The whole part, limited to what the type holds. Not-a-number becomes 0.
            #[inline(always)]
            pub(crate) const fn $name(value: f32) -> $to {
                value as $to
            }
        )*
    };
}

whole_part! {
    whole_usize: usize;
    whole_u32: u32;
    whole_u16: u16;
    whole_i32: i32;
}

/// e^-x, Q31, of x >= 0, Q27, to 2^-26 of it and a step of Q31.
///
/// e^-x is 2^-n e^-y, with n the nearest integer to x / ln 2. Taylor's series gives e^-y, up to the seventh
/// power. The higher powers are together below 2^-27, because y is at most ln 2 / 2.
pub(crate) fn exp_of_minus(x: i32) -> i32 {
    /// 1 / ln 2, Q30, and ln 2, Q27.
    const PER_LN2: i32 = 1_549_082_005;
    const LN2: i32 = 93_032_640;
    /// 1/7! to 1/1!, Q30.
    const FACTORS: [i32; 7] = [
        213_044,
        1_491_308,
        8_947_849,
        44_739_243,
        178_956_971,
        536_870_912,
        1_073_741_824,
    ];
    // The product has Q25, and n is at most 23.
    let n = dual_mac::upper_product(x, PER_LN2).wrapping_add(1 << 24) >> 25;
    // Q31.
    let y = x.wrapping_sub(n.wrapping_mul(LN2)).wrapping_mul(1 << 4);
    // The sums, Q30, stay below 1.42.
    let below = |sum: i32, factor: i32| {
        factor.wrapping_sub(dual_mac::upper_product(y, sum).wrapping_mul(2))
    };
    let sum = FACTORS.into_iter().chain([1 << 30]).fold(0, below);
    match n.cast_unsigned().checked_sub(1) {
        Some(halvings) => sum >> halvings.min(31),
        // One is the largest number of Q31.
        None => sum.saturating_mul(2),
    }
}

/// 2^16 over the root of a number. The place of an entry is the highest eight bits of the number, in steps of
/// two bits: places below 64 are not used. The middle of entry 64 has 2^16.
pub(crate) static ROOTS: [u16; 256] = {
    let mut roots = [u16::MAX; 256];
    let mut bits = 65;
    while bits < 256 {
        // The middle of the entry is bits + 1/2.
        let square = (129u64 << 32) / (2 * bits as u64 + 1);
        roots[bits] = square.isqrt() as u16;
        bits += 1;
    }
    roots
};

/// One over the root of x / 2^32, to 2^-25 of it: the first number, Q29, one to two, times 2 to the second
/// one. Any number for zero.
#[inline]
pub(crate) fn inverse_root(x: u32) -> (i32, u32) {
    let halvings = x.leading_zeros() / 2;
    let x = x.wrapping_shl(2 * halvings);
    let [.., highest] = x.to_le_bytes();
    // Newton's steps, root (3 - x root^2) / 2: the table is right to 0.4 %, the first step to 2^-14.
    let root = u32::from(ROOTS[usize::from(highest)]);
    // 2^32 of the root's unit is 256 / 64.5.
    const ONE: u32 = 16_512;
    let product = (root.wrapping_mul(root) >> 16).wrapping_mul(x >> 16) >> 16;
    let twice = u64::from(root.wrapping_mul((3 * ONE).wrapping_sub(product)));
    // 2^(29 - 16) times the root of 256 / 64.5, over 2 ONE: Q32.
    let root = (twice.wrapping_mul(2_122_661_009) >> 32) as i32;
    // Q28, and Q27.
    let square = dual_mac::upper_product(root, root).wrapping_mul(4);
    let product = dual_mac::upper_product((x >> 1).cast_signed(), square);
    let factor = (3i32 << 27).wrapping_sub(product).wrapping_mul(4);
    let root = dual_mac::upper_product(root, factor).wrapping_mul(4);
    (root, halvings)
}

/// As [`inverse_root`] of x / 2^64.
#[inline]
pub(crate) fn inverse_root_of_64(x: u64) -> (i32, u32) {
    let halvings = x.leading_zeros() / 2;
    let high = x.wrapping_shl(2 * halvings) >> 32;
    let (root, _) = inverse_root(high as u32);
    (root, halvings)
}

/// One over x / 2^32, from [`inverse_root`] of x: the first number, Q28, times 2 to the second one.
#[inline(always)]
pub(crate) fn inverse((root, halvings): (i32, u32)) -> (i32, i32) {
    let square = dual_mac::upper_product(root, root).wrapping_mul(4);
    (square, halvings.wrapping_mul(2).cast_signed())
}

/// A number times 2^`by`, rounded down. Saturates.
#[inline]
pub(crate) fn shifted(value: i64, by: i32) -> i64 {
    #[cold]
    #[inline(never)]
    fn left(value: i64, by: u32) -> i64 {
        let bits = by.min(63);
        let moved = value.wrapping_shl(bits);
        if moved >> bits == value {
            moved
        } else if value < 0 {
            i64::MIN
        } else {
            i64::MAX
        }
    }
    if by <= 0 {
        value >> by.unsigned_abs().min(63)
    } else {
        left(value, by.unsigned_abs())
    }
}

/// As [`shifted`].
#[inline]
pub(crate) fn shifted_32(value: i32, by: i32) -> i32 {
    let bits = by.unsigned_abs().min(31);
    let moved = value.wrapping_shl(bits);
    if by <= 0 {
        value >> bits
    } else if moved >> bits == value {
        moved
    } else if value < 0 {
        i32::MIN
    } else {
        i32::MAX
    }
}

/// The whole product.
#[inline(always)]
pub(crate) const fn product(a: i32, b: i32) -> i64 {
    (a as i64).wrapping_mul(b as i64)
}

/// The root of a number that is not negative, rounded down.
#[inline]
pub(crate) fn root(value: i64) -> i32 {
    let root = value.max(0).cast_unsigned().isqrt();
    saturated(root.cast_signed())
}

/// A number limited to 32 bits.
#[inline]
pub(crate) fn saturated(value: i64) -> i32 {
    let low = value as i32;
    if i64::from(low) == value {
        low
    } else {
        i32::MAX ^ (value >> 63) as i32
    }
}

#[inline(always)]
pub(crate) fn square(value: f32) -> f32 {
    value * value
}

/// The larger of two values; `least` if the value is not a number.
#[inline(always)]
pub(crate) fn at_least(value: f32, least: f32) -> f32 {
    if value > least { value } else { least }
}

/// The smaller of two values; `most` if the value is not a number.
#[inline(always)]
pub(crate) fn at_most(value: f32, most: f32) -> f32 {
    if value < most { value } else { most }
}

/// Counts the values that are true. They are in memory, so a `usize` holds their number. The compiler cannot
/// prove that the sum in the `count` of a filter does not overflow.
#[inline(always)]
pub(crate) fn count(all: impl Iterator<Item = bool>) -> usize {
    all.fold(0, |number, is_so| add_usize(number, usize::from(is_so)))
}

/// Limits a value to `low` and `high`; not-a-number stays not-a-number. `f32::clamp` has a panic on bounds
/// that are not in order, which brings 20 KB of formatting to the chip. `max` and `min` have rules for
/// not-a-number that take ten instructions each.
#[inline(always)]
pub(crate) fn limited(value: f32, low: f32, high: f32) -> f32 {
    if value > high {
        high
    } else if value < low {
        low
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::{exp_of_minus, inverse_root, inverse_root_of_64, shifted};

    #[test]
    fn the_exponential_is_right_to_26_bits() {
        assert_eq!(exp_of_minus(0), i32::MAX);
        let mut worst = 0.0f64;
        for x in (0..=i32::MAX).step_by(99_991) {
            let exact = libm::exp(-f64::from(x) / f64::from(1 << 27));
            let found = f64::from(exp_of_minus(x)) / f64::from(1u32 << 31);
            // A step of Q31, and a share.
            let error = (found - exact).abs() / (libm::ldexp(1.0, -31) + libm::ldexp(exact, -26));
            worst = worst.max(error);
        }
        println!("{worst:.2}");
        assert!(worst < 1.0);
    }

    #[test]
    fn a_root_is_right_to_25_bits() {
        let mut worst = 0.0f64;
        let near_powers = (0..32).flat_map(|log2| [0, 1, 2].map(|more| (1u32 << log2) - 1 + more));
        for x in (1..=u32::MAX).step_by(9_991_003).chain(near_powers.skip(1)) {
            for (exact, (root, halvings)) in [
                (f64::from(x), inverse_root(x)),
                (f64::from(x), inverse_root_of_64(u64::from(x) << 32)),
                (libm::ldexp(x.into(), -32), inverse_root_of_64(x.into())),
            ] {
                let exact = libm::ldexp(exact.sqrt(), -16);
                let found = libm::ldexp(root.into(), halvings as i32 - 29);
                worst = worst.max((found * exact - 1.0).abs());
            }
        }
        println!("{:.1} bits", -worst.log2());
        assert!(worst < libm::ldexp(1.0, -25));
    }

    #[test]
    fn a_shifted_number_saturates() {
        for (value, by, expected) in [
            (5, 2, 20),
            (-5, 2, -20),
            (-5, -1, -3),
            (5, -70, 0),
            (-5, -70, -1),
            (5, 61, i64::MAX),
            (-5, 61, i64::MIN),
            (5, 70, i64::MAX),
            (0, 70, 0),
        ] {
            assert_eq!(shifted(value, by), expected, "{value} {by}");
        }
    }
}
