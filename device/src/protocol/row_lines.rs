//! The command `row`, which sends one row as the sensor sees it, and its answer: a head with a CRC-16
//! (IBM-3740) of its lines, joined by LF, then lines of up to [`PIXELS_A_LINE`] counts with a CRC-16 each.
//! docs/serial-line.md shows an answer, and says what its words mean.
//!
//! The answer is complete with its last pixel, or with `row check` if no pixel follows.

use core::fmt::{self, Write as _};
use core::ops::Range;

use crc::CRC_16_IBM_3740;
use heapless::Vec;

use crate::protocol::advice::advice;
use crate::protocol::command::Command;
use crate::protocol::line::{CentreLine, FaultLine};
use crate::protocol::piece::CRC;
use crate::settings::{ValueError, read_number, split_words};
use crate::text::Text;
use slitrange::base::exposure::Exposure;
use slitrange::light::black_level;
use slitrange::row::{LARGEST_COUNT, Light, Row};
use slitrange::spot::region::Region;
use slitrange::{Counts, Fault, Measured, Pixels};

/// The most pixels in a line.
pub const PIXELS_A_LINE: usize = 32;

/// A window reaches so many widths to both sides of a spot's centre: as far as the check's pairs of pixels.
pub const REACH: u8 = 6;

/// Which pixels of a row are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowPart {
    /// All that see light.
    Whole,
    /// Those around the spot, or from the first image of a comb to the last one. None if the row has a fault.
    Window,
    /// Those from one place to another, both included, whatever the row shows. Places off the row are left
    /// out.
    Range {
        /// The first place.
        first: u16,
        /// The last place, not below the first.
        last: u16,
    },
}

impl RowPart {
    /// What may follow `row`.
    pub const FORM: &str = "row [window|FIRST LAST]";

    /// Reads the two places that may follow `row`.
    ///
    /// # Errors
    /// [`ValueError::Range`] where a place is above 65535 or the first place is above the last one,
    /// [`ValueError::Form`] for any other words.
    pub fn parse(values: &[&str]) -> Result<Self, ValueError> {
        let &[first, last] = values else {
            return Err(ValueError::Form);
        };
        let place = |word| read_number(word, 0, u16::MAX.into());
        // A word that is no number counts more than a number that is too large.
        match (place(first), place(last)) {
            (Err(ValueError::Form), _) | (_, Err(ValueError::Form)) => Err(ValueError::Form),
            (Ok(first), Ok(last)) if first <= last => Ok(Self::Range { first, last }),
            _ => Err(ValueError::Range),
        }
    }
}

impl fmt::Display for RowPart {
    /// The line that is read as this command.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Command::Row(*self).fmt(f)
    }
}

/// For how long the laser was on in a row. `Display` is the word in the answer to `row`: microseconds, 0 if
/// the laser was off, or `-`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowExposure {
    /// Nobody knows, or no row came.
    Unknown,
    /// The laser was off.
    Off,
    /// The laser was on for so long.
    On(Exposure),
}

impl RowExposure {
    /// The exposure of a row whose light is known. `None` if the laser was off.
    pub fn of_laser(exposure: Option<Exposure>) -> Self {
        exposure.map_or(Self::Off, Self::On)
    }

    /// Reads the word.
    pub fn parse(word: &str) -> Option<Self> {
        match word {
            "-" => Some(Self::Unknown),
            "0" => Some(Self::Off),
            us => Exposure::from_us(us.parse().ok()?).map(Self::On),
        }
    }
}

impl fmt::Display for RowExposure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("-"),
            Self::Off => f.write_str("0"),
            Self::On(exposure) => write!(f, "{}", exposure.us()),
        }
    }
}

