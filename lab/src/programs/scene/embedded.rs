//! A grey image within an SVG file, as PNG.

use std::ops::Range;

use anyhow::{Context as _, Result, ensure};
use base64::Engine as _;
use figures::axes::FINE;

/// The columns and the rows of an image in a figure, in pixels.
pub type Place = (Range<i32>, Range<i32>);

/// Pixels, row by row from the top, 0 is black.
pub struct Grey {
    pub width: usize,
    pub pixels: Vec<u8>,
}

impl Grey {
    /// Adds the image to a figure of [`figures::axes::figure`], over these of its pixels.
    pub fn place(&self, svg: &mut String, (columns, rows): Place) -> Result<()> {
        let end = svg.rfind("</svg>").context("no end of the SVG file")?;
        // Some viewers blur what they enlarge, so that is done here.
        let larger = self.repeated(
            columns.len().div_ceil(self.width.max(1)),
            rows.len().div_ceil(self.height().max(1)),
        );
        let data = base64::engine::general_purpose::STANDARD.encode(larger.png()?);
        let image = format!(
            "<image transform=\"scale({FINE})\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" \
             preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{data}\"/>\n",
            columns.start,
            rows.start,
            columns.len(),
            rows.len()
        );
        svg.insert_str(end, &image);
        Ok(())
    }

    fn height(&self) -> usize {
        self.pixels.len() / self.width.max(1)
    }

    /// Each pixel so many times along the rows, and so many times across.
    fn repeated(&self, along: usize, across: usize) -> Self {
        let rows = self.pixels.chunks(self.width.max(1));
        Self {
            width: self.width * along,
            pixels: rows
                .flat_map(|row| std::iter::repeat_n(row, across))
                .flatten()
                .flat_map(|&grey| std::iter::repeat_n(grey, along))
                .collect(),
        }
    }

    fn png(&self) -> Result<Vec<u8>> {
        let (width, height, count) = (self.width, self.height(), self.pixels.len());
        let is_whole = height > 0 && height * width == count;
        ensure!(is_whole, "{count} pixels are no rows of {width}");
        let mut bytes = vec![];
        let mut encoder = png::Encoder::new(&mut bytes, width.try_into()?, height.try_into()?);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.pixels)?;
        writer.finish()?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pixel_fills_its_part_of_the_place() {
        let image = Grey {
            width: 2,
            pixels: vec![0, 255, 100, 7],
        };
        let mut svg = "<svg></svg>".to_owned();
        image.place(&mut svg, (10..14, 5..8)).expect("an image");
        println!("{svg}");
        assert!(svg.contains("x=\"10\" y=\"5\" width=\"4\" height=\"3\""));
        let data = (svg.split("base64,").nth(1)).and_then(|rest| rest.split('"').next());
        let bytes = base64::engine::general_purpose::STANDARD
            .decode(data.expect("data"))
            .expect("base64");
        let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        let mut reader = decoder.read_info().expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("small")];
        let frame = reader.next_frame(&mut pixels).expect("pixels");
        // Twice along the row, and, as 3 rows are to show 2, twice across.
        assert_eq!((frame.width, frame.height), (4, 4));
        let (above, below) = ([0, 0, 255, 255], [100, 100, 7, 7]);
        assert_eq!(pixels, [above, above, below, below].concat());
    }
}
