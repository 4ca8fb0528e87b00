//! The lines that a sensor sends on its own: readings and faults.

use serde::{Deserialize, Serialize};

/// What a frame gave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A distance from the laser.
    #[default]
    Reading,
    /// A distance relative to `zero`.
    Difference,
    /// A fault, and the distance of an earlier reading in its place: the setting `hold`.
    Held,
    /// No distance.
    Fault,
    /// From here on the sensor was away.
    Gap,
}

/// What a frame gave, and a line of the file of `monitor --csv`. What the sensor did not send is empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameResult {
    /// Seconds since `monitor` began, by the PC's clock.
    pub time_s: f64,
    /// When it came, in Coordinated Universal Time by the PC's clock: `2026-11-29T09:12:33.123Z`.
    #[serde(default)]
    pub utc: String,
    /// What the result is.
    pub kind: Kind,
    /// The number of the result since the sensor started.
    pub number: Option<u32>,
    /// The time of the result since the sensor started, in microseconds.
    pub sensor_us: Option<u64>,
    /// The distance in millimetres.
    pub distance_mm: Option<f64>,
    /// Its combined standard uncertainty in millimetres.
    pub u_mm: Option<f64>,
    /// Its repeatability in millimetres.
    pub r_mm: Option<f64>,
    /// The spot's centre in pixels.
    pub centre_px: Option<f64>,
    /// The spot's height in counts.
    pub height_counts: Option<f64>,
    /// The spot's width in pixels.
    pub width_px: Option<f64>,
    /// The rows used.
    pub rows_used: Option<u16>,
    /// The rows in the frame.
    pub rows: Option<u16>,
    /// The mean exposure of the rows used, in microseconds. The sensor's line leaves the longest one out.
    pub exposure_us: Option<u16>,
    /// The slits used of a comb.
    pub slits: Option<u8>,
    /// The flags, as the line has them: `m 3 g`.
    pub flags: String,
    /// The fault in the sensor's own words, `too dim: 35.2 counts, needs 60.1`, or why the sensor was away.
    pub fault: String,
    /// Whether the distance is relative to that of `zero`, also if it is held.
    #[serde(skip)]
    pub is_difference: bool,
}

/// Reads a line of the stream. A letter that is not known counts as a flag. `None` if the line is another
/// one, if a number is not one, or if the line has a fault or the unit but no distance.
pub fn frame_result(line: &str) -> Option<FrameResult> {
    let mut words: Vec<&str> = line.split(' ').collect();
    let number = prefix(&mut words, "#")?;
    let mut result = FrameResult {
        number: number.map(u32::try_from).transpose().ok()?,
        sensor_us: prefix(&mut words, "@")?,
        ..FrameResult::default()
    };
    match words.split_first()? {
        (&"f", fault) if !fault.is_empty() => {
            (result.kind, result.fault) = (Kind::Fault, fault.join(" "));
        }
        (&letter @ ("d" | "z"), rest) => {
            result.is_difference = letter == "z";
            result.read(rest)?;
        }
        _ => return None,
    }
    Some(result)
}

/// Takes a mark and its number off the front of a line. `None` if what follows the mark is no number.
fn prefix(words: &mut Vec<&str>, mark: &str) -> Option<Option<u64>> {
    if words.first() != Some(&mark) {
        return Some(None);
    }
    let number = words.get(1)?.parse().ok()?;
    words.drain(..2);
    Some(Some(number))
}

impl FrameResult {
    /// Reads the words after `d` or `z`.
    fn read(&mut self, words: &[&str]) -> Option<()> {
        let &[distance, unit, ref columns @ ..] = words else {
            return None;
        };
        let per_mm = match unit {
            "mm" => 1.0,
            "um" => 1e3,
            _ => return None,
        };
        self.distance_mm = Some(number(distance)? / per_mm);
        let mut flags = vec![];
        let mut columns = columns.iter().copied();
        while let Some(letter) = columns.next() {
            match letter {
                "u" => self.u_mm = Some(number(columns.next()?)? / per_mm),
                "r" => self.r_mm = Some(number(columns.next()?)? / per_mm),
                "x" => self.centre_px = Some(number(columns.next()?)?),
                "a" => self.height_counts = Some(number(columns.next()?)?),
                "w" => self.width_px = Some(number(columns.next()?)?),
                "t" => self.exposure_us = Some(columns.next()?.parse().ok()?),
                "k" => self.slits = Some(columns.next()?.parse().ok()?),
                "n" => {
                    let (used, all) = columns.next()?.split_once('/')?;
                    self.rows_used = Some(used.parse().ok()?);
                    self.rows = Some(all.parse().ok()?);
                }
                // A flag, or the number that belongs to one.
                _ => flags.push(letter),
            }
        }
        self.kind = match self.is_difference {
            _ if flags.contains(&"h") => Kind::Held,
            true => Kind::Difference,
            false => Kind::Reading,
        };
        self.flags = flags.join(" ");
        Some(())
    }
}

