//! Eq. (1): converts the centre of the spot to the distance of the target.
//!
//! With t = tan u, d0 + b tan(u - atan(x/f)) = D + K/(x - xp), where D = d0 - b/t, xp = -f/t and K = b f (1 +
//! t^2)/t^2. This form needs no trigonometry, and three parameters rather than four: (d0, u, b, f) give the
//! same curve along a line of values, so data cannot tell the four apart.
//!
//! **Division.** K over x - xp is a constant of 63 bits over a variable of 32 bits, rounded right to the last
//! bit. It takes 25 instructions; a division in software takes 250. This is long division with two digits.
//! f32 estimates the first digit, and integers subtract it and leave an exact rest. From that rest f32
//! estimates the second digit. No estimate is too large, because the reciprocal is made too small by more
//! than the roundings can add. The second digit is right or one too small, and the last rest says which.

use core::fmt;
use core::ops::RangeInclusive;

use crate::base::drawing::{DRAWING, T};
use crate::base::{Fault, Micrometres, Pixels, numeric};

/// Eq. (1) as d = D + K/(x - xp), valid over a range of centres.
#[derive(Clone, Debug, PartialEq)]
pub struct Eq1 {
    /// D, the distance at which the centre would run to infinity.
    d: Micrometres,
    /// K in micrometre pixels, Q48.16.
    k: i64,
    /// xp, the centre at which the distance would be infinite.
    pole: Pixels,
    valid: (Pixels, Pixels),
    /// |K| in Q40.24. Divided by |x - xp| it gives |d - D| in Q24.8.
    dividend: Dividend,
    /// 1 if the range lies beyond xp, -1 if it lies before xp.
    beyond_pole: i32,
    /// 1 if the distances lie above D, -1 if they lie below.
    above_d: i32,
    /// [`SLOPE`] with the sign of the slope.
    slope: f32,
}

// Its floats are never not-a-number.
impl Eq for Eq1 {}

/// Why numbers do not give a curve of eq. (1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eq1Error {
    /// K is zero, or |K| is 2^39 um px or more, which is too large for the division.
    K,
    /// The range of centres is empty or a single point.
    Empty,
    /// The pole lies in the range of centres, or nearer to it than a pixel.
    Pole,
    /// A distance at an end of the range is beyond what [`Micrometres`] holds.
    Distance,
    /// Somewhere in the range the distance changes by less than a sixteenth of a micrometre a pixel.
    Flat,
}

impl fmt::Display for Eq1Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::K => "K is zero, or 5.5e8 mm px or more: check the points that it was fitted to",
            Self::Empty => "the range of centres is empty: its first must lie before its last",
            Self::Pole => {
                "xp lies in the range of centres, or within a pixel of it: take a range to one side of xp"
            }
            Self::Distance => {
                "a distance in the range of centres is beyond 8.38 m: take a smaller range, further from xp"
            }
            Self::Flat => {
                "the distance hardly depends on the centre, by less than 1/16 um a pixel: check K, or take \
                a range nearer to xp"
            }
        })
    }
}

impl core::error::Error for Eq1Error {}

/// The least slope of a calibration: one micrometre a pixel, halved so many times, which is a sixteenth of a
/// micrometre a pixel. A flatter curve would claim to know the distance better than [`Micrometres`] can hold
/// it, wherever the spot is.
pub const LEAST_SLOPE_HALVINGS: u32 = 4;

/// The calibration of [`DRAWING`], used until a sensor has its own. Valid from 0.55 m to 1.10 m.
///
/// D = -b/t, xp = axis - f/t, K = b f (1 + t^2)/t^2.
#[expect(clippy::cast_possible_truncation, reason = "constants that fit")]
pub const NOMINAL: Result<Eq1, Eq1Error> = Eq1::new(
    Micrometres::from_bits((-(DRAWING.baseline_um as f64) / T * 256.0 - 0.5) as i32),
    (DRAWING.baseline_um as f64 * DRAWING.focal_px as f64 * (1.0 + T * T) / (T * T) * 65536.0 + 0.5)
        as i64,
    Pixels::from_bits(
        ((DRAWING.axis_px as f64 - DRAWING.focal_px as f64 / T) * 65536.0 - 0.5) as i32,
    ),
    Pixels::from_int(1191)..=Pixels::from_int(2654),
);

