//! Known distances and the centres that a sensor had there: a CSV file of `x_px`, `d_mm` and, if there,
//! `sigma_px`, `height_counts`, and the spot's shape.
//!
//! ```text
//! # serial 42
//! # estimator phase-table
//! # black shielded
//! # head TCD1304DG
//! x_px,d_mm,sigma_px,height_counts
//! 2404.12345,600,0.0021,1011
//! 2371.60220,607.1,0.0020,870
//! ```
//!
//! The shape is in the columns `width_px` and `shape_0_px` to `shape_4_px` (see [`Shape`]). It counts only
//! with `claimed_px`, the uncertainty that the sensor claims for a frame, and `frames`, their number.
//!
//! A comb of slits has the images of all slits in the columns `slit_1_px`, `slit_1_counts` to `slit_16_px`,
//! `slit_16_counts`: centre on the row, and height. Both are empty for a slit without an image.
//!
//! Lines that begin with `#` are comments. The comments above are a [`Setup`], which goes into the record.
//! Other columns are not read. Semicolons or tabs may stand for the commas; beside semicolons, numbers may
//! have decimal commas.

pub mod columns;

use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
use slitrange::base::exposure::Exposure;
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::frame::comb::{MAX_SLITS, SlitCentre, SlitCentres, Slits};
use slitrange::row::LARGEST_COUNT;
use slitrange::row::sensor_heads::tcd1304dg;
use slitrange::spot::choice::SpotChoice;
use slitrange::spot::region::Region;
use slitrange::{BlackLevel, Estimator, Micrometres, Pixels};
use slitrange_device::settings::{Setting, Value};
use statistics::least_and_most;

use columns::{CLAIMED, D, FRAMES, HEIGHT, SHAPE, SIGMA, WIDTH, X};

/// The first line of a file that `calibrate run` writes.
pub const TITLE: &str = "# points of a sensor, by slitrange calibrate run";
/// The largest height of a spot in counts: full scale at the shortest exposure, as at the longest.
const LARGEST_HEIGHT: u32 =
    LARGEST_COUNT as u32 * Exposure::LONGEST.us() as u32 / Exposure::SHORTEST.us() as u32;

fn is_height(counts: f64) -> bool {
    counts > 0.0 && counts <= LARGEST_HEIGHT.into()
}

/// A centre at a known distance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// The line of the file that it comes from, from 1.
    pub line: u64,
    /// The spot's centre in pixels.
    pub x_px: f64,
    /// The target's distance in millimetres.
    pub d_mm: f64,
    /// The centre's standard uncertainty in pixels, where it is known.
    pub sigma_px: Option<f64>,
    /// The spot's height at the longest exposure in counts, where it is known.
    pub height_counts: Option<f64>,
    /// The spot's shape, where it is known.
    pub shape: Option<KnownShape>,
    /// The images of a comb's slits, if the sensor has a comb.
    pub slits: Option<SlitImages>,
}

/// The image of one slit of a comb.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlitImage {
    /// The centre on the row, in pixels.
    pub x_px: f64,
    /// The height in counts.
    pub height_counts: f64,
}

impl SlitImage {
    /// An image with its centre in pixels and its height in counts.
    pub const fn new(x_px: f64, height_counts: f64) -> Self {
        Self {
            x_px,
            height_counts,
        }
    }
}

/// The images of a comb, in the order of its slits. A slit may have no image.
pub type SlitImages = [Option<SlitImage>; MAX_SLITS];

/// The images that the sensor measured.
pub fn slit_images(centres: &SlitCentres) -> SlitImages {
    let image = |it: SlitCentre| SlitImage::new(it.centre.to_f64(), f64::from(it.height));
    centres.map(|centre| centre.map(image))
}

/// The shape of a spot, as the sensor measures it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// The width: a gaussian's sigma, in pixels.
    pub width_px: f64,
    /// The components of the antisymmetric light, as shifts in pixels: see
    /// [`SpotShape`](slitrange::centre::spot_shape::SpotShape).
    pub components_px: [f64; COMPONENTS],
}

/// The shape of a spot, and its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownShape {
    /// The mean shape of the frames.
    pub shape: Shape,
    /// The standard deviation of the width and of each component by noise, in pixels.
    pub noise_px: f64,
}

/// The content of a file of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// In the file's order. Either all have an uncertainty or none.
    pub points: Vec<Point>,
    /// How they were taken.
    pub setup: Setup,
}

