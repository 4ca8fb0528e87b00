//! Photographs as binary PGM files, for rows that no simulation made.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use slitrange::row::sensor_heads;

/// A grey-scale picture, read from a binary PGM (`P5`, <https://netpbm.sourceforge.net/doc/pgm.html>).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photograph {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The value of a white pixel (the file's `maxval`).
    pub white: u16,
    pixels: Vec<u16>,
}

impl Photograph {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// The file cannot be read, or what [`Photograph::parse`] refuses.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = std::fs::read(path)
            .with_context(|| format!("reading the photograph {}", path.display()))?;
        Self::parse(&bytes).with_context(|| format!("in the photograph {}", path.display()))
    }

    /// Reads the first picture in `file`.
    ///
    /// # Errors
    /// It is no binary PGM, a number of its header is missing or out of range, it ends too early, or a pixel
    /// is brighter than the header allows.
    pub fn parse(file: &[u8]) -> Result<Self> {
        let mut rest = file.strip_prefix(b"P5").with_context(|| {
            let start = String::from_utf8_lossy(&file[..file.len().min(2)]);
            format!(
                "it begins with {start:?} and a binary PGM with \"P5\": convert it with \
                 `magick in.png out.pgm`"
            )
        })?;
        let width = header_number(&mut rest, "width")?;
        let height = header_number(&mut rest, "height")?;
        let white = header_number(&mut rest, "greatest value")?;
        ensure!(
            width > 0 && height > 0,
            "its size is {width} x {height}: it has no pixels"
        );
        let white = u16::try_from(white).ok().filter(|&white| white > 0);
        let white = white.context("its greatest value is not within 1..=65535")?;
        // One white-space character ends the header; what follows it is a pixel, whatever it looks like.
        let [separator, rest @ ..] = rest else {
            bail!("it ends after its header")
        };
        ensure!(
            separator.is_ascii_whitespace(),
            "its header does not end with white space but with {separator:#04x}"
        );
        let bytes_each = if white > 255 { 2 } else { 1 };
        let count = width.checked_mul(height).context("its size overflows")?;
        let wanted = count.checked_mul(bytes_each);
        let wanted = wanted.context("its size overflows")?;
        let raster = rest.get(..wanted).with_context(|| {
            format!(
                "{width} x {height} pixels of {bytes_each} bytes are {wanted} bytes, and it has {}",
                rest.len()
            )
        })?;
        let (pairs, _) = raster.as_chunks();
        let pixels: Vec<u16> = match bytes_each {
            1 => raster.iter().copied().map(u16::from).collect(),
            _ => pairs.iter().copied().map(u16::from_be_bytes).collect(),
        };
        if let Some(at) = pixels.iter().position(|&pixel| pixel > white) {
            let (x, y) = (at % width, at / width);
            bail!(
                "pixel ({x}, {y}) is {}, and its header says none exceeds {white}",
                pixels[at]
            );
        }
        Ok(Self {
            width,
            height,
            white,
            pixels,
        })
    }

    /// Row `y` from the top, `None` below the last.
    pub fn row(&self, y: usize) -> Option<&[u16]> {
        self.pixels.chunks_exact(self.width).nth(y)
    }

    /// The rows from the top, each [`Photograph::width`] pixels long.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[u16]> {
        self.pixels.chunks_exact(self.width)
    }

    /// Row `y` as the TCD1304DG sees it, in counts before rounding: white is full scale, and the picture is
    /// in the middle of the light range. Beside it go on the noise and the level of its outermost 32 pixels.
    /// A picture wider than the light range loses its sides.
    ///
    /// Gives the light range, and the pixel on which the picture begins (negative where its side is lost).
    pub fn on_sensor(&self, y: usize) -> Option<(Vec<f32>, i64)> {
        const BORDER: usize = 32;
        let row = self.row(y)?;
        let head = sensor_heads::tcd1304dg();
        let pixels = head.light.len() as i64;
        let first = (pixels - row.len() as i64) / 2;
        let full_scale = f32::from(head.full_scale());
        let counts = |x: usize| f32::from(row[x]) / f32::from(self.white) * full_scale;
        let border = BORDER.min(row.len());
        let light = (0..pixels)
            .map(|pixel| match usize::try_from(pixel - first) {
                Ok(x) if x < row.len() => counts(x),
                Ok(x) => counts(row.len() - 1 - (x - row.len()) % border),
                Err(_) => counts((first - pixel - 1) as usize % border),
            })
            .collect();
        Some((light, first))
    }
}

