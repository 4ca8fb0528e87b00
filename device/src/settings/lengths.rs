//! Lengths as a person types and reads them, to a tenth of a micrometre. Their unit is the one that the
//! setting `units` says, or the one that the words end with: `limits 790 810.5 mm`.

use core::fmt;

use crate::settings::{ValueError, read_number};
use slitrange::base::units::{Micrometres, Units};

/// The unit that the words end with, or else `units`, and the words before the unit.
pub fn split_unit<'a, 'b>(words: &'a [&'b str], units: Units) -> (&'a [&'b str], Units) {
    let named = |(unit, words): (&&str, _)| Some((words, Units::named(unit)?));
    words.split_last().and_then(named).unwrap_or((words, units))
}

/// Reads a length from `least` to `most` micrometres: `500`, `-0.25`.
///
/// # Errors
/// [`ValueError::Form`] if the word is no number, or has decimals beyond 0.1 um. [`ValueError::Range`] if the
/// length is outside the range.
pub fn read_length(
    word: &str,
    units: Units,
    least: i32,
    most: i32,
) -> Result<Micrometres, ValueError> {
    let (most_decimals, scale) = match units {
        Units::Millimetres => (4, 10_000),
        Units::Micrometres => (1, 10),
    };
    let unsigned = word.strip_prefix('-').unwrap_or(word);
    // As a list: the search for a single character has a panic that the compiler cannot exclude.
    let (whole, decimals) = unsigned.split_once(['.']).unwrap_or((unsigned, "0"));
    if decimals.len() > most_decimals {
        return Err(ValueError::Form);
    }
    let mut part: u32 = read_number(decimals, 0, 9999)?;
    let whole: u32 = read_number(whole, 0, u32::MAX)?;
    for _ in decimals.len()..most_decimals {
        part = part.saturating_mul(10);
    }
    // Below 2^32 times 10^4: far below 2^63.
    let size = i64::from(whole).saturating_mul(scale);
    let size = size.saturating_add(part.into());
    let sign = if unsigned.len() < word.len() { -1 } else { 1 };
    let tenths = size.saturating_mul(sign);
    let [least, most] = [least, most].map(|um| i64::from(um).saturating_mul(10));
    if tenths < least || tenths > most {
        return Err(ValueError::Range);
    }
    // The nearest step: at most 2^31 times 10 times 2^8.
    let steps = (size.saturating_mul(1 << Micrometres::FRACTION)).saturating_add(5) / 10;
    let bits = i32::try_from(steps.saturating_mul(sign)).map_err(|_| ValueError::Range)?;
    Ok(Micrometres::from_bits(bits))
}

/// Writes lengths and their unit. Without `units`: in micrometres that are not named, as flash holds them.
///
/// # Errors
/// The formatter's.
pub fn write_lengths(
    f: &mut fmt::Formatter<'_>,
    lengths: &[Micrometres],
    units: Option<Units>,
) -> fmt::Result {
    let mut blank = "";
    for length in lengths {
        let bits = i64::from(length.to_bits());
        // |bits| <= 2^31, so ten times that fits. Half a step rounds.
        let half = 1 << (Micrometres::FRACTION - 1);
        let tenths = bits.abs().saturating_mul(10).saturating_add(half) >> Micrometres::FRACTION;
        let sign = if bits < 0 && tenths > 0 { "-" } else { "" };
        // The part after the point in ten-thousandths.
        let (whole, mut part) = match units {
            Some(Units::Millimetres) => (tenths / 10_000, tenths % 10_000),
            Some(Units::Micrometres) | None => (tenths / 10, tenths % 10 * 1000),
        };
        write!(f, "{blank}{sign}{whole}")?;
        let mut point = ".";
        while part > 0 {
            part *= 10;
            write!(f, "{point}{}", part / 10_000)?;
            part %= 10_000;
            point = "";
        }
        blank = " ";
    }
    units.map_or(Ok(()), |units| write!(f, " {}", units.name()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_read_in_either_unit_and_written_as_it_is_read() {
        const MOST: i32 = 4_000_000;
        let wrong = || Err(ValueError::Form);
        let beyond = || Err(ValueError::Range);
        let ends = |um, text| Ok((um * 256, text));
        for (word, mm, um) in [
            ("500.000", Ok((500_000 * 256, "500 mm")), wrong()),
            ("-0.5", Ok((-500 * 256, "-0.5 mm")), Ok((-128, "-0.5 um"))),
            ("-0.25", Ok((-250 * 256, "-0.25 mm")), wrong()),
            // A tenth of a micrometre is 25.6 steps.
            ("0.0001", Ok((26, "0.0001 mm")), wrong()),
            ("-0.0001", Ok((-26, "-0.0001 mm")), wrong()),
            ("0.1", Ok((100 * 256, "0.1 mm")), Ok((26, "0.1 um"))),
            ("0", Ok((0, "0 mm")), Ok((0, "0 um"))),
            ("-0", Ok((0, "0 mm")), Ok((0, "0 um"))),
            ("007", Ok((7_000 * 256, "7 mm")), Ok((7 * 256, "7 um"))),
            ("4000", ends(MOST, "4000 mm"), ends(4000, "4000 um")),
            ("-4000", ends(-MOST, "-4000 mm"), ends(-4000, "-4000 um")),
            ("4000.0001", beyond(), wrong()),
            ("4000000", beyond(), Ok((MOST * 256, "4000000 um"))),
            ("4000000.1", beyond(), beyond()),
            ("99999999999999999999999999", beyond(), beyond()),
            ("-99999999999999999999999999.9", beyond(), beyond()),
        ] {
            for (units, expected) in [(Units::Millimetres, mm), (Units::Micrometres, um)] {
                let found = read_length(word, units, -MOST, MOST);
                let bits = expected.map(|(bits, _)| Micrometres::from_bits(bits));
                assert_eq!(found, bits, "{word}");
                if let (Ok(length), Ok((_, text))) = (found, expected) {
                    let written = fmt::from_fn(|f| write_lengths(f, &[length], Some(units)));
                    assert_eq!(written.to_string(), text);
                    let stored = fmt::from_fn(|f| write_lengths(f, &[length], None)).to_string();
                    assert_eq!(read_length(&stored, Units::Micrometres, -MOST, MOST), found);
                }
            }
        }
        for word in " - . 1. .5 +1 --1 1e3 1,5 1.00000 1.-5 off".split(' ') {
            let found = read_length(word, Units::Millimetres, -MOST, MOST);
            assert_eq!(found, Err(ValueError::Form), "{word}");
        }
    }
}