/// The sensor and the settings with which points were taken, as far as they are known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Setup {
    /// The sensor head.
    pub head: Option<String>,
    /// The sensor's serial number; 0 until it has one.
    pub serial_number: Option<u32>,
    /// How centres were found.
    pub estimator: Option<Estimator>,
    /// How the black level was found.
    pub black_level: Option<BlackLevel>,
    /// What was before the sensor. Points that do not say it are those of one slit.
    pub slits: Slits,
    /// The pixels in which the spot was searched. Points that do not say it are those of all pixels.
    pub region: Region,
    /// Which of several spots was measured. Points that do not say it are those of the strongest one.
    pub peak: SpotChoice,
}

/// The only head that there is a driver for.
pub const HEAD: &str = "TCD1304DG";
/// A centre's uncertainty in pixels is a slip if it is finer than the sensor, or larger than its row.
const SIGMAS_PX: std::ops::RangeInclusive<f64> = 1e-5..=4096.0;

impl Points {
    /// Reads a file.
    ///
    /// # Errors
    /// The file cannot be read, or a line of it; the line and what to do are said.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
        Self::parse(&String::from_utf8_lossy(&bytes)).with_context(|| path.display().to_string())
    }

    /// Reads a file's text.
    ///
    /// # Errors
    /// A line cannot be read; which and what to do is said.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let mut read = Self::default();
        let mut header: Option<(csv::StringRecord, u8)> = None;
        ensure!(
            !text.contains('\0'),
            "it is UTF-16, or no text: save it as CSV in UTF-8"
        );
        let text = text.trim_start_matches('\u{feff}');
        let text = text.replace("\r\n", "\n").replace('\r', "\n");
        for (line, text) in (1..).zip(text.lines()) {
            // A spreadsheet fills lines up with empty cells.
            let words = text.trim().trim_end_matches([',', ';', '\t']);
            let in_line = || format!("line {line}");
            if let Some(comment) = words.strip_prefix('#') {
                read.setup.read_comment(comment).with_context(in_line)?;
                if let Some(head) = read.setup.head.as_ref().filter(|head| *head != HEAD) {
                    let error =
                        format!("there is no head {head:?}: centres must be those of a {HEAD}");
                    return Err(anyhow!(error).context(in_line()));
                }
                continue;
            }
            if words.is_empty() || header.is_none() && words.starts_with("sep=") {
                continue;
            }
            let Some((header, separator)) = &header else {
                let names = |by| Some((fields(&text.to_lowercase(), by).ok()?, by));
                let once = |name, (names, _): &(csv::StringRecord, u8)| {
                    names.iter().filter(|it| *it == name).count() == 1
                };
                let mut ways = b",;\t".iter().copied().filter_map(names);
                header = ways.find(|way| once(X, way) && once(D, way));
                ensure!(
                    header.is_some(),
                    "line {line}, `{}`, does not name the columns x_px and d_mm, once each: the first line \
                     that is no comment must be x_px,d_mm or x_px,d_mm,sigma_px",
                    text.escape_debug()
                );
                continue;
            };
            let line = Line {
                number: line,
                header,
                separator: *separator,
                fields: fields(text, *separator).with_context(in_line)?,
            };
            let has_name = |place| header.get(place).is_some_and(|name| !name.is_empty());
            let mut filled = (0..).zip(&line.fields).filter(|(_, it)| !it.is_empty());
            ensure!(
                filled.all(|(place, _)| has_name(place)),
                "line {}, `{}`, has more fields than the header has names: a decimal comma may be the cause, \
                 write decimals with a point, or semicolons between the columns",
                line.number,
                text.escape_debug()
            );
            read.points.push(line.point()?);
        }
        ensure!(
            header.is_some(),
            "there is no line in it: its header must name x_px and d_mm"
        );
        // The first line that has something, and the first without it.
        let first = |has: fn(&Point) -> bool| {
            let line = |is: bool| read.points.iter().find(|it| has(it) == is);
            [true, false].map(|is| line(is).map(|point| point.line))
        };
        if let [Some(with), Some(without)] = first(|point| point.sigma_px.is_some()) {
            bail!(
                "line {without} has no sigma_px, and line {with} has: give it for all points or for none"
            );
        }
        match first(|point| point.slits.is_some()) {
            [Some(with), Some(without)] => bail!(
                "line {without} has no image of any slit, and line {with} has: remove the line without, or \
                 take the point again"
            ),
            [None, Some(_)] if read.setup.slits == Slits::Comb => bail!(
                "the points are those of a comb, and have no columns slit_1_px, slit_1_counts and so on: \
                 take them with `calibrate run`"
            ),
            [Some(_), None] => read.setup.slits = Slits::Comb,
            _ => {}
        }
        check_unit(&read.points)?;
        Ok(read)
    }
}

