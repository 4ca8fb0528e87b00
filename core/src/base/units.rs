//! The numbers that cross a module: fixed point, with the unit in the type.
//!
//! `from_bits` and `to_bits` are the raw integer; every other constructor scales. `Display` is exact decimal
//! arithmetic on the integer (no floating point is formatted on the chip) and rounds half away from zero.

use core::fmt;

use serde::{Deserialize, Serialize};

use super::numeric;

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $fraction:literal, $decimals:literal) => {
        $(#[$doc])*
        #[derive(
            Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize,
        )]
        pub struct $name(i32);

        impl $name {
            /// Bits after the binary point.
            pub const FRACTION: u32 = $fraction;
            /// The smallest value that can be held.
            pub const MIN: Self = Self(i32::MIN);
            /// The largest value that can be held.
            pub const MAX: Self = Self(i32::MAX);

            /// Makes a value from its raw integer: the value times 2^`FRACTION`.
            #[inline]
            pub const fn from_bits(bits: i32) -> Self {
                Self(bits)
            }

            /// The raw integer: the value times 2^`FRACTION`.
            #[inline]
            pub const fn to_bits(self) -> i32 {
                self.0
            }

            /// A whole number of units, saturating at the ends of the range.
            #[inline]
            pub const fn from_int(value: i32) -> Self {
                // An i32 times 2^FRACTION (< 2^31) fits an i64.
                let bits = value as i64 * (1 << $fraction);
                if bits > i32::MAX as i64 {
                    Self::MAX
                } else if bits < i32::MIN as i64 {
                    Self::MIN
                } else {
                    Self(numeric::i64_to_i32(bits))
                }
            }

            /// Converts a float, to within a step (an f32 has 24 bits). Saturates; not-a-number becomes zero.
            #[inline]
            pub fn from_f32(value: f32) -> Self {
                let scaled = value * (1u32 << $fraction) as f32;
                Self(numeric::whole_i32(scaled + 0.5f32.copysign(scaled)))
            }

            /// As [`Self::from_f32`] for a value that is not negative, in fewer instructions. A negative one
            /// may be a step off.
            #[inline(always)]
            pub const fn from_positive_f32(value: f32) -> Self {
                Self(numeric::whole_i32(value * (1u32 << $fraction) as f32 + 0.5))
            }

            /// The value as a float: exact to 24 bits.
            #[inline]
            pub const fn to_f32(self) -> f32 {
                self.0 as f32 / (1u32 << $fraction) as f32
            }

            /// The value as a double: exact.
            #[inline]
            pub const fn to_f64(self) -> f64 {
                self.0 as f64 / (1u32 << $fraction) as f64
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                decimal(f, self.0, $fraction, f.precision().unwrap_or($decimals))
            }
        }
    };
}

quantity! {
    /// A position or length on the row in pixels, Q16.16: ±32768 pixels in steps of 1.5e-5 pixel.
    ///
    /// Pixel *i* of the light range covers [i - 0.5, i + 0.5].
    Pixels, 16, 5
}

impl Pixels {
    /// The place that is so many whole pixels further along the row. Saturates.
    pub(crate) const fn moved_by(self, pixels: i32) -> Self {
        Self(self.0.saturating_add(Self::from_int(pixels).0))
    }
}

quantity! {
    /// Counts of the converter (its LSB), Q24.8: ±8.3 million counts in steps of 0.004.
    Counts, 8, 1
}

quantity! {
    /// A distance in micrometres, Q24.8: ±8.39 m in steps of 0.004 um.
    Micrometres, 8, 0
}

quantity! {
    /// Electrons, Q20.12: ±524,288 electrons in steps of 0.00024.
    Electrons, 12, 2
}

/// A distance as millimetres with four decimals, to a tenth of a micrometre: what a person reads.
pub struct AsMillimetres(pub Micrometres);

impl fmt::Display for AsMillimetres {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Rounded to tenths of micrometres; |bits| < 2^31, so ten times that fits an i64 with room.
        let half = 1i64 << (Micrometres::FRACTION - 1);
        let bits = i64::from(self.0.to_bits());
        let tenths = (bits.abs() * 10 + half) >> Micrometres::FRACTION;
        let sign = if bits < 0 && tenths != 0 { "-" } else { "" };
        write!(f, "{sign}{}.{:04}", tenths / 10_000, tenths % 10_000)
    }
}

/// The unit of distances in lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Units {
    /// With four decimals.
    #[default]
    Millimetres,
    /// With one decimal.
    Micrometres,
}

named! { Units { Millimetres: "mm", Micrometres: "um" } }

/// A distance in a unit, to a tenth of a micrometre.
pub struct InUnits(pub Micrometres, pub Units);

impl fmt::Display for InUnits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.1 {
            Units::Millimetres => AsMillimetres(self.0).fmt(f),
            Units::Micrometres => write!(f, "{:.1}", self.0),
        }
    }
}

/// Writes `bits` / 2^`fraction` with `decimals` (at most 6) digits after the point.
fn decimal(f: &mut fmt::Formatter<'_>, bits: i32, fraction: u32, decimals: usize) -> fmt::Result {
    // Not a list: the compiler would not know how large the scale is.
    let (decimals, scale) = match decimals {
        0 => (0, 1),
        1 => (1, 10),
        2 => (2, 100),
        3 => (3, 1000),
        4 => (4, 10_000),
        5 => (5, 100_000),
        _ => (6, 1_000_000u64),
    };
    // |bits| <= 2^31 and scale <= 10^6 < 2^20: the product is below 2^51.
    let scaled = u64::from(bits.unsigned_abs()) * scale;
    let rounded = (scaled + (1u64 << (fraction - 1))) >> fraction;
    let sign = if bits < 0 && rounded != 0 { "-" } else { "" };
    if decimals == 0 {
        return write!(f, "{sign}{rounded}");
    }
    let (whole, part) = (rounded / scale, rounded % scale);
    write!(f, "{sign}{whole}.{part:0decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_round_half_away_from_zero() {
        let pixels = Pixels::from_bits(0x0001_8000);
        let minus = Pixels::from_bits(-0x0001_8000);
        let millimetres = |um| AsMillimetres(Micrometres::from_int(um)).to_string();
        for (text, expected) in [
            (pixels.to_string(), "1.50000"),
            (format!("{pixels:.0}"), "2"),
            (format!("{minus:.0}"), "-2"),
            (format!("{:.2}", Pixels::from_bits(-1)), "0.00"),
            (Pixels::MIN.to_string(), "-32768.00000"),
            (Counts::MAX.to_string(), "8388608.0"),
            (millimetres(800_123), "800.1230"),
            (millimetres(-5), "-0.0050"),
            (AsMillimetres(Micrometres::MIN).to_string(), "-8388.6080"),
        ] {
            assert_eq!(text, expected);
        }
    }

    #[test]
    fn five_decimals_tell_every_centre_apart() {
        for bits in (-70_000..70_000).chain(239_000_000..239_070_000) {
            let [here, next] = [bits, bits + 1].map(|bits| Pixels::from_bits(bits).to_string());
            assert_ne!(here, next);
        }
    }

    #[test]
    fn conversions_saturate() {
        assert_eq!(Pixels::from_int(40_000), Pixels::MAX);
        assert_eq!(Pixels::from_int(-40_000), Pixels::MIN);
        assert_eq!(Pixels::from_f32(1e9), Pixels::MAX);
        assert_eq!(Pixels::from_f32(f32::NAN), Pixels::from_int(0));
        assert_eq!(Pixels::from_f32(-1.25).to_bits(), -0x0001_4000);
    }
}