/// The next decimal number of a header, behind white space and comments (`#` to the end of its line).
fn header_number(rest: &mut &[u8], what: &str) -> Result<usize> {
    loop {
        match rest {
            [b'#', ..] => {
                let end = rest.iter().position(|byte| b"\n\r".contains(byte));
                *rest = &rest[end.unwrap_or(rest.len())..];
            }
            [first, tail @ ..] if first.is_ascii_whitespace() => *rest = tail,
            _ => break,
        }
    }
    let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let (number, tail) = rest.split_at(digits);
    *rest = tail;
    let number = std::str::from_utf8(number).unwrap_or_default();
    number
        .parse()
        .with_context(|| format!("its header has no {what} where it belongs (found {number:?})"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_the_sensor_a_picture_is_in_the_middle_and_its_borders_go_on() {
        let pixels: Vec<u8> = (0..100).collect();
        let file = [b"P5 100 1 255\n".as_slice(), &pixels].concat();
        let picture = Photograph::parse(&file).expect("a picture");
        let (light, first) = picture.on_sensor(0).expect("a row");
        assert_eq!((light.len(), first), (3648, 1774));
        let counts = |value: u8| f32::from(value) / 255.0 * 4095.0;
        let at = |pixel: usize| light[pixel];
        assert_eq!([at(1774), at(1823), at(1873)], [0, 49, 99].map(counts));
        let [before, after] = [[1773, 1772, 1742, 1741], [1874, 1875, 1905, 1906]];
        assert_eq!(before.map(at), [0, 1, 31, 0].map(counts));
        assert_eq!(after.map(at), [99, 98, 68, 99].map(counts));
    }

    fn refusal(file: &[u8]) -> String {
        format!("{:#}", Photograph::parse(file).unwrap_err())
    }

    #[test]
    fn eight_bits_with_comments() {
        let picture =
            Photograph::parse(b"P5 # made by hand\n3 2\n# rows\n200\n\x01\x02\x03 \n\xc8").unwrap();
        assert_eq!((picture.width, picture.height, picture.white), (3, 2, 200));
        let rows: Vec<_> = picture.rows().collect();
        // White space in the raster is pixels.
        assert_eq!(rows, [[1, 2, 3], [32, 10, 200]]);
        assert_eq!((picture.row(1), picture.row(2)), (Some(rows[1]), None));
    }

    #[test]
    fn sixteen_bits_are_big_endian() {
        let picture = Photograph::parse(b"P5\n2 1\n4095\n\x0f\xff\x01\x00 and more").unwrap();
        assert_eq!(picture.row(0), Some(&[4095, 256][..]));
        assert_eq!(picture.white, 4095);
    }

    #[test]
    fn what_is_wrong_is_said_in_words() {
        assert!(refusal(b"P2\n1 1\n1\n1").contains("begins with \"P2\""));
        assert!(refusal(b"").contains("begins with \"\""));
        assert!(refusal(b"P5\n1 x").contains("no height"));
        assert!(refusal(b"P5\n0 4 255\n").contains("no pixels"));
        assert!(refusal(b"P5\n1 1 65536\n\0\0").contains("1..=65535"));
        assert!(refusal(b"P5\n1 1 0\n\0").contains("1..=65535"));
        assert!(refusal(b"P5\n1 1 255").contains("ends after its header"));
        assert!(refusal(b"P5\n2 2 255\nabc").contains("are 4 bytes, and it has 3"));
        assert!(refusal(b"P5\n2 1 100\nde").contains("pixel (1, 0) is 101"));
        assert!(refusal(b"P5\n1 1 255x\0").contains("0x78"));
        assert!(refusal(b"P5 99999999999 99999999999 255\n").contains("overflows"));
    }
}