/// Distances in metres under the name `d_mm` are no larger: the largest that a record holds, in metres.
const METRES: f64 = 8.39;
/// The least distance for a pixel of a sensor that counts millimetres. In metres, the nominal geometry has
/// less up to 4.5 m; in millimetres, it has twenty times as much at 0.6 m.
const LEAST_MM_PER_PX: f64 = 0.01;

fn check_unit(points: &[Point]) -> anyhow::Result<()> {
    let span = |of: fn(&Point) -> f64| {
        let (least, most) = least_and_most(points.iter().map(of));
        most - least
    };
    let (mm, pixels) = (span(|point| point.d_mm), span(|point| point.x_px));
    let near_zero = points.iter().all(|point| point.d_mm.abs() < METRES);
    ensure!(
        points.len() < 2 || !near_zero || mm >= LEAST_MM_PER_PX * pixels,
        "the distances cover {mm:.3} mm and the centres {pixels:.1} px, so the distances seem to be in \
         metres: give d_mm in millimetres (if they are millimetres, add 100 to each: eq. \
         (1)'s D takes that in)"
    );
    Ok(())
}

/// A line's fields, without the blanks around them.
fn fields(line: &str, separator: u8) -> anyhow::Result<csv::StringRecord> {
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator)
        .has_headers(false)
        .trim(csv::Trim::All)
        .from_reader(line.as_bytes());
    let mut fields = csv::StringRecord::new();
    reader.read_record(&mut fields)?;
    Ok(fields)
}

/// The columns of a [`KnownShape`]. It is known if all of them are there.
const SHAPE_AND_NOISE: [&str; 3 + COMPONENTS] = [
    WIDTH, CLAIMED, FRAMES, SHAPE[0], SHAPE[1], SHAPE[2], SHAPE[3], SHAPE[4],
];

/// A line with a point, below the header that names its fields.
struct Line<'a> {
    number: u64,
    header: &'a csv::StringRecord,
    separator: u8,
    fields: csv::StringRecord,
}

