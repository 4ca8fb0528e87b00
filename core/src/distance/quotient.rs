//! Divides a constant of 63 bits by a variable of 32 bits and rounds, right to the last bit. Takes 25
//! instructions; a division in software takes 250.
//!
//! This is long division with two digits. f32 estimates the first digit, and integers subtract it and leave
//! an exact rest. From that rest f32 estimates the second digit. No estimate is too large, because the
//! reciprocal is made too small by more than the roundings can add. The second digit is right or one too
//! small, and the last rest says which.

use crate::base::numeric;

/// The constant that is divided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dividend {
    /// Below 2^63.
    value: u64,
    /// The value in units of 2^12, rounded.
    float: f32,
}

/// A dividend over a divisor.
#[derive(Clone, Copy, Debug)]
pub struct Quotient {
    /// Rounded to the nearest whole number; a half rounds up.
    pub rounded: u32,
    /// A little less than the quotient: by 4 to 12.1 times 2^-24 of it.
    pub estimate: f32,
    /// A little less than 2^12 over the divisor: by 6 to 10.1 times 2^-24 of it.
    pub reciprocal: f32,
}

/// 2^12, less eight roundings of 2^-24.
const RECIPROCAL_OF: f32 = UNIT * (1.0 - 8.0 / (1u32 << 24) as f32);
/// f32 takes the rest that the first digit leaves in units of this.
const UNIT: f32 = (1u32 << UNIT_SHIFT) as f32;
const UNIT_SHIFT: u32 = 12;

impl Dividend {
    /// Makes a dividend of a value below 2^63.
    pub const fn new(value: u64) -> Self {
        Self {
            value,
            float: value as f32 / UNIT,
        }
    }

    /// The value.
    pub const fn value(self) -> u64 {
        self.value
    }

    /// Divides by a divisor of 2^16 or more. The rounded quotient must be below 2^32.
    ///
    /// With e = 2^-24, each rounding of f32 changes a number by at most a part e of it.
    ///
    /// - The reciprocal has the rounding of the divisor and its own, the estimate two more. So the estimate
    ///   is below the quotient by at least 8 e - 4.01 e and at most 12.01 e of it. So `first_digit` is not
    ///   above the quotient, and below it by less than 12.01 * 2^8 + 1 < 3076. With the half that rounds, the
    ///   rest is less than 3077 divisors, and so than 2^44.
    /// - The rest in units of 2^12 is cut off to a whole number: it loses at most a sixteenth of the divisor.
    ///   With the same roundings as before, the estimate of rest / divisor is not above it, and less than
    ///   1/16 + 3077 * 12.01 e < 0.07 below it. So its whole part is right or one too small, and
    ///   `second_digit` one too large or right. If it is too large, the last rest is below zero.
    #[inline(always)]
    pub fn divide_by(self, divisor: u32) -> Quotient {
        let wide = u64::from(divisor);
        let reciprocal = RECIPROCAL_OF / divisor as f32;
        let estimate = self.float * reciprocal;
        let first_digit = numeric::whole_u32(estimate);
        // Below 2^63 + 2^31.
        let dividend = numeric::add_u64(self.value, u64::from(divisor / 2));
        let rest = numeric::sub_u64(dividend, u64::from(first_digit) * wide);
        let units = ((rest >> UNIT_SHIFT) & 0xffff_ffff) as u32;
        let second_digit = numeric::add_u32(numeric::whole_u32(units as f32 * reciprocal), 1);
        // From -2^32 to 2^32, so right modulo 2^64.
        let rest = rest.wrapping_sub(u64::from(second_digit) * wide) as i64;
        let too_large = u32::from(rest < 0);
        Quotient {
            // Below 2^32, and right modulo 2^32.
            rounded: (first_digit.wrapping_add(second_digit)).wrapping_sub(too_large),
            estimate,
            reciprocal,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact(value: u64, divisor: u32) -> u64 {
        (value + u64::from(divisor / 2)) / u64::from(divisor)
    }

    /// Divides random numbers, and the numbers next to where the rounded quotient changes.
    #[test]
    fn every_quotient_is_right_to_the_last_bit() {
        let mut random = 6u64;
        let mut next = || {
            // C. Steele and S. Vigna, SplitMix64.
            random = random.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mixed = (random ^ (random >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            mixed ^ (mixed >> 31)
        };
        // Miri takes its time.
        let many = if cfg!(miri) { 300 } else { 1_000_000 };
        let (mut below, mut above) = (f64::MAX, 0.0f64);
        for _ in 0..many {
            // Divisors and quotients of every length in bits.
            let divisor = ((next() as u32) >> (next() % 16)).max(1 << 16);
            let whole = (next() as u32) >> (next() % 32);
            let edge = u64::from(whole) * u64::from(divisor) + u64::from(divisor / 2);
            let values = [
                edge.wrapping_sub(1),
                edge,
                edge + 1,
                edge + next() % u64::from(divisor),
                u64::from(whole) * u64::from(divisor),
                next() >> (next() % 64),
            ];
            for value in values {
                if value >= 1 << 63 || exact(value, divisor) >= 1 << 32 {
                    continue;
                }
                let quotient = Dividend::new(value).divide_by(divisor);
                let rounded = u64::from(quotient.rounded);
                assert_eq!(rounded, exact(value, divisor), "{value} / {divisor}");
                if value > 0 {
                    let ratio = value as f64 / f64::from(divisor);
                    let shortfall = (1.0 - f64::from(quotient.estimate) / ratio) * 2f64.powi(24);
                    below = below.min(shortfall);
                    above = above.max(shortfall);
                }
            }
        }
        println!("estimates lack {below:.2} to {above:.2} times 2^-24");
        assert!(below >= 4.0 - 0.01 && above <= 12.01);
    }

    /// Divides at the ends of the allowed ranges.
    #[test]
    fn the_ends_of_the_range() {
        for divisor in [1 << 16, (1 << 16) + 1, 1 << 31, u32::MAX - 1, u32::MAX] {
            let most = u64::from(divisor) * u64::from(u32::MAX) + u64::from((divisor - 1) / 2);
            for value in [0, 1, most, most - 1, u64::from(divisor) - 1] {
                // `most` may be beyond 2^63 for wide divisors.
                let value = value.min((1 << 63) - 1);
                let quotient = Dividend::new(value).divide_by(divisor);
                let rounded = u64::from(quotient.rounded);
                assert_eq!(rounded, exact(value, divisor), "{value} / {divisor}");
            }
        }
    }
}
