//! The file of points that a run takes: none that is in it is ever lost.
//!
//! It is CSV that `calibrate fit` reads, with remarks on lines of their own. A point is appended and flushed
//! to the disk before the target moves on. What changes other than at its end is written as another file,
//! which then takes its name.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use calibration::points::{Setup, Shape, SlitImage, SlitImages, TITLE, columns};
use slitrange::frame::comb::{MAX_SLITS, Slits};
use slitrange_device::protocol::command::{Command, parse};
use slitrange_device::settings::Value;

use super::session::Before;

/// The line above the points of a sensor with these slits.
fn header(slits: Slits) -> String {
    let one_slit = columns::ONE_SLIT.join(",");
    match slits {
        Slits::One => one_slit,
        Slits::Comb => format!("{one_slit},{}", columns::comb().join(",")),
    }
}

/// A distance in millimetres with three decimals, or with as many as it takes.
pub struct Millimetres(pub f64);

impl fmt::Display for Millimetres {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if (self.0 * 1000.0).round() / 1000.0 == self.0 {
            write!(f, "{:.3}", self.0)
        } else {
            write!(f, "{}", self.0)
        }
    }
}

/// A point: what the sensor saw with the target at a known distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taken {
    /// The centre in pixels: the mean of the frames'.
    pub x_px: f64,
    /// The target's distance in millimetres.
    pub d_mm: f64,
    /// The standard uncertainty of the mean in pixels, as far as frames tell.
    pub sigma_px: f64,
    /// Frames taken.
    pub frames: usize,
    /// The sample standard deviation of the frames' centres in pixels; none of a single frame.
    pub scatter_px: Option<f64>,
    /// The standard uncertainty that the sensor claims for one frame, in pixels (root mean square).
    pub claimed_px: f64,
    /// Rows of all frames that did not look like their spot.
    pub misfits: u32,
    /// As how few independent rows a frame's may count: the least of those that the sensor flagged.
    pub correlated: Option<u16>,
    /// The spot's height in counts, the mean of the frames'.
    pub height_counts: Option<f64>,
    /// The spot's shape, the mean of the frames'.
    pub shape: Option<Shape>,
    /// The images of a comb's slits, the means of the frames'.
    pub slits: Option<SlitImages>,
}

impl fmt::Display for Taken {
    /// The line, without its end.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            x_px,
            sigma_px,
            frames,
            claimed_px,
            misfits,
            ..
        } = self;
        write!(
            f,
            "{x_px:.6},{},{sigma_px:.6},{frames},",
            Millimetres(self.d_mm)
        )?;
        if let Some(scatter) = self.scatter_px {
            write!(f, "{scatter:.6}")?;
        }
        write!(f, ",{claimed_px:.6},{misfits},")?;
        if let Some(rows) = self.correlated {
            write!(f, "{rows}")?;
        }
        match self.height_counts {
            Some(height) => write!(f, ",{height:.1}")?,
            None => f.write_str(",")?,
        }
        match self.shape {
            Some(shape) => {
                write!(f, ",{:.6}", shape.width_px)?;
                (shape.components_px.iter())
                    .try_for_each(|component| write!(f, ",{component:.6}"))?;
            }
            None => f.write_str(",,,,,,")?,
        }
        for image in self.slits.iter().flatten() {
            match image {
                Some(image) => write!(f, ",{:.6},{:.1}", image.x_px, image.height_counts)?,
                None => f.write_str(",,")?,
            }
        }
        Ok(())
    }
}