impl Line<'_> {
    fn place(&self, column: &str) -> Option<usize> {
        self.header.iter().position(|name| name == column)
    }

    /// The number in a column. None if the file has no such column, or the line nothing in it.
    fn number(&self, column: &str) -> anyhow::Result<Option<f64>> {
        let field = self.place(column).and_then(|place| self.fields.get(place));
        let Some(field) = field.filter(|field| !field.is_empty()) else {
            return Ok(None);
        };
        let point = if self.separator == b';' { "." } else { "," };
        let number = field.replace(',', point).parse().ok();
        let number = number.filter(|number: &f64| number.is_finite());
        number.map(Some).with_context(|| {
            format!(
                "line {}: {column} is {field:?}, which is no finite number with a decimal point: correct it, \
                 or remove the line",
                self.number
            )
        })
    }

    /// The number in a column that no line may leave out.
    fn must(&self, column: &str) -> anyhow::Result<f64> {
        self.number(column)?.with_context(|| {
            let line = self.number;
            format!("line {line} has no {column}: add it, or remove the line")
        })
    }

    fn point(&self) -> anyhow::Result<Point> {
        let line = self.number;
        let (x_px, d_mm) = (self.must(X)?, self.must(D)?);
        let (sigma_px, height_counts) = (self.number(SIGMA)?, self.number(HEIGHT)?);
        let last = tcd1304dg().light.len() as f64 - 0.5;
        ensure!(
            (-0.5..=last).contains(&x_px),
            "line {line}: x_px is {x_px}, and a {HEAD} has its pixels from -0.5 to {last}: correct it, or \
             remove the line"
        );
        let farthest = Micrometres::MAX.to_f64() / 1e3;
        ensure!(
            d_mm.abs() < farthest,
            "line {line}: d_mm is {d_mm}, and a record holds distances below {farthest:.0} mm: correct it, \
             or remove the line"
        );
        if let Some(sigma) = sigma_px {
            ensure!(
                SIGMAS_PX.contains(&sigma),
                "line {line}: sigma_px is {sigma}, and must be {} to {} px: correct it, or leave the column \
                 out",
                SIGMAS_PX.start(),
                SIGMAS_PX.end()
            );
        }
        if let Some(height) = height_counts {
            ensure!(
                is_height(height),
                "line {line}: height_counts is {height}, and must be above 0 and at most {LARGEST_HEIGHT}: \
                 correct it, or leave the column out"
            );
        }
        Ok(Point {
            line,
            x_px,
            d_mm,
            sigma_px,
            height_counts,
            shape: self.shape()?,
            slits: self.slits()?,
        })
    }

    /// The images of a comb. None if no slit has an image.
    fn slits(&self) -> anyhow::Result<Option<SlitImages>> {
        let columns = columns::comb();
        if columns.iter().any(|column| self.place(column).is_none()) {
            return Ok(None);
        }
        let mut images = SlitImages::default();
        for (image, (columns, slit)) in images.iter_mut().zip(columns.chunks(2).zip(1..)) {
            *image = match (self.number(&columns[0])?, self.number(&columns[1])?) {
                (None, None) => None,
                (Some(x_px), Some(height_counts))
                    if (-0.5..=4096.0).contains(&x_px) && is_height(height_counts) =>
                {
                    Some(SlitImage::new(x_px, height_counts))
                }
                _ => bail!(
                    "line {}: slit {slit} has no usable image: its centre must be on the row, and its height \
                     above 0 and at most {LARGEST_HEIGHT}: correct them, or leave both empty",
                    self.number
                ),
            };
        }
        Ok(Some(images).filter(|images| images.iter().any(Option::is_some)))
    }

    /// The spot's shape and its noise. None if the file has no columns for them, or one is empty.
    fn shape(&self) -> anyhow::Result<Option<KnownShape>> {
        let is_there = |column: &&str| self.place(column).is_some();
        if !SHAPE_AND_NOISE.iter().all(is_there) {
            return Ok(None);
        }
        let numbers = SHAPE_AND_NOISE.map(|column| self.number(column).transpose());
        let numbers: Vec<f64> = numbers.into_iter().flatten().collect::<Result<_, _>>()?;
        let Ok([width_px, claimed_px, frames, components_px @ ..]) =
            <[f64; SHAPE_AND_NOISE.len()]>::try_from(numbers)
        else {
            return Ok(None);
        };
        let largest = Pixels::MAX.to_f64();
        let is_small = components_px.iter().all(|it| it.abs() < largest) && width_px < largest;
        ensure!(
            width_px > 0.0 && is_small && claimed_px >= 0.0 && frames >= 1.0,
            "line {}: this is no shape of a spot: width_px must be above 0, frames 1 or more, and all below \
             {largest:.0} px: correct it, or leave the columns width_px and shape_0_px to shape_4_px empty",
            self.number
        );
        let shape = Shape {
            width_px,
            components_px,
        };
        let noise_px = claimed_px / frames.sqrt();
        Ok(Some(KnownShape { shape, noise_px }))
    }
}

