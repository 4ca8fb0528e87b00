//! The command `row`, which sends one row as the sensor sees it, and its answer.
//!
//! ```text
//! row pixels 3648 first 1719 count 104
//! x 1770.97691 u 0.01601 a 1947 n 1/1 b 301 e a w 8.60011 o ...
//! row 1719 12c12d12a12f12c12b... 7f3a
//! row 1751 ...
//! row end
//! ```
//!
//! The second line is the answer to `centre` for a frame of this row alone. A comb has a line more, and so
//! has a fault. Each of the lines that follow has the place of its first pixel, and up to [`PIXELS_A_LINE`]
//! counts of three hexadecimal digits. Last comes a CRC-16 (IBM-3740) of all characters before the line's
//! last blank.

use core::fmt::{self, Write as _};
use core::ops::Range;

use heapless::Vec;

use crate::fault::Fault;
use crate::protocol::piece::CRC;
use crate::reading::Measured;
use crate::row::{LARGEST_COUNT, Light};
use crate::settings::split_words;
use crate::text::Text;
use crate::units::Pixels;

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
}

impl RowPart {
    /// What may follow `row`.
    pub const FORM: &str = "row [window]";

    /// Reads what follows `row`.
    pub fn parse(values: &[&str]) -> Option<Self> {
        match *values {
            [] => Some(Self::Whole),
            ["window"] => Some(Self::Window),
            _ => None,
        }
    }
}

impl fmt::Display for RowPart {
    /// The line that is read as this command.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Whole => "row",
            Self::Window => "row window",
        })
    }
}

/// The pixels around a spot, or around all images of a comb.
fn window(measured: &Measured) -> Range<usize> {
    let frame = &measured.frame;
    let mut ends = (frame.centre, frame.centre);
    if let Some(comb) = &measured.comb {
        let centres = || comb.centres.iter().flatten().map(|slit| slit.centre);
        let least = centres().min().unwrap_or(frame.centre);
        let most = centres().max().unwrap_or(frame.centre);
        ends = (least, most);
    }
    let reach = frame.width.to_bits().max(0).saturating_mul(REACH.into());
    let pixel = |bits: i32| (bits.max(0) >> Pixels::FRACTION) as usize;
    let first = pixel(ends.0.to_bits().saturating_sub(reach));
    let last = pixel(ends.1.to_bits().saturating_add(reach));
    first..last.saturating_add(1)
}

/// The first lines of the answer: how many pixels the row has, which of them follow, and what the firmware
/// makes of the row.
#[derive(Clone, Debug)]
pub struct RowHead<'a> {
    pixels: usize,
    sent: Range<usize>,
    measured: &'a Result<Measured, Fault>,
}

impl<'a> RowHead<'a> {
    /// The head of a part of a row with so many pixels. `measured` is a frame of this row alone.
    pub fn new(part: RowPart, pixels: usize, measured: &'a Result<Measured, Fault>) -> Self {
        let sent = match (part, measured) {
            (RowPart::Whole, _) => 0..pixels,
            (RowPart::Window, Ok(measured)) => window(measured),
            (RowPart::Window, Err(_)) => 0..0,
        };
        Self {
            pixels,
            sent: sent.start.min(pixels)..sent.end.min(pixels),
            measured,
        }
    }

    /// The pixels that are sent.
    pub fn sent(&self) -> Range<usize> {
        self.sent.clone()
    }
}

impl fmt::Display for RowHead<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, count) = (self.sent.start, self.sent.len());
        write!(
            f,
            "row pixels {} first {first} count {count}\r\n",
            self.pixels
        )?;
        match self.measured {
            Ok(measured) => measured.fmt(f),
            Err(fault) => write!(f, "{fault}\r\n({})", fault.advice()),
        }
    }
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
                // A row has at most 2^12 pixels.
                let first = first as u16;
                Self { first, counts }
            })
    }

    /// Reads a line. `None` if it is no line of pixels, or not the one that was sent.
    pub fn parse(line: &str) -> Option<Self> {
        let words = split_words(line);
        let &["row", first, digits, checksum] = words.as_slice() else {
            return None;
        };
        // A blank and four digits end the line.
        let sent = line.get(..line.len().checked_sub(5)?)?;
        if u16::from_str_radix(checksum, 16).ok()? != CRC.checksum(sent.as_bytes()) {
            return None;
        }
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

    #[test]
    fn lines_are_read_as_they_are_written_and_checked() {
        let counts: std::vec::Vec<u16> = (0..70).map(|pixel| pixel * 58).collect();
        let lines: std::vec::Vec<RowPixels> =
            RowPixels::lines(counts.as_slice().into(), 3..70).collect();
        let (first, sizes): (std::vec::Vec<u16>, std::vec::Vec<usize>) = lines
            .iter()
            .map(|line| (line.first, line.counts.len()))
            .unzip();
        assert_eq!((first, sizes), (vec![3, 35, 67], vec![32, 32, 3]));
        for line in &lines {
            let text = line.to_string();
            assert_eq!(RowPixels::parse(&text).as_ref(), Some(line));
            // Any other character is found.
            for place in 0..text.len() {
                let mut other = text.clone().into_bytes();
                other[place] ^= 1;
                let other = String::from_utf8(other).expect("ASCII");
                assert_eq!(RowPixels::parse(&other), None, "{other}");
            }
        }
        // Python: binascii.crc_hqx(b"row 67 f2ef68fa2", 0xffff).
        assert_eq!(lines[2].to_string(), "row 67 f2ef68fa2 a759");
        for line in ["row end", "row pixels 3648 first 0 count 3648", "", "row"] {
            assert_eq!(RowPixels::parse(line), None);
        }
    }
}