impl Taken {
    /// The point that a line stands for.
    fn parse(line: &str) -> Option<Self> {
        let columns: Vec<&str> = line.split(',').map(str::trim).collect();
        let (&[x, d, sigma, frames, scatter, claimed, misfits, correlated], rest) =
            columns.split_first_chunk()?;
        let number = |word: &str| word.parse().ok().filter(|value: &f64| value.is_finite());
        let (rest, slits) = match rest.split_last_chunk::<{ 2 * MAX_SLITS }>() {
            Some((rest, slits)) => (rest, Some(parse_slits(slits)?)),
            None => (rest, None),
        };
        let (height, shape) = match *rest {
            [height, "", "", "", "", "", ""] => (height, None),
            [height, width, o0, o1, o2, o3, o4] => {
                let shape = Shape {
                    width_px: number(width)?,
                    components_px: [
                        number(o0)?,
                        number(o1)?,
                        number(o2)?,
                        number(o3)?,
                        number(o4)?,
                    ],
                };
                (height, Some(shape))
            }
            _ => return None,
        };
        Some(Self {
            x_px: number(x)?,
            d_mm: number(d)?,
            sigma_px: number(sigma)?,
            frames: frames.parse().ok()?,
            scatter_px: if scatter.is_empty() {
                None
            } else {
                Some(number(scatter)?)
            },
            claimed_px: number(claimed)?,
            misfits: misfits.parse().ok()?,
            correlated: if correlated.is_empty() {
                None
            } else {
                Some(correlated.parse().ok()?)
            },
            height_counts: if height.is_empty() {
                None
            } else {
                Some(number(height)?)
            },
            shape,
            slits,
        })
    }
}

/// The images of a comb, from two columns for each slit.
fn parse_slits(columns: &[&str; 2 * MAX_SLITS]) -> Option<SlitImages> {
    let number = |word: &str| word.parse().ok().filter(|value: &f64| value.is_finite());
    let mut images = SlitImages::default();
    for (image, columns) in images.iter_mut().zip(columns.chunks(2)) {
        *image = match *columns {
            ["", ""] => None,
            [x, height] => Some(SlitImage {
                x_px: number(x)?,
                height_counts: number(height)?,
            }),
            _ => return None,
        };
    }
    Some(images)
}

/// A file of points, open to take more.
#[derive(Debug)]
pub struct PointsFile {
    path: PathBuf,
    /// At its end.
    file: File,
    points: Vec<Taken>,
    /// The last line was cut off; what was left of it.
    torn: Option<String>,
    begun_with: Option<Before>,
    /// The distances that were asked for, and the other distances at which a person took the points.
    asked: Vec<(f64, f64)>,
}

/// What a file's text holds.
struct Content {
    /// The lines before the points.
    first: Vec<String>,
    points: Vec<Taken>,
    /// Remarks below.
    remarks: Vec<String>,
    torn: Option<String>,
    /// The slits of the sensor.
    slits: Slits,
}

impl PointsFile {
    /// Opens a file for more points, or begins one. `found` is how the sensor was before the run, and
    /// `started` the time, as its first lines have them.
    ///
    /// # Errors There is such a file, but not of this program or of another sensor or setting; or it cannot
    /// be read or written.
    pub fn open(path: &Path, setup: &Setup, found: Before, started: &str) -> Result<Self> {
        let shown = path.display();
        let bytes = match std::fs::read(path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(error).with_context(|| format!("{shown} cannot be read")),
        };
        let mut content = if bytes.is_empty() {
            Content {
                first: heading(setup, found, started),
                points: Vec::new(),
                remarks: Vec::new(),
                torn: None,
                slits: setup.slits,
            }
        } else {
            let content =
                Content::read(&bytes).with_context(|| format!("{shown} stays as it is"))?;
            check_setup(&content.first, setup)
                .with_context(|| format!("{shown} stays as it is"))?;
            content
        };
        if let Some(torn) = &content.torn {
            content.remarks.push(format!("# cut off: {torn}"));
        }
        if bytes.is_empty() || content.torn.is_some() {
            content.write(path)?;
        }
        let file = open_to_append(path)?;
        Ok(Self {
            path: path.to_owned(),
            begun_with: begun_with(&content.first),
            asked: content
                .remarks
                .iter()
                .filter_map(|line| parse_asked(line))
                .collect(),
            file,
            points: content.points,
            torn: content.torn,
        })
    }

