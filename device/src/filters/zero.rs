//! The commands `zero` and `master`: distances relative to a reading.

use core::fmt;

use slitrange::base::units::{Micrometres, Units};
use slitrange::reading::Reading;

/// The reading that distances are relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Zero {
    /// The reading.
    pub reading: Reading,
    /// The distance that its place has: 0, or the value of `master`.
    pub value: Micrometres,
}

impl Zero {
    /// A reading relative to this one. The value is exact, so the uncertainty is that of the difference. The
    /// distance saturates.
    pub fn relative(&self, now: &Reading) -> Reading {
        Reading {
            distance: self.distance(now),
            ..now.relative_to(&self.reading)
        }
    }

    /// The distance of [`Self::relative`].
    pub fn distance(&self, now: &Reading) -> Micrometres {
        let [zero, now] = [self.reading.distance, now.distance].map(Micrometres::to_bits);
        let difference = now.saturating_sub(zero);
        Micrometres::from_bits(difference.saturating_add(self.value.to_bits()))
    }
}

/// A number that a person types, before its unit is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MasterValue {
    ten_thousandths: i64,
}

impl MasterValue {
    /// The largest and, negative, the smallest distance: half of what [`Micrometres`] holds, so that a
    /// reading several metres away from the master is right, too.
    pub const MOST_UM: i64 = 4_000_000;

    /// Reads a number with up to four decimals: `500`, `-0.25`. `None` for anything else.
    pub fn read(word: &str) -> Option<Self> {
        let unsigned = word.strip_prefix('-').unwrap_or(word);
        let (mut size, mut digits) = (0i64, 0u32);
        // The digits behind the point, once the point has come.
        let mut decimals = None;
        for byte in unsigned.bytes() {
            match (byte, decimals) {
                (b'0'..=b'9', _) => {
                    let digit = byte.saturating_sub(b'0');
                    size = size.saturating_mul(10).saturating_add(digit.into());
                    digits = digits.saturating_add(1);
                    decimals = decimals.map(|decimals: u32| decimals.saturating_add(1));
                }
                (b'.', None) if digits > 0 => decimals = Some(0),
                _ => return None,
            }
        }
        let decimals = match decimals {
            None if digits > 0 => 0,
            Some(decimals @ 1..=4) => decimals,
            _ => return None,
        };
        for _ in decimals..4 {
            size = size.saturating_mul(10);
        }
        let sign = if unsigned.len() < word.len() { -1 } else { 1 };
        let ten_thousandths = size.saturating_mul(sign);
        Some(Self { ten_thousandths })
    }

    /// The distance, to the nearest step of [`Micrometres`]. `None` beyond [`Self::MOST_UM`].
    pub fn in_units(self, units: Units) -> Option<Micrometres> {
        // Ten-thousandths of the unit in a micrometre.
        let in_um: i64 = match units {
            Units::Millimetres => 10,
            Units::Micrometres => 10_000,
        };
        let size = self.ten_thousandths.saturating_abs();
        if size > Self::MOST_UM.saturating_mul(in_um) {
            return None;
        }
        // At most 4e10 times 2^8 is below 2^44.
        let steps = size.saturating_mul(1 << Micrometres::FRACTION);
        let bits = steps.saturating_add(in_um / 2) / in_um.max(1);
        let bits = bits.saturating_mul(self.ten_thousandths.signum());
        Some(Micrometres::from_bits(i32::try_from(bits).ok()?))
    }
}

impl fmt::Display for MasterValue {
    /// The number that [`MasterValue::read`] reads as this value.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.ten_thousandths < 0 { "-" } else { "" };
        let size = self.ten_thousandths.unsigned_abs();
        write!(f, "{sign}{}.{:04}", size / 10_000, size % 10_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_read_in_either_unit_and_written_as_it_is_read() {
        for (word, mm, um) in [
            ("500.000", Some(500_000 * 256), Some(500 * 256)),
            ("-0.25", Some(-250 * 256), Some(-64)),
            // A tenth of a micrometre is 25.6 steps.
            ("0.0001", Some(26), Some(0)),
            ("-0.0001", Some(-26), Some(0)),
            ("0", Some(0), Some(0)),
            ("-0", Some(0), Some(0)),
            ("007", Some(7_000 * 256), Some(7 * 256)),
            ("4000", Some(4_000_000 * 256), Some(4_000 * 256)),
            ("-4000", Some(-4_000_000 * 256), Some(-4_000 * 256)),
            ("4000.0001", None, Some(4_000 * 256)),
            ("-4000.0001", None, Some(-4_000 * 256)),
            ("4000000", None, Some(4_000_000 * 256)),
            ("4000000.0001", None, None),
            ("99999999999999999999999999", None, None),
            ("-99999999999999999999999999.9", None, None),
        ] {
            let value = MasterValue::read(word).expect(word);
            let bits = |units| value.in_units(units).map(Micrometres::to_bits);
            assert_eq!(bits(Units::Millimetres), mm, "{word}");
            assert_eq!(bits(Units::Micrometres), um, "{word}");
            assert_eq!(MasterValue::read(&value.to_string()), Some(value));
        }
        for word in [
            "", "-", ".", "1.", ".5", "+1", "--1", "1e3", "1,5", "1.00000", "1.-5", "off",
        ] {
            assert_eq!(MasterValue::read(word), None, "{word}");
        }
    }
}
