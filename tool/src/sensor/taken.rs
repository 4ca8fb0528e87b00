//! The file of points that a run takes: none that is in it is ever lost.
//!
//! It is CSV that `calibrate fit` reads, with remarks on lines of their own. A point is appended and flushed
//! to the disk before the target moves on. What changes other than at its end is written as another file,
//! which then takes its name.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use calibration::points::{Setup, Shape, SlitImages, TITLE, columns};
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::frame::comb::Slits;
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
        match (self.0 * 1000.0).round() / 1000.0 == self.0 {
            true => write!(f, "{:.3}", self.0),
            false => write!(f, "{}", self.0),
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
        let six = |number: f64| format!("{number:.6}");
        let one = |number: f64| format!("{number:.1}");
        let mut columns = vec![
            Some(six(self.x_px)),
            Some(Millimetres(self.d_mm).to_string()),
            Some(six(self.sigma_px)),
            Some(self.frames.to_string()),
            self.scatter_px.map(six),
            Some(six(self.claimed_px)),
            Some(self.misfits.to_string()),
            self.correlated.map(|rows| rows.to_string()),
            self.height_counts.map(one),
            self.shape.map(|shape| six(shape.width_px)),
        ];
        columns.extend((0..COMPONENTS).map(|index| Some(six(self.shape?.components_px[index]))));
        for image in self.slits.iter().flatten() {
            columns.push(image.map(|image| six(image.x_px)));
            columns.push(image.map(|image| one(image.height_counts)));
        }
        let columns: Vec<String> = columns.into_iter().map(Option::unwrap_or_default).collect();
        f.write_str(&columns.join(","))
    }
}

/// A point's line in the file, and what a run needs of it.
#[derive(Clone, Debug, PartialEq)]
pub struct PointLine {
    text: String,
    /// The centre in pixels.
    pub x_px: f64,
    /// The target's distance in millimetres.
    pub d_mm: f64,
    /// The standard uncertainty of the centre in pixels.
    pub sigma_px: f64,
}

impl From<&Taken> for PointLine {
    fn from(point: &Taken) -> Self {
        Self {
            text: point.to_string(),
            x_px: point.x_px,
            d_mm: point.d_mm,
            sigma_px: point.sigma_px,
        }
    }
}

impl PointLine {
    /// Reads a line of a file from a sensor with these slits. `None` if a column is missing or is no number.
    fn parse(text: &str, slits: Slits) -> Option<Self> {
        let columns: Vec<&str> = text.split(',').map(str::trim).collect();
        let number = |word: &str| word.parse().ok().filter(|value: &f64| value.is_finite());
        let is_usable = |word: &&str| word.is_empty() || number(word).is_some();
        let is_whole = columns.len() == header(slits).split(',').count();
        let &[x, d, sigma, frames, _, claimed, misfits, ..] = columns.as_slice() else {
            return None;
        };
        let has_counts = frames.parse::<usize>().is_ok() && misfits.parse::<u32>().is_ok();
        number(claimed)?;
        (is_whole && has_counts && columns.iter().all(is_usable)).then_some(Self {
            text: text.to_owned(),
            x_px: number(x)?,
            d_mm: number(d)?,
            sigma_px: number(sigma)?,
        })
    }
}

/// A file of points, open to take more.
#[derive(Debug)]
pub struct PointsFile {
    path: PathBuf,
    /// At its end.
    file: File,
    content: Content,
}