    /// The points in it.
    pub fn points(&self) -> &[Taken] {
        &self.points
    }

    /// The positions in millimetres that need no point any more: those of the points, and those for which a
    /// person took a point at another distance.
    pub fn done(&self) -> Vec<f64> {
        let is_there = |at: f64| self.points.iter().any(|point| point.d_mm == at);
        let asked = self.asked.iter().filter(|(_, at)| is_there(*at));
        let distances = self.points.iter().map(|point| point.d_mm);
        distances.chain(asked.map(|(asked, _)| *asked)).collect()
    }

    /// How the sensor was set before the run that began the file, as far as a run changes that. `None` where
    /// the file does not say.
    pub fn begun_with(&self) -> Option<Before> {
        self.begun_with
    }

    /// What was left of its last line, if that was cut off when it was opened.
    pub fn torn(&self) -> Option<&str> {
        self.torn.as_deref()
    }

    /// Adds a point. It is on the disk when this returns.
    ///
    /// # Errors
    /// It could not be written.
    pub fn add(&mut self, point: Taken) -> Result<()> {
        self.append(&point.to_string())?;
        self.points.push(point);
        Ok(())
    }

    /// Adds a point that stands for the position in millimetres that was asked for.
    ///
    /// # Errors
    /// It could not be written.
    pub fn add_for(&mut self, asked: f64, point: Taken) -> Result<()> {
        self.add(point)?;
        if point.d_mm != asked {
            let [of, at] = [asked, point.d_mm].map(Millimetres);
            self.remark(&format!("{ASKED}{of}{TAKEN_AT}{at} mm"))?;
            self.asked.push((asked, point.d_mm));
        }
        Ok(())
    }

    /// Takes the last point back: its line becomes a remark. Gives its distance in millimetres.
    ///
    /// # Errors
    /// The file could not be read or written.
    pub fn take_back(&mut self) -> Result<Option<f64>> {
        let mut content = self.content()?;
        let Some(point) = content.points.pop() else {
            return Ok(None);
        };
        content.remarks.push(format!("# taken back: {point}"));
        content.write(&self.path)?;
        self.file = open_to_append(&self.path)?;
        self.points.pop();
        Ok(Some(point.d_mm))
    }

    /// Adds a remark.
    ///
    /// # Errors
    /// It could not be written.
    pub fn remark(&mut self, text: &str) -> Result<()> {
        self.append(&format!("# {}", text.escape_debug()))
    }

    fn append(&mut self, line: &str) -> Result<()> {
        self.file
            .write_all(format!("{line}\n").as_bytes())
            .and_then(|()| self.file.sync_data())
            .with_context(|| {
                format!(
                    "{} cannot be written; the {} points in it are safe",
                    self.path.display(),
                    self.points.len()
                )
            })
    }

    fn content(&self) -> Result<Content> {
        let bytes = std::fs::read(&self.path)
            .with_context(|| format!("{} cannot be read", self.path.display()))?;
        Content::read(&bytes)
    }

    /// Puts the points in the order of their distances, as the fit wants them, and remarks below.
    ///
    /// # Errors
    /// The file could not be read or written; it is then as it was.
    pub fn put_in_order(self) -> Result<()> {
        if self.points.is_sorted_by(|a, b| a.d_mm <= b.d_mm) {
            return Ok(());
        }
        let mut content = self.content()?;
        content.points.sort_by(|a, b| a.d_mm.total_cmp(&b.d_mm));
        content.write(&self.path)
    }
}

fn open_to_append(path: &Path) -> Result<File> {
    (OpenOptions::new().append(true).open(path))
        .with_context(|| format!("{} cannot be written", path.display()))
}

// `# asked for 640.000 mm, taken at 646.000 mm`
const ASKED: &str = "asked for ";
const TAKEN_AT: &str = " mm, taken at ";

