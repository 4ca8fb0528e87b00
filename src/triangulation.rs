//! Eq. (1): from the centre of the spot to the distance of the target.
//!
//! With t = tan u, d0 + b tan(u - atan(x/f)) = D + K/(x - xp), where D = d0 - b/t, xp = -f/t and
//! K = b f (1 + t^2)/t^2: no trigonometry, and three parameters rather than four, because (d0, u, b, f) give the same
//! curve along a line of values and cannot be told apart by data.

use core::fmt;
use core::ops::RangeInclusive;

use crate::proven;
use crate::reading::Fault;
use crate::units::{Micrometres, Pixels};

/// Eq. (1) as d = D + K/(x - xp), valid over a range of centres.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Eq1 {
    /// D, the distance at which the centre would run to infinity.
    d: Micrometres,
    /// K in micrometre pixels, Q48.16.
    k: i64,
    /// xp, the centre at which the distance would be infinite.
    pole: Pixels,
    /// The centres for which the curve holds.
    valid: (Pixels, Pixels),
}

/// Why numbers are no eq. (1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eq1Error {
    /// K is zero, or so large that the quotient leaves an i64 (|K| must be below 2^39 um px).
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
            Self::K => "K is zero, or 5.5e11 um px or more: check the points that it was fitted to",
            Self::Empty => "the range of centres is empty: its first must lie before its last",
            Self::Pole => {
                "xp lies in the range of centres, or within a pixel of it: take a range to one side of xp"
            }
            Self::Distance => {
                "a distance in the range of centres is beyond 8.38 m: take a smaller range, further from xp"
            }
            Self::Flat => {
                "the distance hardly depends on the centre, by less than 1/16 um a pixel: check K, or take a range \
                 nearer to xp"
            }
        })
    }
}

impl core::error::Error for Eq1Error {}

/// The least slope of a calibration, as halvings of a micrometre a pixel: a sixteenth. A curve that is flatter would claim to
/// know the distance better than it can be held, wherever the spot is.
pub const FLATTEST_SHIFT: u32 = 4;

/// The calibration of the paper's geometry on a TCD1304DG, used until a sensor has its own: slit 50 mm from the
/// sensor (f), baseline 300 mm (b), tan u = 2.6, d0 = 0, optical axis through the middle of the 3648 pixels of 8 um.
/// Valid from 0.55 m to 1.10 m.
///
/// D = -b/t, xp = 1823.5 px - f/t, K = b f (1 + t^2)/t^2.
pub const NOMINAL: Result<Eq1, Eq1Error> = Eq1::new(
    Micrometres::from_bits((-300_000.0 / T * 256.0 - 0.5) as i32),
    (300_000.0 * (50_000.0 / 8.0) * (1.0 + T * T) / (T * T) * 65536.0 + 0.5) as i64,
    Pixels::from_bits(((1823.5 - 50_000.0 / 8.0 / T) * 65536.0 - 0.5) as i32),
    Pixels::from_int(1191)..=Pixels::from_int(2654),
);

/// tan u of [`NOMINAL`].
const T: f64 = 2.6;

impl Eq1 {
    /// Eq. (1) from D, K (um px, Q48.16), xp, and the centres for which it holds.
    ///
    /// # Errors
    /// The numbers give no curve over that range; [`Eq1Error`] says why.
    pub const fn new(
        d: Micrometres,
        k: i64,
        pole: Pixels,
        valid: RangeInclusive<Pixels>,
    ) -> Result<Self, Eq1Error> {
        let (from, to) = (valid.start().to_bits() as i64, valid.end().to_bits() as i64);
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
        let curve = Self {
            d,
            k,
            pole,
            valid: (*valid.start(), *valid.end()),
        };
        // The curve is monotone on one side of its pole: if both ends can be held, so can all between.
        if !curve.holds(*valid.start()) || !curve.holds(*valid.end()) {
            return Err(Eq1Error::Distance);
        }
        if curve.is_flat() {
            return Err(Eq1Error::Flat);
        }
        Ok(curve)
    }

    /// Whether |K|/(x - xp)^2 is below the least slope where it is least: at the end of the range that is further from xp.
    const fn is_flat(&self) -> bool {
        let pole = self.pole.to_bits() as i64;
        let from = (self.valid.0.to_bits() as i64 - pole).unsigned_abs();
        let to = (self.valid.1.to_bits() as i64 - pole).unsigned_abs();
        let span = (if from > to { from } else { to }) as u128;
        // Q16 over Q32 to 2^-4: |K| 2^16 2^4 against the square. Below 2^75, and 2^66.
        (self.k.unsigned_abs() as u128) * (1 << (Pixels::FRACTION + FLATTEST_SHIFT)) < span * span
    }

    const fn holds(&self, centre: Pixels) -> bool {
        let bits = self.distance_bits(centre);
        bits >= i32::MIN as i64 && bits <= i32::MAX as i64
    }

    /// D + K/(x - xp) in Q24.8 micrometres, rounded; x is at least a pixel from xp.
    const fn distance_bits(&self, centre: Pixels) -> i64 {
        let from_pole = centre.to_bits() as i64 - self.pole.to_bits() as i64;
        // |K| < 2^55 (checked in `new`), so K * 2^8 < 2^63. from_pole is Q16 like K, and at least 2^16: the quotient is
        // Q8 micrometres below 2^47, and adding D (< 2^31) cannot overflow.
        let numerator = proven::mul_i64(self.k, 1 << 8);
        let half = if (numerator < 0) == (from_pole < 0) {
            from_pole / 2
        } else {
            -(from_pole / 2)
        };
        // Rounding: |half| < 2^32, and |numerator| <= 2^63 - 2^8; saturate in the last 2^32 of the range. The division by zero
        // or of the least by -1 does not occur, which the compiler cannot see; i64::MIN is no distance.
        match numerator.saturating_add(half).checked_div(from_pole) {
            Some(quotient) => proven::add_i64(self.d.to_bits() as i64, quotient),
            None => i64::MIN,
        }
    }

    /// The distance at a centre, and the curve's slope there in micrometres a pixel (negative where the distance
    /// falls as the centre grows).
    ///
    /// # Errors
    /// [`Fault::OutOfRange`] where the curve is not valid.
    pub fn distance_at(&self, centre: Pixels) -> Result<(Micrometres, f32), Fault> {
        if centre < self.valid.0 || centre > self.valid.1 {
            return Err(Fault::OutOfRange { centre });
        }
        let bits = self.distance_bits(centre);
        let distance = i32::try_from(bits).map_err(|_| Fault::OutOfRange { centre })?;
        // The slope feeds an uncertainty only, where 24 bits are plenty: -K/(x - xp)^2 = -(d - D)/(x - xp).
        // x - xp is at least a pixel (checked in `new`), so the division is safe; the i64 difference cannot overflow. d - D is
        // at least 16 steps (a pixel times the least slope), of which it is half a step off: 3 % there, 1e-7 at any real sensor.
        let from_pole =
            (i64::from(centre.to_bits()) - i64::from(self.pole.to_bits())) as f32 / 65536.0;
        let above_d = (bits - i64::from(self.d.to_bits())) as f32 / 256.0;
        Ok((Micrometres::from_bits(distance), -above_d / from_pole))
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

    /// The first and the last centre for which the curve holds.
    pub const fn valid(&self) -> (Pixels, Pixels) {
        self.valid
    }
}
