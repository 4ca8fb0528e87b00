//! One row as the sensor sees it: by this picture one aligns the optics.

mod figure;

use std::fmt::Write as _;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context as _, Result};
use slitrange::protocol::row::{REACH, ROW_END, RowPart, RowPixels};
use slitrange::row::LARGEST_COUNT;

use super::answers::{self, Centre, NoCentre};
use super::line::TRIES;
use super::session::Session;
use crate::fit::start::median;
use crate::pc::Pc;
use crate::whole_file;

/// How long to wait for a row: 114 lines take 1.1 s at 115,200 baud. An emulated board can be slower than the
/// clock on the wall.
const ROW: Duration = Duration::from_secs(20);

/// Show one row: its pixels, the fitted gaussian and the residuals
///
/// The sensor measures one row by itself, and sends its pixels and what it found. The stream pauses for about
/// a second. By this picture one aligns the optics: where the spot is, how high and how wide, and what light
/// there is beside it.
#[derive(Clone, Debug, clap::Args)]
pub struct RowOptions {
    /// The sensor's serial port, such as /dev/ttyACM0 or COM3
    #[arg(long)]
    pub port: String,
    /// Only the pixels around the spot, or those of all images of a comb
    #[arg(long)]
    pub window: bool,
    /// Write a table: pixel, count, and the fit's count
    #[arg(long)]
    pub csv: Option<PathBuf>,
    /// Draw the row, the fitted gaussian and the residuals, as an SVG
    #[arg(long)]
    pub figure: Option<PathBuf>,
}

/// What a sensor sent of a row.
#[derive(Clone, Debug)]
pub struct RowAnswer {
    /// Pixels of the whole row.
    pub pixels: usize,
    /// The first pixel that was sent.
    pub first: usize,
    /// The counts from there on.
    pub counts: Vec<u16>,
    /// What the sensor found on the row.
    pub centre: Result<Centre, NoCentre>,
}

/// An image on a row, as a gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Image {
    /// The centre in pixels.
    x_px: f64,
    /// The height above the level in counts.
    height: f64,
    /// Sigma in pixels.
    width_px: f64,
}

/// Pixels so many widths from all centres show the level: an image has 4e-6 of its height there.
const BESIDE: f64 = 5.0;

impl Image {
    /// Half of its window, as on the sensor.
    fn reach_px(&self) -> f64 {
        f64::from(REACH) * self.width_px
    }

    /// The gaussian of height 1 at a pixel.
    fn gaussian(&self, pixel: f64) -> f64 {
        let off = (pixel - self.x_px) / self.width_px;
        (-0.5 * off * off).exp()
    }

    /// The same with the height that fits the pixels best: the sensor's own is that of few pixels.
    fn fitted(&self, row: &RowAnswer, level: f64) -> Self {
        let near = row.pixels().map(|(pixel, count)| (pixel as f64, count));
        let near = near.filter(|(pixel, _)| (pixel - self.x_px).abs() <= self.reach_px());
        let (light, squares) = near.fold((0.0, 0.0), |(light, squares), (pixel, count)| {
            let weight = self.gaussian(pixel);
            (light + weight * (count - level), squares + weight * weight)
        });
        match squares > 0.0 {
            true => Self {
                height: light / squares,
                ..*self
            },
            false => *self,
        }
    }
}

impl RowAnswer {
    /// Reads the answer to `row`, once its last line or all of its pixels have come. `Some(None)`: a line was
    /// lost or spoilt.
    fn read(lines: &[String]) -> Option<Option<Self>> {
        let (last, before) = lines.split_last()?;
        if last == ROW_END {
            return Some(Self::of(before));
        }
        Self::of(lines).map(Some)
    }

    /// The answer without its last line.
    fn of(lines: &[String]) -> Option<Self> {
        let begin = lines
            .iter()
            .position(|line| line.starts_with("row pixels "))?;
        let words: Vec<&str> = lines[begin].split(' ').collect();
        let &["row", "pixels", pixels, "first", first, "count", count] = words.as_slice() else {
            return None;
        };
        let (pixels, first, count): (usize, usize, usize) = (
            pixels.parse().ok()?,
            first.parse().ok()?,
            count.parse().ok()?,
        );
        let after = &lines[begin + 1..];
        let is_pixels = |line: &String| line.starts_with("row ");
        let found = after.iter().position(is_pixels).unwrap_or(after.len());
        let (found, of_pixels) = after.split_at(found);
        let centre = answers::centre(found)?;
        let mut counts = Vec::new();
        for line in of_pixels {
            let line = RowPixels::parse(line)?;
            // A line is missing.
            if usize::from(line.first) != first + counts.len() {
                return None;
            }
            counts.extend(line.counts);
        }
        let answer = Self {
            pixels,
            first,
            counts,
            centre,
        };
        // The line of the centre has no checksum. A centre off the pixels was spoilt on its way.
        let came = first as f64..(first + count) as f64;
        let images = answer.found();
        let is_whole = answer.counts.len() == count
            && first + count <= pixels
            && images.iter().all(|(x_px, _)| came.contains(x_px));
        is_whole.then_some(answer)
    }

    /// The centre and the height of each image that the sensor found: one for each slit.
    fn found(&self) -> Vec<(f64, f64)> {
        match &self.centre {
            Err(_) => vec![],
            Ok(Centre {
                slits: Some(slits), ..
            }) => (slits.iter().flatten())
                .map(|slit| (slit.x_px, slit.height_counts))
                .collect(),
            Ok(centre) => vec![(centre.x_px, centre.height_counts)],
        }
    }