/// Both distances of such a remark.
fn parse_asked(remark: &str) -> Option<(f64, f64)> {
    let words = remark.strip_prefix("# ")?.strip_prefix(ASKED)?;
    let (asked, at) = words.strip_suffix(" mm")?.split_once(TAKEN_AT)?;
    Some((asked.parse().ok()?, at.parse().ok()?))
}

fn heading(setup: &Setup, found: Before, started: &str) -> Vec<String> {
    let mut lines = vec![TITLE.to_owned()];
    lines.extend(
        (setup.comments().into_iter())
            .filter_map(|(name, value)| Some(format!("# {name} {}", value?))),
    );
    if let Some(rows) = found.rows {
        lines.push(format!("# {}", Value::Rows(rows)));
    }
    lines.push(format!("# {}", Value::Stream(found.streamed)));
    lines.push(format!("# started {started}"));
    lines.extend(
        [
            "# x_px: the mean of the frames' centres. sigma_px: the larger of the frames' scatter and what \
             the sensor claims for a",
            "# frame, over the square root of their number. Frames of a target at rest share its speckle, \
             which is not in it: it",
            "# shows as residuals of the fit. width_px and shape_0_px to shape_4_px: the spot's shape.",
        ]
        .map(str::to_owned),
    );
    if setup.slits == Slits::Comb {
        let of_slits = "# slit_1_px, slit_1_counts and so on: the image of each slit of the comb, its centre \
                        and its height.";
        lines.push(of_slits.to_owned());
    }
    lines
}

impl Content {
    fn read(bytes: &[u8]) -> Result<Self> {
        // Whatever stands after the last line end was not written to its end.
        let end = bytes
            .iter()
            .rposition(|&byte| byte == b'\n')
            .map_or(0, |at| at + 1);
        let (whole, rest) = bytes.split_at(end);
        let mut content = Self {
            first: Vec::new(),
            points: Vec::new(),
            remarks: Vec::new(),
            torn: (!rest.is_empty()).then(|| rest.escape_ascii().to_string()),
            slits: Slits::One,
        };
        let text = std::str::from_utf8(whole).context("it is not text")?;
        ensure!(
            text.lines().next() == Some(TITLE),
            "it was not made by `calibrate run`, which goes on with its own files only: its first line is \
             not `{TITLE}`"
        );
        let mut lines = text.lines().zip(1..);
        for (line, number) in lines.by_ref() {
            if line == header(Slits::Comb) {
                content.slits = Slits::Comb;
                break;
            }
            if line == header(Slits::One) {
                break;
            }
            ensure!(
                line.is_empty() || line.starts_with('#'),
                "line {number}, `{}`, is no remark: expected {} above the points",
                line.escape_debug(),
                header(Slits::One)
            );
            content.first.push(line.to_owned());
        }
        for (line, number) in lines {
            if line.starts_with('#') {
                content.remarks.push(line.to_owned());
            } else if !line.trim().is_empty() {
                let point = Taken::parse(line).filter(|point| {
                    let is_of_comb = content.slits == Slits::Comb;
                    point.slits.is_some() == is_of_comb
                });
                let Some(point) = point else {
                    bail!(
                        "line {number}, `{}`, is no point: expected {}",
                        line.escape_debug(),
                        header(content.slits)
                    );
                };
                content.points.push(point);
            }
        }
        Ok(content)
    }

    /// Writes it to the disk under another name, and gives it the file's then: at no time is there neither.
    fn write(&self, path: &Path) -> Result<()> {
        let mut text = String::new();
        let points: Vec<String> = self.points.iter().map(ToString::to_string).collect();
        let header = [header(self.slits)];
        for line in [&self.first[..], &header, &points, &self.remarks]
            .into_iter()
            .flatten()
        {
            text.push_str(line);
            text.push('\n');
        }
        crate::whole_file::write(path, text.as_bytes())
    }
}

