//! One row as the sensor sees it: by this picture one aligns the optics.

mod figure;
pub mod scope;

use std::fmt::Write as _;
use std::io::Write;
use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, bail, ensure};
use slitrange_device::protocol::row_lines::{
    HeadCheck, REACH, ROW_END, RowExposure, RowPart, RowPixels,
};
use statistics::median;

use super::answers::{self, Centre, NoCentre};
use super::line::TRIES;
use super::port::PortOption;
use super::session::Session;
use crate::pc::Pc;
use crate::whole_file;

/// How long to wait for a row: 1.1 s at 115,200 baud, and an emulated board can be slower than the clock.
const ROW: Duration = Duration::from_secs(20);

/// Show one row: its pixels, the fitted gaussian and the residuals
///
/// The sensor measures one row by itself, and sends its pixels and what it found. The stream pauses for about
/// a second. By this picture one aligns the optics: where the spot is, how high and how wide, and what light
/// there is beside it.
#[derive(Clone, Debug, clap::Args)]
pub struct RowOptions {
    #[command(flatten)]
    port: PortOption,
    /// Only the pixels around the spot, or those of all images of a comb
    #[arg(long)]
    window: bool,
    /// Only the pixels from FIRST to LAST, whatever the row shows
    #[arg(long, num_args = 2, value_names = ["FIRST", "LAST"], conflicts_with = "window")]
    pixels: Option<Vec<u16>>,
    /// Write a table: pixel, count, and the fit's count
    #[arg(long, value_parser = whole_file::output)]
    csv: Option<PathBuf>,
    /// Draw the row, the fitted gaussian and the residuals, as an SVG
    #[arg(long, value_parser = whole_file::output)]
    figure: Option<PathBuf>,
}

impl RowOptions {
    fn part(&self) -> Result<RowPart> {
        match self.pixels.as_deref() {
            Some(&[first, last]) => {
                let wrong = "the first pixel lies beyond the last one";
                ensure!(first <= last, "--pixels {first} {last}: {wrong}");
                Ok(RowPart::Range { first, last })
            }
            _ if self.window => Ok(RowPart::Window),
            _ => Ok(RowPart::Whole),
        }
    }
}

/// What a sensor sent of a row.
#[derive(Clone, Debug, PartialEq)]
pub struct RowAnswer {
    /// Pixels of the whole row.
    pub pixels: usize,
    /// The first pixel that was sent.
    pub first: usize,
    /// The counts from there on.
    pub counts: Vec<u16>,
    /// For how long the laser was on.
    pub exposure: RowExposure,
    /// The mean of the shielded pixels in counts. `None` if the sensor has none.
    pub black: Option<f64>,
    /// The count from which a pixel is saturated.
    pub saturated: u16,
    /// What the sensor found on the row. The pixels are those of the row if it found none, too.
    pub centre: Result<Centre, NoCentre>,
}

/// An image on a row, as a gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Image {
    x_px: f64,
    /// The height above the level in counts.
    height: f64,
    /// Sigma in pixels.
    width_px: f64,
}

/// Pixels so many widths from all centres show the level: an image has 4e-6 of its height there.
const BESIDE: f64 = 5.0;
/// The least sigma of an image in pixels.
const LEAST_WIDTH: f64 = 0.5;

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

    /// The same with the height that fits the pixels best: the sensor's own is that of few pixels. An image
    /// whose centre is off the pixels that came keeps the sensor's height.
    fn fitted(&self, row: &RowAnswer, level: f64) -> Self {
        if !row.has(self.x_px) {
            return *self;
        }
        let near = row.pixels().map(|(pixel, count)| (pixel as f64, count));
        let near = near.filter(|(pixel, _)| (pixel - self.x_px).abs() <= self.reach_px());
        let (light, squares) = near.fold((0.0, 0.0), |(light, squares), (pixel, count)| {
            let weight = self.gaussian(pixel);
            (light + weight * (count - level), squares + weight * weight)
        });
        let height = (squares > 0.0).then_some(light / squares);
        Self {
            height: height.unwrap_or(self.height),
            ..*self
        }
    }
}

impl RowAnswer {
    /// Whether it has the pixels that were asked for.
    fn is_of(&self, part: RowPart) -> bool {
        let came = self.first..self.first + self.counts.len();
        match part {
            RowPart::Whole => came == (0..self.pixels),
            RowPart::Window => true,
            RowPart::Range { first, last } => {
                let end = |place: usize| place.min(self.pixels);
                came == (end(first.into())..end(usize::from(last) + 1))
            }
        }
    }