    /// The images as gaussians.
    fn images(&self) -> Vec<Image> {
        let found = self.found();
        let shape = self.centre.as_ref().ok().and_then(|centre| centre.shape);
        // A comb, and a spot of too few pixels, come without a shape. All images of a comb are as wide.
        let width_px = shape.map_or_else(
            || {
                let widths = found
                    .iter()
                    .map(|&(x_px, height)| self.width_at_half(x_px, height));
                median(&mut widths.collect::<Vec<f64>>())
            },
            |shape| shape.width_px,
        );
        let rough: Vec<Image> = (found.iter())
            .map(|&(x_px, height)| Image {
                x_px,
                height,
                width_px,
            })
            .collect();
        let level = self.level(&rough).unwrap_or_default();
        let fitted = rough.iter().map(|image| image.fitted(self, level));
        fitted.collect()
    }

    /// The pixels and their counts.
    fn pixels(&self) -> impl Iterator<Item = (usize, f64)> {
        (self.first..).zip(self.counts.iter().map(|&count| count.into()))
    }

    /// Sigma of an image by the pixels above half of its height, in pixels. At least half a pixel.
    fn width_at_half(&self, x_px: f64, height: f64) -> f64 {
        let at = |pixel: usize| {
            let count = self.counts.get(pixel.checked_sub(self.first)?)?;
            Some(f64::from(*count))
        };
        let peak = x_px.round().max(0.0) as usize;
        let half = at(peak).unwrap_or_default() - 0.5 * height;
        let is_above = |pixel: &usize| at(*pixel).is_some_and(|count| count > half);
        let right = (peak..).take_while(is_above).count();
        let left = (0..peak).rev().take_while(is_above).count();
        // The full width at half of the height is 2.355 sigma.
        ((left + right) as f64 / 2.355).max(0.5)
    }

    /// The level beside the images: the median of the pixels there. `None` if there are none.
    fn level(&self, images: &[Image]) -> Option<f64> {
        let is_beside = |pixel: f64| {
            let reaches = |image: &Image| (pixel - image.x_px).abs() <= BESIDE * image.width_px;
            !images.iter().any(reaches)
        };
        let mut beside: Vec<f64> = (self.pixels())
            .filter(|&(pixel, _)| is_beside(pixel as f64))
            .map(|(_, count)| count)
            .collect();
        (!beside.is_empty()).then(|| median(&mut beside))
    }

    /// The fit: gaussians at the sensor's centres, above the level. `None` without a spot.
    fn fit(&self) -> Option<impl Fn(f64) -> f64> {
        let images = self.images();
        let level = self.level(&images)?;
        (!images.is_empty()).then_some(move |pixel: f64| {
            let light = images
                .iter()
                .map(|image| image.height * image.gaussian(pixel));
            level + light.sum::<f64>()
        })
    }

    /// A line for each pixel: its place, its count, and the fit's.
    fn csv(&self) -> String {
        let fit = self.fit();
        let mut text = "pixel,counts,fit_counts\n".to_owned();
        for (pixel, count) in self.pixels() {
            let fit = fit.as_ref().map(|fit| format!("{:.1}", fit(pixel as f64)));
            let _ = writeln!(text, "{pixel},{count},{}", fit.unwrap_or_default());
        }
        text
    }

    /// What a person wants to know first.
    fn summary(&self) -> String {
        let mut text = String::new();
        match &self.centre {
            Ok(centre) => {
                let width_px = self.images().first().map_or(0.0, |image| image.width_px);
                let _ = writeln!(
                    text,
                    "centre {:.3} px with u {:.3} px, height {:.0} counts, width {width_px:.2} px",
                    centre.x_px, centre.claimed_px, centre.height_counts
                );
                let slits = centre.slits.iter().flatten().flatten().count();
                if slits > 0 {
                    let _ = writeln!(text, "{slits} slits show an image");
                }
                if centre.misfits > 0 {
                    let _ = writeln!(text, "the pixels do not look like a spot (flag m)");
                }
            }
            Err(NoCentre { fault, advice }) => {
                let _ = writeln!(text, "no centre: {fault}\n{advice}");
            }
        }
        let last = self.first + self.counts.len();
        if let Some((level, highest)) = self.level(&self.images()).zip(self.counts.iter().max()) {
            let _ = writeln!(
                text,
                "pixels {} to {} of {}: median {level:.0} counts beside the spot, {highest} at most",
                self.first,
                last - 1,
                self.pixels
            );
        }
        let full = self.counts.iter().filter(|&&count| count >= LARGEST_COUNT);
        let full = full.count();
        if full > 0 {
            let _ = writeln!(
                text,
                "{full} pixels are at full scale: dim the laser, or cover other lights"
            );
        }
        text
    }
}

/// `row`.
///
/// # Errors
/// In sentences: nobody answers, the row does not arrive whole, or a file cannot be written.
pub fn row(options: &RowOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    let part = match options.window {
        true => RowPart::Window,
        false => RowPart::Whole,
    };
    let mut session = Session::open(pc, &options.port)?;
    writeln!(output, "sensor {} at {}", session.head(), options.port)?;
    let command = part.to_string();
    let mut answer = None;
    for _ in 0..TRIES {
        answer = session.line().ask(&command, ROW, RowAnswer::read)?;
        if answer.is_some() {
            break;
        }
    }
    let answer = answer.with_context(|| {
        format!(
            "no row arrived whole in {TRIES} tries: check the cable, or ask for --window, which is \
             shorter"
        )
    })?;
    write!(output, "{}", answer.summary())?;
    if let Some(path) = &options.csv {
        whole_file::write(path, answer.csv().as_bytes())?;
        writeln!(output, "written: {}", path.display())?;
    }
    if let Some(path) = &options.figure {
        figure::draw(&answer, path)?;
        writeln!(output, "drawn: {}", path.display())?;
    }
    Ok(())
}