impl Setup {
    /// Names and values of the comments that hold this setup.
    pub fn comments(&self) -> [(&'static str, Option<String>); 7] {
        let default = Self::default().unnamed();
        let changed = |value: Value| (!default.contains(&value)).then(|| words(value));
        let [slits, region, peak] = self.unnamed().map(changed);
        let estimator = self.estimator.map(Value::Estimator).map(words);
        [
            ("head", self.head.clone()),
            ("serial", self.serial_number.map(|it| it.to_string())),
            ("estimator", estimator),
            ("black", self.black_level.map(Value::Black).map(words)),
            ("slits", slits),
            ("region", region),
            ("peak", peak),
        ]
    }

    /// Takes the value of a setting that is a part of a setup.
    pub fn take(&mut self, value: Value) {
        match value {
            Value::Estimator(estimator) => self.estimator = Some(estimator),
            Value::Black(level) => self.black_level = Some(level),
            Value::Slits(slits) => self.slits = slits,
            Value::Region(region) => self.region = region,
            Value::SpotChoice(peak) => self.peak = peak,
            _ => {}
        }
    }

    /// The settings that points need not name: then they have the sensor's defaults.
    pub fn unnamed(&self) -> [Value; 3] {
        [
            Value::Slits(self.slits),
            Value::Region(self.region),
            Value::SpotChoice(self.peak),
        ]
    }

    /// Reads a comment, without its `#`. Most comments are no part of a setup, and change nothing.
    ///
    /// # Errors
    /// The comment names a part of the setup, and its value is none that there is.
    pub fn read_comment(&mut self, comment: &str) -> anyhow::Result<()> {
        let words: Vec<&str> = comment.split_whitespace().collect();
        match words[..] {
            ["serial", number] => {
                let error =
                    || format!("the serial number {number:?} is no whole number below 2^32");
                self.serial_number = Some(number.parse().ok().with_context(error)?);
            }
            ["estimator", name] => self.estimator = Some(estimator(name)?),
            ["black", ..] if words.len() <= 3 => self.black_level = Some(black_level(&words[1..])?),
            ["slits", name] => {
                self.slits = Slits::named(name)
                    .with_context(|| format!("slits are one or comb, and not {name:?}"))?;
            }
            ["region", ref ends @ ..] if ends.len() <= 2 => match Setting::Region.read(ends) {
                Ok(Value::Region(region)) => self.region = region,
                _ => bail!("the region {:?} must be two pixels", ends.join(" ")),
            },
            ["peak", name] => {
                self.peak = SpotChoice::named(name).with_context(|| {
                    format!("the peak is strongest, first or last, and not {name:?}")
                })?;
            }
            ["head", head] => self.head = Some(head.to_owned()),
            _ => {}
        }
        Ok(())
    }
}

/// The estimator with a name.
///
/// # Errors
/// No estimator has that name.
pub fn estimator(name: &str) -> anyhow::Result<Estimator> {
    Estimator::named(name).with_context(|| {
        format!(
            "there is no estimator {name:?}, but {}",
            Estimator::ALL.map(Estimator::name).join(", ")
        )
    })
}

/// A value of a setting in the words of the serial line, without the setting's name.
pub fn words(value: Value) -> String {
    let line = value.to_string();
    let value = line.strip_prefix(value.setting().name());
    value.unwrap_or(&line).trim_start().to_owned()
}

/// The black level in the words of the serial line: `shielded`, `frame`, `fixed N`.
///
/// # Errors
/// The words are no black level.
pub fn black_level(words: &[&str]) -> anyhow::Result<BlackLevel> {
    match Setting::Black.read(words) {
        Ok(Value::Black(level)) => Ok(level),
        _ => bail!(
            "the black level {:?} must be shielded, frame, or fixed with 0 to {LARGEST_COUNT}",
            words.join(" ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use slitrange::base::units::Counts;

    #[test]
    fn the_setup_and_the_named_columns_are_read() {
        let read = Points::parse(
            "\u{feff}# serial 42\r\n# taken on the long bench\r\n#estimator adaptive\r\n\
             # black fixed 120\r\n# head TCD1304DG\r\n\
             frames, d_mm ,note,x_px,sigma_px\r\n\r\n16, 600.5,\"a, b\", 2404.25,0.002\r\n\
             # later\r\n16,607,,+2.37e3,0.003\r\n",
        )
        .expect("points");
        let setup = Setup {
            head: Some(HEAD.to_owned()),
            serial_number: Some(42),
            estimator: Some(Estimator::Adaptive),
            black_level: Some(BlackLevel::Fixed(Counts::from_int(120))),
            ..Setup::default()
        };
        assert_eq!(read.setup, setup);
        let point = |line, x_px, d_mm, sigma_px| Point {
            line,
            x_px,
            d_mm,
            sigma_px: Some(sigma_px),
            ..Point::default()
        };
        let due = [
            point(8, 2404.25, 600.5, 0.002),
            point(10, 2370.0, 607.0, 0.003),
        ];
        assert_eq!(read.points, due);
        let plain = Points::parse("x_px,d_mm\n1,2").expect("points");
        assert_eq!(plain.points[0].sigma_px, None);
        assert_eq!(plain.setup, Setup::default());
    }

    /// The nominal sensor from 0.6 to 5 m, as metres and as millimetres.
    #[test]
    fn metres_are_told_from_millimetres() {
        let file = |unit: f64, from: f64, to: f64| {
            let lines = (0..5).map(|step| {
                let metres = from + (to - from) * f64::from(step) / 4.0;
                let x_px = 2_152_367.0 / (1e3 * metres + 115.4) - 580.3;
                format!("{x_px},{}\n", metres * unit)
            });
            Points::parse(&format!("x_px,d_mm\n{}", lines.collect::<String>()))
        };
        for (from, to) in [(0.6, 1.02), (0.8, 0.81), (1.0, 2.0), (0.7, 3.0)] {
            let error = file(1.0, from, to).expect_err("metres").to_string();
            println!("{error}");
            assert!(error.contains("seem to be in metres"));
            file(1e3, from, to).expect("millimetres");
        }
    }

    /// As spreadsheets write them.
    #[test]
    fn separators_line_ends_and_filled_lines_are_understood() {
        for text in [
            "X_px,D_MM\r2428.5,600.25\r1315.5,1020\r",
            "sep=;\n# black shielded;\nx_px;d_mm\n2428,5;600,25\n1315,5;1020\n;\n",
            "\u{feff}x_px\td_mm\r\n2428.5\t600.25\r\n1315.5\t1020",
            "# black shielded,,\nx_px,d_mm,,\n2428.5,600.25,,\n1315.5,1020,,\n,,,\n",
            "x_px,d_mm,\"a; b\"\n2428.5,600.25,\n1315.5,1020,c\n",
        ] {
            let read = Points::parse(text).expect("points").points;
            let read: Vec<(f64, f64)> = read.iter().map(|it| (it.x_px, it.d_mm)).collect();
            assert_eq!(read, [(2428.5, 600.25), (1315.5, 1020.0)], "{text}");
        }
    }

    #[test]
    fn a_shape_is_read_if_all_of_it_is_there() {
        let text = "x_px,d_mm,frames,claimed_px,width_px,shape_0_px,shape_1_px,shape_2_px,shape_3_px,\
                    shape_4_px\n\
                    1500,600,4,0.002,7.625,0.001,-0.002,0.003,0,-0.005\n1510,601,4,0.002,,,,,,\n";
        let read = Points::parse(text).expect("points").points;
        let shape = KnownShape {
            shape: Shape {
                width_px: 7.625,
                components_px: [0.001, -0.002, 0.003, 0.0, -0.005],
            },
            noise_px: 0.001,
        };
        assert_eq!((read[0].shape, read[1].shape), (Some(shape), None));
        let without = text.replace(",shape_4_px", "").replace(",-0.005", "");
        let read = Points::parse(&without).expect("points").points;
        assert_eq!(read[0].shape, None);
    }

    #[test]
    fn the_images_of_a_comb_are_read() {
        let columns = columns::comb().join(",");
        let line = |first: &str| format!("1500,600,{first}{}", ",".repeat(2 * MAX_SLITS - 2));
        let text = format!("x_px,d_mm,{columns}\n{}\n", line("912.5,1830"));
        let read = Points::parse(&text).expect("points");
        assert_eq!(read.setup.slits, Slits::Comb);
        let images = read.points[0].slits.expect("images");
        let first = SlitImage::new(912.5, 1830.0);
        assert_eq!((images[0], images[1]), (Some(first), None));
        let no_image = "line 2: slit 1 has no usable image";
        let unlike = "line 3 has no image of any slit, and line 2 has";
        let of_comb = "# slits comb\nx_px,d_mm\n1500,600".to_owned();
        for (text, says) in [
            (text.replace("912.5", ""), no_image),
            (text.replace("1830", "0"), no_image),
            (text.clone() + &line(","), unlike),
            (of_comb, "the points are those of a comb"),
            ("# slits two\n".to_owned(), "line 1"),
        ] {
            let error = Points::parse(&text).expect_err("refused").to_string();
            assert!(error.starts_with(says), "{error}");
        }
    }

    #[test]
    fn a_setup_is_read_as_it_was_written() {
        for black_level in [
            BlackLevel::Shielded,
            BlackLevel::Frame,
            BlackLevel::Fixed(Counts::from_int(300)),
        ] {
            let setup = Setup {
                head: Some(HEAD.to_owned()),
                serial_number: Some(17),
                estimator: Some(Estimator::Fraunhofer),
                black_level: Some(black_level),
                slits: Slits::Comb,
                region: Region::new(1000, 3000).expect("a region"),
                peak: SpotChoice::Last,
            };
            let mut read = Setup::default();
            for (name, value) in setup.comments() {
                let comment = format!(" {name} {}", value.expect("a value"));
                read.read_comment(&comment).expect("a part of the setup");
            }
            assert_eq!(read, setup);
        }
    }

    #[test]
    fn malformed_points_are_refused_with_a_reason() {
        // A file a line.
        let refusals = include_str!("points/malformed.txt").lines().map(|line| {
            let text = line.replace(r"\n", "\n").replace(r"\0", "\0");
            format!("{:#}", Points::parse(&text).expect_err("refused"))
        });
        insta::assert_snapshot!(refusals.collect::<Vec<_>>().join("\n"));
    }
}