    /// Reads the lines that came since `row` was asked. `None`: more must come. `Some(None)`: a line was lost
    /// or spoilt. The answer is complete with its last pixel, or with `row check` if no pixel follows, so a
    /// lost last line costs no time.
    pub fn read(lines: &[String]) -> Option<Option<Self>> {
        let (last, before) = lines.split_last()?;
        // Without a line of this row, it is the end of the row before, which nobody waited for.
        if last == ROW_END && before.iter().any(|line| line.starts_with("row ")) {
            return Some(Self::of(before));
        }
        Self::of(lines).map(Some)
    }

    /// Reads the answer without its last line. `None` if a line is missing, or if its checksum is wrong.
    fn of(lines: &[String]) -> Option<Self> {
        let place = |start: &str| lines.iter().position(|line| line.starts_with(start));
        let lines = lines.get(place("row pixels ")?..)?;
        let is_check = |line: &String| line.starts_with(HeadCheck::START);
        let check = lines.iter().position(is_check)?;
        let (head, rest) = lines.split_at(check);
        let (check, of_pixels) = rest.split_first()?;
        if HeadCheck::parse(check)? != HeadCheck::of(head.iter().map(String::as_str)) {
            return None;
        }
        let (first_line, found) = head.split_first()?;
        let words: Vec<&str> = first_line.strip_prefix("row ")?.split(' ').collect();
        let keys = ["pixels", "first", "count", "exposure", "black", "saturated"];
        let [pixels, first, count, exposure, black, saturated] = answers::keyed(&words, keys)?;
        let (pixels, first) = (pixels.parse().ok()?, first.parse().ok()?);
        let count: usize = count.parse().ok()?;
        let mut counts = Vec::new();
        for line in of_pixels {
            let line = RowPixels::parse(line)?;
            // A line is missing.
            if usize::from(line.first) != first + counts.len() {
                return None;
            }
            counts.extend(line.counts);
        }
        let black = Some(black).filter(|black| *black != "-");
        let is_whole = counts.len() == count && first + count <= pixels;
        is_whole.then_some(Self {
            pixels,
            first,
            counts,
            exposure: RowExposure::parse(exposure)?,
            black: black.map(str::parse).transpose().ok()?,
            saturated: saturated.parse().ok()?,
            centre: answers::centre(found)?,
        })
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

    fn images(&self) -> Vec<Image> {
        let found = self.found();
        let shape = self.centre.as_ref().ok().and_then(|centre| centre.shape);
        // A comb, and a spot of too few pixels, come without a shape. All images of a comb are as wide.
        let width_px = shape.map(|shape| shape.width_px).unwrap_or_else(|| {
            // Without the pixels of an image, the width of none is known.
            let images = found.iter().filter(|(x_px, _)| self.has(*x_px));
            let widths = images.map(|&(x_px, height)| self.width_at_half(x_px, height));
            median(widths).max(LEAST_WIDTH)
        });
        let image = |&(x_px, height): &(f64, f64)| Image {
            x_px,
            height,
            width_px,
        };
        let rough: Vec<Image> = found.iter().map(image).collect();
        let level = self.level(&rough).unwrap_or_default();
        let fitted = rough.iter().map(|image| image.fitted(self, level));
        fitted.collect()
    }

    /// Whether the pixel at a place came.
    fn has(&self, x_px: f64) -> bool {
        let came = self.first as f64..(self.first + self.counts.len()) as f64;
        came.contains(&x_px)
    }

    fn pixels(&self) -> impl Iterator<Item = (usize, f64)> {
        (self.first..).zip(self.counts.iter().map(|&count| count.into()))
    }

    /// Those in a range, to draw them.
    fn points(&self, range: &Range<usize>) -> Vec<(f64, f64)> {
        let shown = self.pixels().filter(|(pixel, _)| range.contains(pixel));
        shown.map(|(pixel, count)| (pixel as f64, count)).collect()
    }

    /// Sigma of an image by the pixels above half of its height, in pixels. At least [`LEAST_WIDTH`].
    fn width_at_half(&self, x_px: f64, height: f64) -> f64 {
        let at = |pixel: usize| Some(f64::from(*self.counts.get(pixel.checked_sub(self.first)?)?));
        let peak = x_px.round().max(0.0) as usize;
        let half = at(peak).unwrap_or_default() - 0.5 * height;
        let is_above = |pixel: &usize| at(*pixel).is_some_and(|count| count > half);
        let right = (peak..).take_while(is_above).count();
        let left = (0..peak).rev().take_while(is_above).count();
        // The full width at half of the height is 2.355 sigma.
        ((left + right) as f64 / 2.355).max(LEAST_WIDTH)
    }

    /// The level beside the images: the median of the pixels there. `None` if there are none.
    fn level(&self, images: &[Image]) -> Option<f64> {
        let is_beside = |pixel: f64| {
            let reaches = |image: &Image| (pixel - image.x_px).abs() <= BESIDE * image.width_px;
            !images.iter().any(reaches)
        };
        let beside = self.pixels().filter(|&(pixel, _)| is_beside(pixel as f64));
        let beside: Vec<f64> = beside.map(|(_, count)| count).collect();
        (!beside.is_empty()).then(|| median(&beside))
    }

    /// The fit: gaussians at the sensor's centres, above the level. `None` without a spot.
    fn fit(&self) -> Option<impl Fn(f64) -> f64> {
        let images = self.images();
        let level = self.level(&images)?;
        (!images.is_empty()).then_some(move |pixel: f64| {
            let light = images.iter().map(|it| it.height * it.gaussian(pixel));
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

    fn exposure_words(&self) -> String {
        match self.exposure {
            RowExposure::On(exposure) => format!("exposure {} us", exposure.us()),
            RowExposure::Off => "laser off".to_owned(),
            RowExposure::Unknown => "exposure unknown".to_owned(),
        }
    }

    fn full(&self) -> usize {
        let is_full = |count: &&u16| **count >= self.saturated;
        self.counts.iter().filter(is_full).count()
    }

    /// The first image's width in pixels, and 0 without an image.
    fn width_px(&self) -> f64 {
        self.images().first().map_or(0.0, |image| image.width_px)
    }

    fn summary(&self) -> String {
        let mut text = String::new();
        match &self.centre {
            Ok(centre) => {
                let width_px = self.width_px();
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
        text += &self.exposure_words();
        let _ = match self.black {
            Some(black) => writeln!(text, ", black level {black:.2} counts"),
            None => writeln!(text, ", no shielded pixels"),
        };
        if let Some(highest) = self.counts.iter().max() {
            let last = self.first + self.counts.len() - 1;
            let _ = write!(text, "pixels {} to {last} of {}: ", self.first, self.pixels);
            if let Some(level) = self.level(&self.images()) {
                let is_spot = self.centre.is_ok();
                let beside = if is_spot { " beside the spot" } else { "" };
                let _ = write!(text, "median {level:.0} counts{beside}, ");
            }
            let _ = writeln!(text, "{highest} at most");
        }
        let full = self.full();
        if full > 0 {
            let _ = writeln!(
                text,
                "{full} pixels are saturated, with {} counts or more: dim the laser, or cover other lights",
                self.saturated
            );
        }
        text
    }
}

/// Asks a sensor for a row, again if the answer does not arrive as it was sent.
pub(super) fn ask_row(session: &mut Session<'_>, part: RowPart) -> Result<RowAnswer> {
    let command = part.to_string();
    for _ in 0..TRIES {
        let answer = session.line().ask(&command, ROW, RowAnswer::read)?;
        // A command that was spoilt on its way may be another valid one.
        if let Some(answer) = answer.filter(|answer| answer.is_of(part)) {
            return Ok(answer);
        }
    }
    bail!(
        "no row arrived whole in {TRIES} tries: check the cable, ask for --window, which is shorter, and \
         check that the firmware is as new as this program (`info`)"
    )
}

/// `row`.
pub fn row(options: &RowOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    let part = options.part()?;
    let mut session = options.port.open(pc)?;
    writeln!(output, "sensor {} at {}", session.head(), session.port())?;
    let answer = ask_row(&mut session, part)?;
    if let RowPart::Range { first, last } = part {
        let (count, end) = (answer.pixels, answer.pixels.saturating_sub(1));
        let beyond = "is beyond the row, which has the pixels";
        ensure!(
            usize::from(first) < count,
            "--pixels {first} {last} {beyond} 0 to {end}"
        );
    }
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