#[derive(Debug, Default)]
struct Content {
    /// The lines before the points.
    first: Vec<String>,
    points: Vec<PointLine>,
    /// Remarks below.
    remarks: Vec<String>,
    /// The last line was cut off; what was left of it.
    torn: Option<String>,
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
                slits: setup.slits,
                ..Content::default()
            }
        } else {
            let content = Content::read(&bytes).and_then(|content| {
                check_setup(&content.first, setup)?;
                Ok(content)
            });
            content.with_context(|| format!("{shown} stays as it is"))?
        };
        if let Some(torn) = &content.torn {
            content.remarks.push(format!("# cut off: {torn}"));
        }
        if bytes.is_empty() || content.torn.is_some() {
            content.write(path)?;
        }
        Ok(Self {
            path: path.to_owned(),
            file: open_to_append(path)?,
            content,
        })
    }

    /// The points in it.
    pub fn points(&self) -> &[PointLine] {
        &self.content.points
    }

    /// The positions in millimetres that need no point any more: those of the points, and those for which a
    /// person took a point at another distance.
    pub fn done(&self) -> Vec<f64> {
        let mut done: Vec<f64> = self.points().iter().map(|point| point.d_mm).collect();
        let asked = self.content.remarks.iter();
        let asked: Vec<(f64, f64)> = asked.filter_map(|line| parse_asked(line)).collect();
        let is_there = asked.iter().filter(|(_, at)| done.contains(at));
        done.extend(is_there.map(|(asked, _)| *asked).collect::<Vec<f64>>());
        done
    }

    /// How the sensor was set before the run that began the file, as far as a run changes that. `None` where
    /// the file does not say.
    pub fn begun_with(&self) -> Option<Before> {
        let (mut streamed, mut rows) = (None, None);
        let remarks = self.content.first.iter();
        for line in remarks.filter_map(|line| line.strip_prefix("# ")) {
            match parse(line.as_bytes()) {
                Ok(Command::Set(Value::Stream(on))) => _ = streamed.get_or_insert(on),
                Ok(Command::Set(Value::Rows(count))) => _ = rows.get_or_insert(count),
                _ => {}
            }
        }
        let (streamed, rows) = (streamed?, Some(rows?));
        Some(Before { streamed, rows })
    }

    /// What was left of its last line, if that was cut off when it was opened.
    pub fn torn(&self) -> Option<&str> {
        self.content.torn.as_deref()
    }

    /// Adds a point. It is on the disk when this returns.
    pub fn add(&mut self, point: Taken) -> Result<()> {
        let line = PointLine::from(&point);
        self.append(&line.text)?;
        self.content.points.push(line);
        Ok(())
    }

    /// Adds a point that stands for the position in millimetres that was asked for.
    pub fn add_for(&mut self, asked: f64, point: Taken) -> Result<()> {
        self.add(point)?;
        let [of, at] = [asked, point.d_mm].map(Millimetres);
        match point.d_mm == asked {
            true => Ok(()),
            false => self.remark(&format!("{ASKED}{of}{TAKEN_AT}{at} mm")),
        }
    }

    /// Takes the last point back: its line becomes a remark. Gives its distance in millimetres.
    pub fn take_back(&mut self) -> Result<Option<f64>> {
        self.read_again()?;
        let content = &mut self.content;
        let Some(point) = content.points.pop() else {
            return Ok(None);
        };
        (content.remarks).push(format!("# taken back: {}", point.text));
        content.write(&self.path)?;
        self.file = open_to_append(&self.path)?;
        Ok(Some(point.d_mm))
    }

    /// Adds a remark.
    pub fn remark(&mut self, text: &str) -> Result<()> {
        let line = format!("# {}", text.escape_debug());
        self.append(&line)?;
        self.content.remarks.push(line);
        Ok(())
    }

    fn append(&mut self, line: &str) -> Result<()> {
        let written = self.file.write_all(format!("{line}\n").as_bytes());
        written
            .and_then(|()| self.file.sync_data())
            .with_context(|| {
                let (path, count) = (self.path.display(), self.points().len());
                format!("{path} cannot be written; the {count} points in it are safe")
            })
    }

    /// What another program wrote into the file meanwhile is to stay in it.
    fn read_again(&mut self) -> Result<()> {
        let bytes = std::fs::read(&self.path);
        let bytes = bytes.with_context(|| format!("{} cannot be read", self.path.display()))?;
        let torn = self.content.torn.take();
        self.content = Content {
            torn,
            ..Content::read(&bytes)?
        };
        Ok(())
    }

    /// Puts the points in the order of their distances, as the fit wants them, and remarks below.
    ///
    /// # Errors
    /// The file could not be read or written; it is then as it was.
    pub fn put_in_order(mut self) -> Result<()> {
        if self.points().is_sorted_by(|a, b| a.d_mm <= b.d_mm) {
            return Ok(());
        }
        self.read_again()?;
        let points = &mut self.content.points;
        points.sort_by(|a, b| a.d_mm.total_cmp(&b.d_mm));
        self.content.write(&self.path)
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
    let setup_lines = setup.comments().into_iter();
    lines.extend(setup_lines.filter_map(|(name, value)| Some(format!("# {name} {}", value?))));
    lines.extend(found.rows.map(|rows| format!("# {}", Value::Rows(rows))));
    lines.push(format!("# {}", Value::Stream(found.streamed)));
    lines.push(format!("# started {started}"));
    let of_comb = match setup.slits {
        Slits::One => 3,
        Slits::Comb => 4,
    };
    lines.extend(COLUMNS.lines().take(of_comb).map(str::to_owned));
    lines
}

/// What the columns hold. The last line is that of a comb.
const COLUMNS: &str = "\
    # x_px: the mean of the frames' centres. sigma_px: the larger of the frames' scatter and what the sensor \
    claims for a\n\
    # frame, over the square root of their number. Frames of a target at rest share its speckle, which is not \
    in it: it\n\
    # shows as residuals of the fit. width_px and shape_0_px to shape_4_px: the spot's shape.\n\
    # slit_1_px, slit_1_counts and so on: the image of each slit of the comb, its centre and its height.";