/// The pixels around a spot, or around all images of a comb.
pub(super) fn window(measured: &Measured) -> Range<usize> {
    let frame = &measured.frame;
    let mut ends = (frame.centre, frame.centre);
    if let Some(comb) = &measured.comb {
        let centres = || comb.centres.iter().flatten().map(|slit| slit.centre);
        let least = centres().min().unwrap_or(frame.centre);
        ends = (least, centres().max().unwrap_or(frame.centre));
    }
    let reach = frame.width.to_bits().max(0).saturating_mul(REACH.into());
    let pixel = |bits: i32| usize::try_from(bits >> Pixels::FRACTION).unwrap_or_default();
    let first = pixel(ends.0.to_bits().saturating_sub(reach));
    first..pixel(ends.1.to_bits().saturating_add(reach)).saturating_add(1)
}

/// The first lines of the answer: the row's size, which pixels follow, the light it had, what the firmware
/// makes of it, and the checksum of all this.
#[derive(Clone, Debug)]
pub struct RowHead<'a> {
    pixels: usize,
    sent: Range<usize>,
    exposure: RowExposure,
    /// The mean of the shielded pixels. `None` if there are none.
    black: Option<Counts>,
    saturated_from: u16,
    measured: &'a Result<Measured, Fault>,
    /// Where the spot was searched.
    region: Region,
}

impl<'a> RowHead<'a> {
    /// The head of a part of a row. `measured` is a frame of this row alone.
    pub fn new(
        part: RowPart,
        row: &Row<'_>,
        exposure: RowExposure,
        measured: &'a Result<Measured, Fault>,
        region: Region,
    ) -> Self {
        let pixels = row.light().len();
        let sent = match (part, measured) {
            (RowPart::Whole, _) => 0..pixels,
            (RowPart::Window, Ok(measured)) => window(measured),
            (RowPart::Window, Err(_)) => 0..0,
            (RowPart::Range { first, last }, _) => {
                first.into()..usize::from(last).saturating_add(1)
            }
        };
        Self {
            pixels,
            sent: sent.start.min(pixels)..sent.end.min(pixels),
            exposure,
            black: black_level::of_shielded(row),
            saturated_from: row.saturated_from(),
            measured,
            region,
        }
    }

    /// The pixels that are sent.
    pub fn sent(&self) -> Range<usize> {
        self.sent.clone()
    }

    /// Writes the lines before the checksum, with CR LF between them.
    fn write_lines(&self, to: &mut dyn fmt::Write) -> fmt::Result {
        let (pixels, first, count) = (self.pixels, self.sent.start, self.sent.len());
        write!(to, "row pixels {pixels} first {first} count {count} ")?;
        write!(to, "exposure {} black ", self.exposure)?;
        match self.black {
            Some(black) => write!(to, "{black:.2}")?,
            None => to.write_str("-")?,
        }
        write!(to, " saturated {}\r\n", self.saturated_from)?;
        match self.measured {
            Ok(measured) => write!(to, "{}", CentreLine(measured)),
            Err(fault) => {
                let line = FaultLine(fault, self.region);
                write!(to, "{line}\r\n({})", advice(fault))
            }
        }
    }
}

impl fmt::Display for RowHead<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_lines(f)?;
        let mut check = HeadCheck::EMPTY;
        self.write_lines(&mut check)?;
        write!(f, "\r\n{check}")
    }
}

/// The line `row check 1a2b`: the CRC-16 of the head's lines before it. Each line counts without its CR LF,
/// and a single LF joins two lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeadCheck(u16);

impl HeadCheck {
    /// What the line begins with.
    pub const START: &str = "row check ";

    const EMPTY: Self = Self(CRC_16_IBM_3740.init);

    /// The check of lines without their ends.
    pub fn of<'a>(lines: impl IntoIterator<Item = &'a str>) -> Self {
        let (mut check, mut join) = (Self::EMPTY, &b""[..]);
        for line in lines {
            check.add(join);
            check.add(line.as_bytes());
            join = b"\n";
        }
        check
    }

    fn add(&mut self, bytes: &[u8]) {
        // The state of this CRC is its result. A digest that is kept from call to call hides the CRC's width
        // from the compiler, which then cannot exclude an overflow.
        let mut digest = CRC.digest_with_initial(self.0);
        digest.update(bytes);
        self.0 = digest.finalize();
    }

    /// Reads the line. `None` for any other line.
    pub fn parse(line: &str) -> Option<Self> {
        checksum(line.strip_prefix(Self::START)?).map(Self)
    }
}