/// Converts a product to a slope in micrometres a pixel. The product is that of a quotient's estimate (|d -
/// D| in Q24.8) and its reciprocal (2^12 over |x - xp| in Q16.16). The factor also makes up for what those
/// two lack, 8 times 2^-24 each.
const SLOPE: f32 = 1.0 / 16.0 * (1.0 + 16.0 / (1u32 << 24) as f32);

impl Eq1 {
    /// Makes eq. (1) from D, K (um px, Q48.16), xp, and the centres for which it is valid.
    ///
    /// # Errors
    /// The numbers give no usable curve over that range; [`Eq1Error`] says why.
    pub const fn new(
        d: Micrometres,
        k: i64,
        pole: Pixels,
        valid: RangeInclusive<Pixels>,
    ) -> Result<Self, Eq1Error> {
        let (first, last) = (*valid.start(), *valid.end());
        let (from, to) = (first.to_bits() as i64, last.to_bits() as i64);
        let pole_bits = pole.to_bits() as i64;
        let pixel = 1i64 << Pixels::FRACTION;
        if k == 0 || k.unsigned_abs() >= 1 << 55 {
            return Err(Eq1Error::K);
        }
        if from >= to {
            return Err(Eq1Error::Empty);
        }
        if pole_bits > from - pixel && pole_bits < to + pixel {
            return Err(Eq1Error::Pole);
        }
        let is_beyond_pole = pole_bits < from;
        let is_above_d = (k > 0) == is_beyond_pole;
        let curve = Self {
            d,
            k,
            pole,
            valid: (first, last),
            // Below 2^63.
            dividend: Dividend::new(numeric::mul_u64(k.unsigned_abs(), 1 << 8)),
            beyond_pole: if is_beyond_pole { 1 } else { -1 },
            above_d: if is_above_d { 1 } else { -1 },
            slope: if k > 0 { -SLOPE } else { SLOPE },
        };
        // The curve is monotone on one side of its pole: if the distances at both ends fit, so do all
        // between.
        if !curve.has_distance(first) || !curve.has_distance(last) {
            return Err(Eq1Error::Distance);
        }
        if curve.is_flat() {
            return Err(Eq1Error::Flat);
        }
        Ok(curve)
    }

    /// Whether |K|/(x - xp)^2 is below the least slope where it is least: at the end of the range that is
    /// further from xp.
    const fn is_flat(&self) -> bool {
        let (first, last) = self.valid;
        let (from, to) = (self.pixels_from_pole(first), self.pixels_from_pole(last));
        let span = (if from > to { from } else { to }) as u128;
        // Q16 over Q32 to 2^-4: |K| 2^16 2^4 against the square. Below 2^75, and 2^64.
        (self.k.unsigned_abs() as u128) * (1 << (Pixels::FRACTION + LEAST_SLOPE_HALVINGS))
            < span * span
    }

    /// Whether the distance at a centre fits into [`Micrometres`]: |K/(x - xp)|, rounded, must not exceed the
    /// room beside D.
    const fn has_distance(&self, centre: Pixels) -> bool {
        let end = if self.above_d > 0 { i32::MAX } else { i32::MIN };
        let room = end.abs_diff(self.d.to_bits()) as u64;
        let pixels_from_pole = self.pixels_from_pole(centre) as u64;
        // Below 2^63 + 2^31, and 2^32 * (2^32 - 1).
        numeric::add_u64(self.dividend.value(), pixels_from_pole / 2)
            < numeric::mul_u64(room + 1, pixels_from_pole)
    }