/// A decimal number, as the sensor sends it: digits, one point at most, a minus in front at most.
fn number(word: &str) -> Option<f64> {
    let digits = word.strip_prefix('-').unwrap_or(word);
    let is_part = |byte| matches!(byte, b'0'..=b'9' | b'.');
    let is_decimal = digits.bytes().all(is_part);
    is_decimal.then(|| word.parse().ok())?
}

/// The kind of a fault: its words up to the numbers.
pub fn fault_kind(fault: &str) -> &str {
    fault.split_once(':').map_or(fault, |(kind, _)| kind)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_reading_has_all_its_columns() {
        let line = "# 1234 @ 12345678 d 800.1234 mm u 0.4372 r 0.0035 x 1770.1234 a 1011 n 15/16 w 7.62131 \
                    t 187 k 16 m 3 c 2 h 2 g s";
        let reading = FrameResult {
            kind: Kind::Held,
            number: Some(1234),
            sensor_us: Some(12_345_678),
            distance_mm: Some(800.1234),
            u_mm: Some(0.4372),
            r_mm: Some(0.0035),
            centre_px: Some(1770.1234),
            height_counts: Some(1011.0),
            width_px: Some(7.62131),
            rows_used: Some(15),
            rows: Some(16),
            exposure_us: Some(187),
            slits: Some(16),
            flags: "m 3 c 2 h 2 g s".to_owned(),
            ..FrameResult::default()
        };
        assert_eq!(frame_result(line), Some(reading));
    }

    #[test]
    fn columns_may_be_missing_and_the_unit_may_be_um() {
        let read = |line| frame_result(line).expect("a result");
        let short = read("z -0.0010 mm");
        assert_eq!(short.kind, Kind::Difference);
        assert_eq!((short.distance_mm, short.u_mm), (Some(-0.001), None));
        let um = read("d 800123.4 um u 437.2 r 3.5 q 7");
        for (found, expected) in [
            (um.distance_mm, 800.1234),
            (um.u_mm, 0.4372),
            (um.r_mm, 0.0035),
        ] {
            let found = found.expect("a number");
            assert!((found - expected).abs() < 1e-9, "{found}");
        }
        assert_eq!(um.flags, "q 7");
        let fault = read("# 7 f too dim: 35.2 counts, needs 60.1");
        assert_eq!((fault.number, fault.kind), (Some(7), Kind::Fault));
        assert_eq!(fault.fault, "too dim: 35.2 counts, needs 60.1");
        assert_eq!(fault_kind("too dim: 35.2 counts, needs 60.1"), "too dim");
        assert_eq!(fault_kind("laser off"), "laser off");
    }

    #[test]
    fn other_lines_are_no_results() {
        let lines = "; d; d mm u 0.4372; d 800.1234 m u 0.4372; d NaN mm; d inf mm; d 800.1234 mm u; \
                     d 800.1234 mm n 16; # d 800.1234 mm; # 5000000000 d 800.1234 mm; f; \
                     x 1770.98771 u 0.00195 a 1993 n 16/16 b 300 e t; status rows read 10700";
        for line in lines.split("; ") {
            assert_eq!(frame_result(line), None, "{line}");
        }
    }

    proptest! {
        #[test]
        fn a_distance_is_finite(
            line in "(# [0-9]{1,9} )?[dz] [-0-9.eInaf]{1,12} mm( [a-z] [0-9./]{1,8}){0,4}",
        ) {
            if let Some(mm) = frame_result(&line).and_then(|result| result.distance_mm) {
                prop_assert!(mm.is_finite());
            }
        }
    }
}