impl fmt::Write for HeadCheck {
    /// Adds text. Its lines are joined by CR LF, and CR does not count.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes().filter(|&byte| byte != b'\r') {
            self.add(&[byte]);
        }
        Ok(())
    }
}

impl fmt::Display for HeadCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{:04x}", Self::START, self.0)
    }
}

/// Reads a checksum as it is written: four digits, letters in lower case. Any other text is not the one that
/// was sent.
fn checksum(digits: &str) -> Option<u16> {
    let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
    let is_written = digits.len() == 4 && digits.bytes().all(is_digit);
    is_written.then(|| u16::from_str_radix(digits, 16).ok())?
}

/// The last line of the answer.
pub const ROW_END: &str = "row end";

/// A line of pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RowPixels {
    /// The place of the first one, from 0.
    pub first: u16,
    /// Their counts, light positive.
    pub counts: Vec<u16, PIXELS_A_LINE>,
}

impl RowPixels {
    /// The lines of some pixels of a row.
    pub fn lines(light: Light<'_>, pixels: Range<usize>) -> impl Iterator<Item = Self> {
        let end = pixels.end.min(light.len());
        (pixels.start..end)
            .step_by(PIXELS_A_LINE)
            .map(move |first| {
                let pixels = first..first.saturating_add(PIXELS_A_LINE).min(end);
                let mut counts = Vec::new();
                for count in light.slice(pixels).unwrap_or_default().iter() {
                    // There is room for the pixels of a line.
                    let _ = counts.push(count);
                }
                #[expect(clippy::cast_possible_truncation, reason = "a pixel is below 2^12")]
                let first = first as u16;
                Self { first, counts }
            })
    }

    /// Reads a line. `None` if it is no line of pixels, or not the one that was sent.
    pub fn parse(line: &str) -> Option<Self> {
        // A blank and four digits end the line.
        let (sent, end) = line.split_at_checked(line.len().checked_sub(5)?)?;
        if checksum(end.strip_prefix(' ')?)? != CRC.checksum(sent.as_bytes()) {
            return None;
        }
        let &["row", first, digits] = split_words(sent).as_slice() else {
            return None;
        };
        let (groups, rest) = digits.as_bytes().as_chunks::<3>();
        let mut counts = Vec::new();
        for group in groups {
            let digits = core::str::from_utf8(group).ok()?;
            counts.push(u16::from_str_radix(digits, 16).ok()?).ok()?;
        }
        let first = first.parse().ok()?;
        rest.is_empty().then_some(Self { first, counts })
    }
}