/// What a file's first lines say of rows and stream.
fn begun_with(first: &[String]) -> Option<Before> {
    let said = || {
        let lines = first.iter().filter_map(|line| line.strip_prefix("# "));
        lines.filter_map(|line| parse(line.as_bytes()).ok())
    };
    Some(Before {
        streamed: said().find_map(|command| match command {
            Command::Set(Value::Stream(on)) => Some(on),
            _ => None,
        })?,
        rows: Some(said().find_map(|command| match command {
            Command::Set(Value::Rows(rows)) => Some(rows),
            _ => None,
        })?),
    })
}

/// Checks that a file's first lines name the same setup.
fn check_setup(first: &[String], setup: &Setup) -> Result<()> {
    let mut found = Setup::default();
    for comment in first.iter().filter_map(|line| line.strip_prefix('#')) {
        found.read_comment(comment)?;
    }
    for (then, now) in found.unnamed().into_iter().zip(setup.unnamed()) {
        ensure!(
            then == now,
            "its points were taken with `{then}`, and the sensor is set to `{now}`: set it to that, or take \
             another file"
        );
    }
    for ((name, then), (_, now)) in found.comments().into_iter().zip(setup.comments()) {
        if matches!(name, "slits" | "region" | "peak") {
            continue;
        }
        let (Some(then), Some(now)) = (then, now) else {
            bail!(
                "it does not say with which {name} its points were taken: a line `# {name} ...` is missing"
            );
        };
        // A sensor gets its number with its first record; there may be points to add.
        let numberless = name == "serial" && then == "0";
        if then == now || numberless {
            continue;
        }
        match name {
            "estimator" | "black" => bail!(
                "its points were taken with `{name} {then}`, and the sensor is set to `{name} {now}`: set it \
                 to that, or take another file"
            ),
            "head" => bail!(
                "its points were taken with sensor head {then}, and this is {now}: take another file"
            ),
            _ => bail!(
                "its points were taken with the sensor of serial number {then}, and this one's is {now}: \
                 take another file"
            ),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use calibration::points::Points;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use slitrange::base::units::Counts;
    use slitrange::centre::Estimator;
    use slitrange::centre::spot_shape::COMPONENTS;
    use slitrange::light::black_level::BlackLevel;

    fn setup() -> Setup {
        Setup {
            head: Some("TCD1304DG".to_owned()),
            serial_number: Some(17),
            estimator: Some(Estimator::PhaseTable),
            black_level: Some(BlackLevel::Fixed(Counts::from_int(300))),
            ..Setup::default()
        }
    }

    const BEFORE: Before = Before {
        streamed: true,
        rows: Some(16),
    };

    /// Of whole steps: as many decimals as are written.
    fn steps(range: std::ops::Range<i64>, a_unit: f64) -> impl Strategy<Value = f64> {
        range.prop_map(move |steps| steps as f64 / a_unit)
    }

    prop_compose! {
        fn point()(
            x_px in steps(-500_000..4_096_000_000, 1e6),
            d_mm in prop_oneof![steps(-8_380_000..8_380_000, 1e3), -8380.0..8380.0],
            sigma_px in steps(1..100_000_000, 1e6),
            frames in 1..1000_usize,
            scatter_px in proptest::option::of(steps(0..100_000_000, 1e6)),
            claimed_px in steps(1..100_000_000, 1e6),
            misfits: u32,
            correlated: Option<u16>,
            height_counts in proptest::option::of(steps(1..40_950, 10.0)),
            shape in proptest::option::of((
                steps(1..100_000_000, 1e6),
                [(); COMPONENTS].map(|()| steps(-100_000_000..100_000_000, 1e6)),
            )),
        ) -> Taken {
            Taken {
                x_px, d_mm, sigma_px, frames, scatter_px, claimed_px, misfits, correlated,
                height_counts,
                shape: shape.map(|(width_px, components_px)| Shape { width_px, components_px }),
                slits: None,
            }
        }
    }

    /// A file with these points, and its path.
    fn file(directory: &tempfile::TempDir, points: &[Taken]) -> (PointsFile, PathBuf) {
        let path = directory.path().join("points.csv");
        let mut file = PointsFile::open(&path, &setup(), BEFORE, "today").expect("a file");
        for point in points {
            file.add(*point).expect("added");
        }
        (file, path)
    }

    fn sorted(mut points: Vec<Taken>) -> Vec<Taken> {
        points.sort_by(|a, b| a.d_mm.total_cmp(&b.d_mm));
        points
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 64,
            rng_seed: RngSeed::Fixed(6),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        #[test]
        fn points_are_read_as_they_were_written(points in prop::collection::vec(point(), 0..6)) {
            let directory = tempfile::tempdir().expect("a directory");
            let (mut written, path) = file(&directory, &points);
            written.remark("failed at\n600 mm").expect("remarked");
            prop_assert_eq!(written.points(), &points[..]);
            let read = PointsFile::open(&path, &setup(), BEFORE, "tomorrow").expect("a file");
            prop_assert_eq!(read.points(), &points[..]);
            prop_assert_eq!(read.torn(), None);
            prop_assert_eq!(read.begun_with(), Some(BEFORE));
            read.put_in_order().expect("in order");
            let read = PointsFile::open(&path, &setup(), BEFORE, "tomorrow").expect("a file");
            prop_assert_eq!(read.points(), &sorted(points)[..]);
            let text = std::fs::read_to_string(&path).expect("text");
            prop_assert!(text.ends_with("\n# failed at\\n600 mm\n"), "{}", text);
            prop_assert!(text.contains("\n# started today\n"));
        }

        /// Cuts the file off at any byte after its header, as a power failure may do.
        #[test]
        fn a_cut_off_line_loses_no_other_line(
            points in prop::collection::vec(point(), 1..5),
            part in 0.0..1.0,
            garbage in prop::collection::vec(
                any::<u8>().prop_filter("no line end", |byte| *byte != b'\n'),
                0..4,
            ),
        ) {
            let directory = tempfile::tempdir().expect("a directory");
            let (_, path) = file(&directory, &points);
            let mut bytes = std::fs::read(&path).expect("bytes");
            let lines = points.iter().map(|point| point.to_string().len() + 1).sum::<usize>();
            let cut = bytes.len() - (part * lines as f64) as usize;
            bytes.truncate(cut);
            bytes.extend(&garbage);
            let whole = bytes.iter().filter(|byte| **byte == b'\n').count();
            let lost = std::fs::read_to_string(&path).expect("text").lines().count() - whole;
            let left = &points[..points.len() - lost];
            std::fs::write(&path, &bytes).expect("written");
            let torn = !bytes.ends_with(b"\n");
            for torn in [torn, false] {
                let mut read = PointsFile::open(&path, &setup(), BEFORE, "tomorrow").expect("a file");
                prop_assert_eq!(read.points(), left);
                prop_assert_eq!(read.torn().is_some(), torn);
                read.remark("goes on").expect("remarked");
            }
        }
    }

    /// A person asked for 640 mm reads 646 mm off the ruler: that point stands for 640 mm, also after the
    /// file is opened again, until it is taken back.
    #[test]
    fn a_point_stands_for_the_position_that_was_asked_for() {
        let directory = tempfile::tempdir().expect("a directory");
        let point = |d_mm| Taken {
            x_px: 2_000_000.0 / (d_mm + 100.0),
            d_mm,
            sigma_px: 0.001,
            frames: 1,
            scatter_px: None,
            claimed_px: 0.001,
            misfits: 0,
            correlated: None,
            height_counts: None,
            shape: None,
            slits: None,
        };
        let (mut file, path) = file(&directory, &[]);
        file.add_for(610.0, point(610.0)).expect("added");
        file.add_for(640.0, point(646.0)).expect("added");
        assert_eq!(file.done(), [610.0, 646.0, 640.0]);
        let again = || PointsFile::open(&path, &setup(), BEFORE, "today").expect("a file");
        assert_eq!(again().done(), [610.0, 646.0, 640.0]);
        assert_eq!(file.take_back().expect("taken back"), Some(646.0));
        assert_eq!((file.done(), again().done()), (vec![610.0], vec![610.0]));
        file.add(point(650.0)).expect("added");
        assert_eq!(again().done(), [610.0, 650.0]);
        let text = std::fs::read_to_string(&path).expect("text");
        assert!(
            text.contains("\n# taken back: ") && text.contains(",646.000,"),
            "{text}"
        );
        for _ in 0..2 {
            file.take_back().expect("taken back");
        }
        assert_eq!(file.take_back().expect("nothing"), None);
    }

    #[test]
    fn the_file_is_as_documented() {
        let directory = tempfile::tempdir().expect("a directory");
        let point = Taken {
            x_px: 1770.98771,
            d_mm: 800.0,
            sigma_px: 0.0007,
            frames: 8,
            scatter_px: Some(0.00195),
            claimed_px: 0.0019,
            misfits: 0,
            correlated: Some(3),
            height_counts: Some(1011.0),
            shape: Some(Shape {
                width_px: 7.62131,
                components_px: [0.00012, -0.0031, 0.01203, 0.0001, -0.0002],
            }),
            slits: None,
        };
        let typed = Taken {
            d_mm: 810.12345,
            scatter_px: None,
            correlated: None,
            height_counts: None,
            shape: None,
            ..point
        };
        let (_, path) = file(&directory, &[point, typed]);
        insta::assert_snapshot!(std::fs::read_to_string(path).expect("text"));
    }

    #[test]
    fn a_file_of_a_comb_has_a_column_for_each_slit() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("points.csv");
        let comb = Setup {
            slits: Slits::Comb,
            ..setup()
        };
        let images: SlitImages = std::array::from_fn(|slit| {
            (slit != 3).then_some(SlitImage {
                x_px: (900_000_001 + 100_000_000 * slit) as f64 / 1e6,
                height_counts: 1830.5,
            })
        });
        let point = Taken {
            x_px: 1770.98771,
            d_mm: 800.0,
            sigma_px: 0.0007,
            frames: 8,
            scatter_px: None,
            claimed_px: 0.0019,
            misfits: 0,
            correlated: None,
            height_counts: Some(1011.0),
            shape: None,
            slits: Some(images),
        };
        let mut file = PointsFile::open(&path, &comb, BEFORE, "today").expect("a file");
        file.add(point).expect("added");
        let mut again = PointsFile::open(&path, &comb, BEFORE, "today").expect("a file");
        assert_eq!(again.points(), [point]);
        let nearer = Taken {
            x_px: 1800.0,
            d_mm: 790.0,
            ..point
        };
        again.add(nearer).expect("added");
        again.put_in_order().expect("in order");
        let again = PointsFile::open(&path, &comb, BEFORE, "today").expect("a file");
        assert_eq!(again.points(), [nearer, point]);
        // The fit finds all of it.
        let read = Points::read(&path).expect("points");
        assert_eq!(read.setup.slits, Slits::Comb);
        assert_eq!(read.points[1].slits, Some(images));
        // A sensor that is set otherwise does not go on with the file.
        let error = PointsFile::open(&path, &setup(), BEFORE, "today").expect_err("refused");
        println!("{error:#}");
        assert!(
            format!("{error:#}").contains("`slits comb`, and the sensor is set to `slits one`")
        );
    }

    #[test]
    fn an_empty_file_is_begun() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("points.csv");
        std::fs::write(&path, "").expect("written");
        let file = PointsFile::open(&path, &setup(), BEFORE, "today").expect("begun");
        assert!(file.points().is_empty());
    }
}
