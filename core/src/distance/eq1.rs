//! Eq. (1): converts the centre of the spot to the distance of the target.
//!
//! With t = tan u, d0 + b tan(u - atan(x/f)) = D + K/(x - xp), where D = d0 - b/t, xp = -f/t and K = b f (1 +
//! t^2)/t^2. This form needs no trigonometry, and three parameters rather than four: (d0, u, b, f) give the
//! same curve along a line of values, so data cannot tell the four apart.

use core::fmt;
use core::ops::RangeInclusive;

use super::quotient::Dividend;
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
    /// The centres for which the curve is valid.
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