impl fmt::Display for RowPixels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // `row 65535 `, and three digits a pixel.
        let mut sent = Text::<{ 10 + 3 * PIXELS_A_LINE }>::default();
        write!(sent, "row {} ", self.first)?;
        for count in &self.counts {
            write!(sent, "{:03x}", (*count).min(LARGEST_COUNT))?;
        }
        write!(f, "{} {:04x}", sent.as_str(), CRC.checksum(sent.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use slitrange::row::{Geometry, Polarity};

    #[test]
    fn lines_are_read_as_they_are_written_and_checked() {
        let counts: std::vec::Vec<u16> = (0..70).map(|pixel| pixel * 58).collect();
        let lines = RowPixels::lines(counts.as_slice().into(), 3..70);
        let lines: std::vec::Vec<RowPixels> = lines.collect();
        let sizes = lines.iter().map(|line| (line.first, line.counts.len()));
        assert!(sizes.eq([(3, 32), (35, 32), (67, 3)]));
        for line in &lines {
            let text = line.to_string();
            assert_eq!(RowPixels::parse(&text).as_ref(), Some(line));
            // Any other character is found. Miri takes its time.
            let bytes = (0..128).step_by(if cfg!(miri) { 127 } else { 1 });
            for place in 0..text.len() {
                for byte in bytes.clone().filter(|&byte| byte != text.as_bytes()[place]) {
                    let mut other = text.clone().into_bytes();
                    other[place] = byte;
                    let other = String::from_utf8(other).expect("ASCII");
                    assert_eq!(RowPixels::parse(&other), None, "{other}");
                }
            }
        }
        // Python: binascii.crc_hqx(b"row 67 f2ef68fa2", 0xffff).
        assert_eq!(lines[2].to_string(), "row 67 f2ef68fa2 a759");
        for line in ["row end", "row pixels 3648 first 0 count 3648", "", "row"] {
            assert_eq!(RowPixels::parse(line), None);
        }
    }

    /// Four shielded pixels, and 100 that see light.
    fn geometry() -> Geometry {
        Geometry {
            words: 104,
            shielded: 0..4,
            light: 4..104,
            polarity: Polarity::Rising,
            bits: 12,
            shot_variance_per_count_q16: 0,
            saturation: 3900,
        }
    }

    const FAULT: Result<Measured, Fault> = Err(Fault::LaserOff);

    #[test]
    fn the_head_states_exposure_black_level_saturation_and_its_checksum() {
        let mut words = [300; 104];
        words[1] = 301;
        let row = geometry().row(&words).expect("a row");
        let exposure = RowExposure::of_laser(Exposure::from_us(187));
        let head = RowHead::new(RowPart::Whole, &row, exposure, &FAULT, Region::ALL).to_string();
        // Python: binascii.crc_hqx(b"row pixels ...\nf laser off\n(send `laser on`)", 0xffff).
        let lines = [
            "row pixels 100 first 0 count 100 exposure 187 black 300.25 saturated 3900",
            "f laser off",
            "(send `laser on`)",
            "row check ee10",
        ];
        assert_eq!(head, lines.join("\r\n"));
        let check = HeadCheck::of(lines[..3].iter().copied());
        assert_eq!(HeadCheck::parse(lines[3]), Some(check));
        for digits in ["check 1A2b", "check +a2b", "check 1a2", "1a2b"] {
            assert_eq!(HeadCheck::parse(&format!("row {digits}")), None, "{digits}");
        }
    }

    #[test]
    fn a_row_that_did_not_come_has_neither_pixels_nor_exposure() {
        let row = geometry().empty_row();
        for part in [RowPart::Whole, RowPart::Range { first: 3, last: 9 }] {
            let head = RowHead::new(part, &row, RowExposure::Unknown, &FAULT, Region::ALL);
            assert!(head.sent().is_empty());
            let first = "row pixels 0 first 0 count 0 exposure - black - saturated 3900\r\n";
            assert!(head.to_string().starts_with(first), "{head}");
        }
    }

    #[test]
    fn a_range_is_sent_with_a_fault_and_cut_to_the_row() {
        let row = geometry().row(&[300; 104]).expect("a row");
        for (first, last, sent) in [
            (0, 0, 0..1),
            (17, 39, 17..40),
            (99, 99, 99..100),
            (90, 100, 90..100),
            (0, u16::MAX, 0..100),
            (100, 200, 100..100),
            (u16::MAX, u16::MAX, 100..100),
        ] {
            let part = RowPart::Range { first, last };
            let head = RowHead::new(part, &row, RowExposure::Off, &FAULT, Region::ALL);
            assert_eq!(head.sent(), sent);
            let lines = RowPixels::lines(row.light(), head.sent());
            let pixels: usize = lines.map(|line| line.counts.len()).sum();
            assert_eq!(pixels, sent.len());
        }
    }

    #[test]
    fn an_exposure_is_read_as_it_is_written() {
        for exposure in [
            RowExposure::Unknown,
            RowExposure::Off,
            RowExposure::On(Exposure::SHORTEST),
            RowExposure::On(Exposure::LONGEST),
        ] {
            assert_eq!(RowExposure::parse(&exposure.to_string()), Some(exposure));
        }
        for word in ["", "9", "5601", "off", "--"] {
            assert_eq!(RowExposure::parse(word), None, "{word}");
        }
    }
}