impl Content {
    fn read(bytes: &[u8]) -> Result<Self> {
        // Whatever stands after the last line end was not written to its end.
        let end = bytes.iter().rposition(|&byte| byte == b'\n');
        let (whole, rest) = bytes.split_at(end.map_or(0, |at| at + 1));
        let mut content = Self {
            torn: (!rest.is_empty()).then(|| rest.escape_ascii().to_string()),
            ..Self::default()
        };
        let text = std::str::from_utf8(whole).map_err(|error| {
            let before = &whole[..error.valid_up_to()];
            let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
            anyhow!("line {line} is not text: delete that line, and its point is taken again")
        })?;
        ensure!(
            text.lines().next() == Some(TITLE),
            "it was not made by `calibrate run`, which goes on with its own files only: its first line is \
             not `{TITLE}`"
        );
        let mut lines = text.lines().zip(1..);
        for (line, number) in lines.by_ref() {
            if let Some(slits) = [Slits::One, Slits::Comb]
                .iter()
                .find(|it| line == header(**it))
            {
                content.slits = *slits;
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
                let point = PointLine::parse(line, content.slits).with_context(|| {
                    let line = line.escape_debug();
                    let header = header(content.slits);
                    format!(
                        "line {number}, `{line}`, is no point: delete that line, and its point is taken \
                         again; expected {header}"
                    )
                })?;
                content.points.push(point);
            }
        }
        Ok(content)
    }

    /// Writes it to the disk under another name, and gives it the file's then: at no time is there neither.
    fn write(&self, path: &Path) -> Result<()> {
        let header = [header(self.slits)];
        let points = self.points.iter().map(|point| &point.text);
        let lines = (self.first.iter().chain(&header)).chain(points.chain(&self.remarks));
        let text: String = lines.map(|line| format!("{line}\n")).collect();
        crate::whole_file::write(path, text.as_bytes())
    }
}