    /// |x - xp| in Q16.16 pixels, for a centre on the range's side of xp. A difference of two i32 fits a u32.
    const fn pixels_from_pole(&self, centre: Pixels) -> u32 {
        let beyond = centre.to_bits().wrapping_sub(self.pole.to_bits());
        beyond.wrapping_mul(self.beyond_pole).cast_unsigned()
    }

    /// The distance at a centre, and the curve's slope there in micrometres a pixel. The slope is negative
    /// where the distance falls as the centre grows.
    ///
    /// The distance is D + K/(x - xp) rounded to Q24.8, right to the last bit, and so it never turns back.
    /// Half-way between two steps it is the one further from D. The slope is off by at most 5e-7 of itself:
    /// eight roundings of 2^-24.
    ///
    /// # Errors
    /// [`Fault::OutOfRange`] where the curve is not valid.
    #[inline]
    pub fn distance_at(&self, centre: Pixels) -> Result<(Micrometres, f32), Fault> {
        if centre < self.valid.0 || centre > self.valid.1 {
            return Err(Fault::OutOfRange { centre });
        }
        // `new` has ensured that the centre is a pixel or more from the pole, and that the quotient is less
        // than 2^32.
        let quotient = self.dividend.divide_by(self.pixels_from_pole(centre));
        // The sum fits an i32 (`has_distance`), even if a part of it wraps.
        let above_d = (quotient.rounded as i32).wrapping_mul(self.above_d);
        let distance = Micrometres::from_bits(self.d.to_bits().wrapping_add(above_d));
        let slope = quotient.estimate * (quotient.reciprocal * self.slope);
        Ok((distance, slope))
    }

    /// D.
    pub const fn d(&self) -> Micrometres {
        self.d
    }

    /// K in micrometre pixels, Q48.16.
    pub const fn k(&self) -> i64 {
        self.k
    }

    /// xp.
    pub const fn pole(&self) -> Pixels {
        self.pole
    }

    /// The first and the last centre for which the curve is valid.
    pub const fn valid(&self) -> (Pixels, Pixels) {
        self.valid
    }
}

/// A constant that is divided.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Dividend {
    /// Below 2^63.
    value: u64,
    /// The value in units of 2^12, rounded.
    float: f32,
}

#[derive(Clone, Copy, Debug)]
struct Quotient {
    /// Rounded to the nearest whole number; a half rounds up.
    rounded: u32,
    /// A little less than the quotient: by 4 to 12.1 times 2^-24 of it.
    estimate: f32,
    /// A little less than 2^12 over the divisor: by 6 to 10.1 times 2^-24 of it.
    reciprocal: f32,
}

/// 2^12, less eight roundings of 2^-24.
const RECIPROCAL_OF: f32 = UNIT * (1.0 - 8.0 / (1u32 << 24) as f32);
/// f32 takes the rest that the first digit leaves in units of this.
const UNIT: f32 = (1u32 << UNIT_SHIFT) as f32;
const UNIT_SHIFT: u32 = 12;

impl Dividend {
    /// Makes a dividend of a value below 2^63.
    const fn new(value: u64) -> Self {
        Self {
            value,
            float: value as f32 / UNIT,
        }
    }

    const fn value(self) -> u64 {
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
    fn divide_by(self, divisor: u32) -> Quotient {
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

    #[test]
    fn the_ends_of_the_range() {
        for divisor in [1 << 16, (1 << 16) + 1, 1 << 31, u32::MAX - 1, u32::MAX] {
            let most = u64::from(divisor) * u64::from(u32::MAX) + u64::from((divisor - 1) / 2);
            for value in [0, 1, most, most - 1, u64::from(divisor) - 1] {
                // `most` may be beyond 2^63 for wide divisors.
                let value = value.min((1 << 63) - 1);
                let rounded = u64::from(Dividend::new(value).divide_by(divisor).rounded);
                assert_eq!(rounded, exact(value, divisor), "{value} / {divisor}");
            }
        }
    }
}