/// Checks that a file's first lines name the same setup.
fn check_setup(first: &[String], setup: &Setup) -> Result<()> {
    let mut found = Setup::default();
    for comment in first.iter().filter_map(|line| line.strip_prefix('#')) {
        found.read_comment(comment)?;
    }
    let other = |then: &str, now: &str| {
        anyhow!(
            "its points were taken with `{then}`, and the sensor is set to `{now}`: set it to that, or take \
             another file"
        )
    };
    for (then, now) in found.unnamed().into_iter().zip(setup.unnamed()) {
        ensure!(then == now, other(&then.to_string(), &now.to_string()));
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
            "estimator" | "black" => {
                return Err(other(&format!("{name} {then}"), &format!("{name} {now}")));
            }
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
    use calibration::points::{KnownShape, Point, Points, SlitImage};
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use simulator::with;
    use slitrange::base::units::Counts;
    use slitrange::centre::Estimator;
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
            x_px in steps(-500_000..3_647_500_000, 1e6),
            d_mm in prop_oneof![steps(-8_380_000..8_380_000, 1e3), -8380.0..8380.0],
            sigma_px in steps(10..100_000_000, 1e6),
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

    /// A point without what a sensor may leave out.
    const PLAIN: Taken = Taken {
        x_px: 1770.98771,
        d_mm: 800.0,
        sigma_px: 0.0007,
        frames: 8,
        scatter_px: None,
        claimed_px: 0.0019,
        misfits: 0,
        correlated: None,
        height_counts: None,
        shape: None,
        slits: None,
    };

    /// A file with these points, its path, and its directory.
    fn file(points: &[Taken]) -> (PointsFile, PathBuf, tempfile::TempDir) {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("points.csv");
        let mut file = PointsFile::open(&path, &setup(), BEFORE, "today").expect("a file");
        for point in points {
            file.add(*point).expect("added");
        }
        (file, path, directory)
    }

    /// The same file once more.
    fn again(path: &Path) -> PointsFile {
        PointsFile::open(path, &setup(), BEFORE, "tomorrow").expect("a file")
    }

    fn lines(points: &[Taken]) -> Vec<PointLine> {
        points.iter().map(PointLine::from).collect()
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
            let (mut written, path, _directory) = file(&points);
            written.remark("failed at\n600 mm").expect("remarked");
            prop_assert_eq!(written.points(), lines(&points));
            let read = again(&path);
            prop_assert_eq!(read.points(), lines(&points));
            prop_assert_eq!((read.torn(), read.begun_with()), (None, Some(BEFORE)));
            read.put_in_order().expect("in order");
            let mut sorted = points;
            sorted.sort_by(|a, b| a.d_mm.total_cmp(&b.d_mm));
            let read = again(&path);
            prop_assert_eq!(read.points(), lines(&sorted));
            // The fit finds the same numbers.
            for (read, point) in Points::read(&path).expect("points").points.iter().zip(&sorted) {
                let noise_px = point.claimed_px / (point.frames as f64).sqrt();
                prop_assert_eq!(*read, Point {
                    line: read.line,
                    x_px: point.x_px,
                    d_mm: point.d_mm,
                    sigma_px: Some(point.sigma_px),
                    height_counts: point.height_counts,
                    shape: point.shape.map(|shape| KnownShape { shape, noise_px }),
                    slits: None,
                });
            }
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
            let (_, path, _directory) = file(&points);
            let mut bytes = std::fs::read(&path).expect("bytes");
            let length = points.iter().map(|point| point.to_string().len() + 1).sum::<usize>();
            let cut = bytes.len() - (part * length as f64) as usize;
            bytes.truncate(cut);
            bytes.extend(&garbage);
            let whole = bytes.iter().filter(|byte| **byte == b'\n').count();
            let lost = std::fs::read_to_string(&path).expect("text").lines().count() - whole;
            let left = lines(&points[..points.len() - lost]);
            std::fs::write(&path, &bytes).expect("written");
            let torn = !bytes.ends_with(b"\n");
            for torn in [torn, false] {
                let mut read = again(&path);
                prop_assert_eq!(read.points(), &left[..]);
                prop_assert_eq!(read.torn().is_some(), torn);
                read.remark("goes on").expect("remarked");
            }
        }
    }

    /// A person asked for 640 mm reads 646 mm off the ruler: that point stands for 640 mm, also after the
    /// file is opened again, until it is taken back.
    #[test]
    fn a_point_stands_for_the_position_that_was_asked_for() {
        let point = |d_mm| Taken { d_mm, ..PLAIN };
        let (mut file, path, _directory) = file(&[]);
        file.add_for(610.0, point(610.0)).expect("added");
        file.add_for(640.0, point(646.0)).expect("added");
        assert_eq!(file.done(), [610.0, 646.0, 640.0]);
        assert_eq!(again(&path).done(), [610.0, 646.0, 640.0]);
        assert_eq!(file.take_back().expect("taken back"), Some(646.0));
        assert_eq!(
            (file.done(), again(&path).done()),
            (vec![610.0], vec![610.0])
        );
        file.add(point(650.0)).expect("added");
        assert_eq!(again(&path).done(), [610.0, 650.0]);
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
        let point = Taken {
            scatter_px: Some(0.00195),
            correlated: Some(3),
            height_counts: Some(1011.0),
            shape: Some(Shape {
                width_px: 7.62131,
                components_px: [0.00012, -0.0031, 0.01203, 0.0001, -0.0002],
            }),
            ..PLAIN
        };
        let d_mm = 810.12345;
        let typed = Taken { d_mm, ..PLAIN };
        let (_, path, _directory) = file(&[point, typed]);
        insta::assert_snapshot!(std::fs::read_to_string(path).expect("text"));
    }

    #[test]
    fn a_file_of_a_comb_has_a_column_for_each_slit() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("points.csv");
        let comb = with(setup(), |it| it.slits = Slits::Comb);
        let images: SlitImages = std::array::from_fn(|slit| {
            let x_px = (900_000_001 + 100_000_000 * slit) as f64 / 1e6;
            (slit != 3).then_some(SlitImage::new(x_px, 1830.5))
        });
        let point = with(PLAIN, |it| {
            (it.height_counts, it.slits) = (Some(1011.0), Some(images))
        });
        let open = || PointsFile::open(&path, &comb, BEFORE, "today").expect("a file");
        open().add(point).expect("added");
        let mut again = open();
        assert_eq!(again.points(), lines(&[point]));
        let nearer = with(point, |it| (it.x_px, it.d_mm) = (1800.0, 790.0));
        again.add(nearer).expect("added");
        again.put_in_order().expect("in order");
        assert_eq!(open().points(), lines(&[nearer, point]));
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
    fn a_line_that_another_program_adds_stays() {
        let points = [640.0, 610.0].map(|d_mm| Taken { d_mm, ..PLAIN });
        let (mut file, path, _directory) = file(&points);
        let mut other = open_to_append(&path).expect("the file");
        other.write_all(b"# by hand\n").expect("written");
        assert_eq!(file.take_back().expect("taken back"), Some(610.0));
        other = open_to_append(&path).expect("the file");
        other.write_all(b"# once more\n").expect("written");
        file.add(points[1]).expect("added");
        file.put_in_order().expect("in order");
        let text = std::fs::read_to_string(&path).expect("text");
        let stays = text.contains("# by hand\n") && text.contains("# once more\n");
        assert!(stays, "{text}");
    }

    #[test]
    fn an_empty_file_is_begun() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("points.csv");
        std::fs::write(&path, "").expect("written");
        assert!(again(&path).points().is_empty());
    }
}
