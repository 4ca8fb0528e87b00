//! Points of known distance, taken from a sensor one by one.

use std::io::{BufRead, Write};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use calibration::points::{Setup, Shape, SlitImage, SlitImages};
use slitrange::base::exposure::Exposure;
use slitrange::centre::Estimator;
use slitrange::frame::MAX_ROWS;
use slitrange::frame::comb::Slits;
use slitrange_device::protocol::command::Command;
use slitrange_device::settings::{Setting, Value};
use statistics::{least_and_most, mean, rms, standard_deviation, upper_median};

use super::answers::{Centre, NoCentre};
use super::line::LineError;
use super::port::PortOption;
use super::positions::{self, Moved, Mover, Which, check_command};
use super::session::{Before, Session};
use super::taken::{Millimetres, PointLine, PointsFile, Taken};
use crate::pc::{Pc, utc};
use crate::whole_file;

/// How often a position is tried with a stage, which cannot be asked.
const TRIES: usize = 3;
/// Frames further than this many times their scatter from the others are no matter of chance: a digit that
/// noise on the line changed, or a target that was not at rest.
const OUTLYING: f64 = 10.0;
/// A target at rest moves its centre by less, in pixels: fifty times the noise of a point, for a laser that
/// warms up. It is 0.07 mm at the farther end of the nominal range.
const AT_REST_PX: f64 = 0.1;
/// Standard deviations within which centres may differ by noise.
const NOISE: f64 = 5.0;
/// Eq. (1) of the nominal geometry, [`slitrange::distance::eq1::NOMINAL`], and the farther end of its range.
const NOMINAL_D_MM: f64 = -115.385;
const NOMINAL_K_MM_PX: f64 = 2_152_367.0;
const FARTHEST_MM: f64 = 1100.0;
/// The finest step of the sensor's centres, in pixels: no point claims to be better known.
const FINEST_PX: f64 = 1e-5;

/// Take points for a calibration: what the sensor sees at distances that a person or a stage sets
///
/// Moves the target, or asks you to, from one distance to the next. At each, the frame under way is passed
/// over and --frames frames are taken; their mean centre, its uncertainty and what the sensor flagged become
/// a line of FILE. What is in FILE is safe whatever happens (Ctrl-C, a cable that falls out, a sensor
/// without power): run the same command again, and it goes on with the distances that are missing.
///
/// The sensor takes 64 rows a frame and does not stream meanwhile; both are put back at the end (if the
/// program is killed, by the next run that goes on with FILE). Its estimator and black level stay as they
/// are, and are what the calibration will hold for: set them before.
#[derive(Clone, Debug, clap::Args)]
#[command(
    override_usage = "\
slitrange calibrate run [--port PORT] --from MM --to MM [OPTIONS] FILE
       slitrange calibrate run [--port PORT] --positions LIST [OPTIONS] FILE",
    after_help = include_str!("run.help.txt").trim_ascii_end()
)]
pub struct RunOptions {
    /// The points: a CSV file, begun or gone on with
    #[arg(value_parser = whole_file::output)]
    file: PathBuf,
    #[command(flatten)]
    port: PortOption,
    /// Where the target is to be.
    #[command(flatten)]
    which: Which,
    /// A program that moves the target, as a line for the shell: {} is replaced by the distance in
    /// millimetres. It must not return before the target is there
    #[arg(long, value_name = "COMMAND")]
    stage_command: Option<String>,
    /// How long to wait after each move of the stage
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 0.0,
        requires = "stage_command"
    )]
    settle: f64,
    /// Frames at each position. They average noise, but not the speckle that a target at rest keeps: more
    /// positions do
    #[arg(
        long,
        value_name = "N",
        default_value_t = 8,
        value_parser = clap::value_parser!(u16).range(1..=1000)
    )]
    frames: u16,
}

/// `calibrate run`. `input` is what a person types.
///
/// # Errors
/// In sentences: what stopped the run. The points taken are in the file.
pub fn run(
    options: &RunOptions,
    pc: &dyn Pc,
    input: &mut dyn BufRead,
    output: &mut dyn Write,
) -> Result<()> {
    let wanted = options.which.list(options.stage_command.is_none())?;
    let settle = Duration::try_from_secs_f64(options.settle)
        .with_context(|| format!("--settle {}", options.settle))?;
    let mover = match &options.stage_command {
        Some(command) => {
            check_command(command)?;
            Mover::Stage(command)
        }
        None => Mover::person(input, &wanted),
    };
    // From now on, Ctrl-C ends the run in order.
    pc.interrupted();
    let mut session = options.port.open(pc)?;
    let setup = ask_setup(&mut session)?;
    let found = session.before()?;
    let mut file = PointsFile::open(&options.file, &setup, found, &utc())?;
    // That is how a run that was killed leaves the sensor.
    let left_behind = Before {
        streamed: false,
        rows: Some(MAX_ROWS as u16),
    };
    if found == left_behind
        && let Some(begun_with) = file.begun_with()
    {
        session.put_back_instead(begun_with);
    }
    if let Some(torn) = file.torn() {
        writeln!(
            output,
            "the last line was cut off and is a remark now: {torn}"
        )?;
    }
    let missing = positions::missing(&wanted, &file.done());
    let settings: Vec<String> = settings(&setup).map(|it| it.to_string()).collect();
    let (head, port, settings) = (session.head(), session.port(), settings.join(", "));
    let (to_go, all) = (missing.len(), wanted.len());
    writeln!(
        output,
        "sensor {head} at {port}, {settings}: {to_go} of {all} positions to go"
    )?;
    let walk = Walk {
        session,
        setup,
        mover,
        settle,
        frames: usize::from(options.frames),
        output,
    }
    .through(&missing, &mut file);
    let left = positions::missing(&wanted, &file.done());
    let taken = file.points().len();
    // In any case: it goes on at once with what there is.
    file.put_in_order()?;
    let path = options.file.display();
    write!(output, "{taken} points are in {path}")?;
    match left.as_slice() {
        [] => writeln!(output, ", and no position is left")?,
        left => {
            let (count, list) = (left.len(), list(left));
            writeln!(output, "; {count} of {all} positions are left: {list}")?;
        }
    }
    let stopped_by_hand = walk.context("stopped; run the same command again to go on")?;
    ensure!(
        left.is_empty() || stopped_by_hand,
        "there is no point at {}: run the same command again to go on",
        list(&left)
    );
    Ok(())
}

/// Distances as a person reads them: `600, 610 mm`.
fn list(distances: &[f64]) -> String {
    let words: Vec<String> = distances.iter().map(f64::to_string).collect();
    format!("{} mm", words.join(", "))
}

fn ask_setup(session: &mut Session<'_>) -> Result<Setup, LineError> {
    let record = session.calibration()?.record;
    let mut setup = Setup {
        head: Some(session.head().to_owned()),
        serial_number: Some(record.map_or(0, |record| record.serial_number)),
        ..Setup::default()
    };
    for setting in [
        Setting::Estimator,
        Setting::Black,
        Setting::Slits,
        Setting::Region,
        Setting::SpotChoice,
    ] {
        setup.take(session.value(setting)?);
    }
    Ok(setup)
}

fn settings(setup: &Setup) -> impl Iterator<Item = Value> {
    let estimator = setup.estimator.map(Value::Estimator);
    let default = Setup::default().unnamed();
    let others = setup.unnamed().into_iter();
    let known = estimator.into_iter();
    let known = known.chain(setup.black_level.map(Value::Black));
    known.chain(others.filter(move |value| !default.contains(value)))
}

struct Walk<'a> {
    session: Session<'a>,
    setup: Setup,
    mover: Mover<'a>,
    /// How long the target swings after a move of the stage.
    settle: Duration,
    frames: usize,
    output: &'a mut dyn Write,
}

const INTERRUPTED: &str = "stopped by Ctrl-C";

impl Walk<'_> {
    /// Takes the points that are missing, and gives whether a person stopped it, or skipped a position.
    fn through(mut self, missing: &[f64], file: &mut PointsFile) -> Result<bool> {
        self.session.borrow_rows(MAX_ROWS as u16)?;
        // The places in `missing` of the points of this run, in the order in which they were taken.
        let mut done: Vec<usize> = Vec::new();
        let mut unmoved = None;
        let mut tries = 0;
        let mut index = 0;
        let mut stopped = false;
        loop {
            let position = missing.get(index).copied();
            let moved = match position {
                Some(mm) => self.mover.to(mm, self.output),
                None if done.is_empty() => return Ok(stopped),
                None => self.mover.finish(self.output),
            };
            // A stage's program ends with Ctrl-C, too.
            self.check_interrupt()?;
            let (moved, position) = (moved?, position.unwrap_or_default());
            let place = format!("{:>3}/{}", index + 1, missing.len());
            let point = match moved {
                Moved::To(mm) if file.points().iter().any(|point| point.d_mm == mm) => {
                    writeln!(self.output, "there is a point at {mm} mm already")?;
                    continue;
                }
                Moved::To(mm) => {
                    unmoved = None;
                    self.session.line().pc().sleep(self.settle);
                    match self.point(mm) {
                        Ok(Ok(point)) => match at_rest(file.points(), &point) {
                            Some(other) => {
                                unmoved = Some(point);
                                let no_point = format!(
                                    "the centre, {:.3} px, is that of the point at {} mm: the target did not \
                                     move (move it; or type t to take the point all the same)",
                                    point.x_px, other.d_mm
                                );
                                Err((mm, no_point))
                            }
                            None => Ok(point),
                        },
                        Ok(Err(no_point)) => Err((mm, no_point)),
                        Err(error) if error.may_pass() => {
                            writeln!(self.output, "{error}; waits for it to come back")?;
                            self = self.reconnect()?;
                            continue;
                        }
                        Err(error) => return Err(error.into()),
                    }
                }
                Moved::Stayed => match unmoved.take() {
                    Some(point) => Ok(point),
                    None => {
                        writeln!(self.output, "there is no point to take")?;
                        continue;
                    }
                },
                Moved::Skip => {
                    (stopped, unmoved) = (true, None);
                    index += 1;
                    continue;
                }
                Moved::Back => {
                    if let Some(last) = done.pop() {
                        let mm = file.take_back()?.unwrap_or_default();
                        writeln!(self.output, "the point at {mm} mm is taken back")?;
                        (index, unmoved) = (last, None);
                    } else {
                        writeln!(self.output, "this run has no point to take back")?;
                    }
                    continue;
                }
                Moved::Quit => return Ok(stopped || index < missing.len()),
                Moved::End => bail!("the input ended, with {} left", list(&missing[index..])),
            };
            match point {
                Ok(point) => {
                    file.add_for(position, point)?;
                    self.report(&place, &point)?;
                    done.push(index);
                    (index, tries) = (index + 1, 0);
                }
                Err((mm, no_point)) => {
                    self.check_interrupt()?;
                    writeln!(self.output, "{place}  {mm} mm  {no_point}")?;
                    tries += 1;
                    if matches!(self.mover, Mover::Stage(_)) && tries >= TRIES {
                        file.remark(&format!("failed at {} mm: {no_point}", Millimetres(mm)))?;
                        (index, tries) = (index + 1, 0);
                    }
                }
            }
        }
    }

    fn check_interrupt(&mut self) -> Result<()> {
        ensure!(!self.session.line().pc().interrupted(), INTERRUPTED);
        Ok(())
    }

    /// What the sensor sees now, or why there is no point.
    fn point(&mut self, d_mm: f64) -> Result<Result<Taken, String>, LineError> {
        // The frame under way began while the target moved.
        let _ = self.session.centre()?;
        let mut centres: Vec<Centre> = Vec::new();
        // A line that noise changed is made up for; twice as many frames are a target that is not at rest.
        for _ in 0..2 * self.frames {
            if self.session.line().pc().interrupted() {
                return Ok(Err(INTERRUPTED.to_owned()));
            }
            match self.centre()? {
                Ok(centre) => centres.push(centre),
                Err(NoCentre { fault, advice }) => return Ok(Err(format!("{fault} ({advice})"))),
            }
            if centres.len() >= self.frames {
                let close = without_outlying(&centres);
                if close.len() >= self.frames {
                    return Ok(Ok(taken(d_mm, &close)));
                }
            }
        }
        let (least, most) = least_and_most(centres.iter().map(|centre| centre.x_px));
        Ok(Err(format!(
            "the frames' centres lie from {least:.3} to {most:.3} px, most of them close together (let the \
             target come to rest)"
        )))
    }

    /// A frame's centre, of a sensor that is set as it was.
    fn centre(&mut self) -> Result<Result<Centre, NoCentre>, LineError> {
        let answer = self.session.centre()?;
        match &answer {
            Ok(centre)
                if u32::from(centre.rows) != MAX_ROWS
                    || centre.slits.is_some() != (self.setup.slits == Slits::Comb)
                    || Some(centre.estimator) != self.setup.estimator.map(Estimator::letter) =>
            {
                let (rows, estimator) = (centre.rows, centre.estimator);
                let banner = format!("{rows} rows a frame, estimator {estimator}");
                Err(LineError::Restarted(banner))
            }
            _ => Ok(answer),
        }
    }

    /// Goes on with the sensor after it went away: the same one, set as it was.
    fn reconnect(mut self) -> Result<Self> {
        self.session = self.session.reopen()?;
        let now = ask_setup(&mut self.session)?;
        ensure!(
            now.head == self.setup.head && now.serial_number == self.setup.serial_number,
            "another sensor is at {} now",
            self.session.port()
        );
        let is_other = |value: &Value| !now.unnamed().contains(value);
        let others = self.setup.unnamed().into_iter().filter(is_other);
        for value in settings(&self.setup).chain(others) {
            self.session.set(Command::Set(value))?;
        }
        self.session.borrow_rows(MAX_ROWS as u16)?;
        writeln!(self.output, "the sensor is back, and set as it was")?;
        Ok(self)
    }

    fn report(&mut self, place: &str, point: &Taken) -> Result<()> {
        let mm = Millimetres(point.d_mm);
        let scatter = point.scatter_px.map(|it| format!(", scatter {it:.5}"));
        let misfits = Some(point.misfits).filter(|rows| *rows > 0);
        let misfits = misfits.map(|rows| format!("  {rows} rows do not look like their spot"));
        let alike = |rows| format!("  rows err alike, worth {rows}");
        let alike = point.correlated.map(alike);
        writeln!(
            self.output,
            "{place}  {mm} mm  x {:.5} px +- {:.5} ({} frames{}, claimed {:.5}){}{}",
            point.x_px,
            point.sigma_px,
            point.frames,
            scatter.unwrap_or_default(),
            point.claimed_px,
            misfits.unwrap_or_default(),
            alike.unwrap_or_default()
        )?;
        Ok(())
    }
}

/// The point at another distance that a target at rest would give once more, if there is one.
///
/// The person states that the distance changed. By eq. (1) the centre then moves by the change times the
/// slope, at least. This takes the slope of the nominal geometry at the farther end of its range, or at the
/// distance if that is beyond. A centre that moves by less than a tenth of that is at rest. Where a tenth is
/// within the noise, nobody can tell.
fn at_rest<'a>(points: &'a [PointLine], point: &Taken) -> Option<&'a PointLine> {
    points.iter().find(|other| {
        let beyond = FARTHEST_MM.max(point.d_mm.abs()).max(other.d_mm.abs()) - NOMINAL_D_MM;
        let expected = NOMINAL_K_MM_PX / beyond.powi(2) * (point.d_mm - other.d_mm).abs();
        let noise = NOISE * point.sigma_px.hypot(other.sigma_px);
        let moved = (point.x_px - other.x_px).abs();
        0.1 * expected > noise && moved < (0.1 * expected).min(AT_REST_PX)
    })
}

/// The centres that lie with the others. With three there is no telling which is the odd one.
fn without_outlying(centres: &[Centre]) -> Vec<Centre> {
    if centres.len() <= 3 {
        return centres.to_vec();
    }
    let middle = upper_median(centres.iter().map(|centre| centre.x_px));
    let deviations = centres.iter().map(|centre| (centre.x_px - middle).abs());
    // 1.4826 median deviations are a gaussian's sigma.
    let scatter = 1.4826 * upper_median(deviations);
    let claimed = upper_median(centres.iter().map(|centre| centre.claimed_px));
    let most = OUTLYING * scatter.max(claimed);
    let close = |centre: &&Centre| {
        (centre.x_px - middle).abs() <= most && centre.claimed_px <= OUTLYING * claimed
    };
    centres.iter().filter(close).copied().collect()
}

/// A point of at least one centre.
pub fn taken(d_mm: f64, centres: &[Centre]) -> Taken {
    let count = centres.len() as f64;
    let places = || centres.iter().map(|centre| centre.x_px);
    let claimed = rms(centres.iter().map(|centre| centre.claimed_px));
    let scatter = (centres.len() > 1).then(|| standard_deviation(places()));
    let heights = centres.iter().map(|it| it.height_counts * to_longest(it));
    Taken {
        x_px: rounded(mean(places())),
        d_mm,
        // Frames of a target at rest share its speckle: more frames reduce only what differs between them.
        sigma_px: rounded(claimed.max(scatter.unwrap_or_default()) / count.sqrt()).max(FINEST_PX),
        frames: centres.len(),
        scatter_px: scatter.map(rounded),
        claimed_px: rounded(claimed).max(FINEST_PX),
        misfits: centres.iter().map(|centre| centre.misfits).sum(),
        correlated: centres.iter().filter_map(|centre| centre.correlated).min(),
        // The median: a line that lost a digit does not count.
        height_counts: Some(upper_median(heights)).filter(|height| *height > 0.0),
        shape: mean_shape(centres),
        slits: mean_images(centres),
    }
}

/// As many decimals as a file holds.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// The factor from a height in counts to that at the longest exposure.
fn to_longest(centre: &Centre) -> f64 {
    f64::from(Exposure::LONGEST.us()) / f64::from(centre.exposure_us)
}

/// The mean images of a comb's slits, rounded as a file holds them. A slit without an image in at least half
/// of the frames has none.
fn mean_images(centres: &[Centre]) -> Option<SlitImages> {
    let with_images = centres.iter().filter_map(|centre| {
        let height = |image: SlitImage| image.height_counts * to_longest(centre);
        let scaled = |image: SlitImage| SlitImage::new(image.x_px, height(image));
        Some(centre.slits?.map(|image| image.map(scaled)))
    });
    let frames: Vec<SlitImages> = with_images.collect();
    if frames.is_empty() {
        return None;
    }
    Some(std::array::from_fn(|slit| {
        let images: Vec<SlitImage> = frames.iter().filter_map(|images| images[slit]).collect();
        if 2 * images.len() < frames.len() {
            return None;
        }
        let x_px = middle_mean(images.iter().map(|image| image.x_px).collect());
        let height = upper_median(images.iter().map(|image| image.height_counts));
        (height > 0.0).then_some(SlitImage::new(rounded(x_px), height))
    }))
}

/// The mean shape of the frames, rounded as a file holds it. None if a frame has none.
fn mean_shape(centres: &[Centre]) -> Option<Shape> {
    let shapes = centres.iter().map(|centre| centre.shape);
    let shapes: Vec<Shape> = shapes.collect::<Option<_>>()?;
    let mean = |of: &dyn Fn(&Shape) -> f64| rounded(middle_mean(shapes.iter().map(of).collect()));
    Some(Shape {
        width_px: mean(&|shape| shape.width_px),
        components_px: std::array::from_fn(|index| mean(&|shape| shape.components_px[index])),
    })
}

/// The mean without the lowest and the highest quarter: a line that lost a digit does not count.
fn middle_mean(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    // One of three: a line that lost a digit must not count.
    let quarter = (values.len() + 1) / 4;
    mean(&values[quarter..values.len() - quarter])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn centre(x_px: f64) -> Centre {
        Centre {
            x_px,
            claimed_px: 0.002,
            height_counts: 1000.0,
            exposure_us: 5600,
            rows: 64,
            estimator: 't',
            ..Centre::default()
        }
    }

    #[test]
    fn a_point_is_as_certain_as_its_frames() {
        // Deviations -3, -1, 1, 3: squares sum to 20, over three 6.67.
        let spread = [-0.03, -0.01, 0.01, 0.03].map(|by| centre(1800.0 + by));
        let point = taken(700.0, &spread);
        assert_eq!(point.x_px, 1800.0);
        assert_eq!(point.scatter_px, Some(0.02582));
        assert_eq!(point.sigma_px, 0.01291);
        assert_eq!(point.height_counts, Some(1000.0));
        // A height is that at the longest exposure.
        let mut short = centre(1800.0);
        short.exposure_us = 560;
        assert_eq!(taken(700.0, &[short]).height_counts, Some(10_000.0));
        // Frames that agree better than chance: what the sensor claims counts.
        let point = taken(700.0, &[centre(1800.0); 4]);
        assert_eq!((point.scatter_px, point.sigma_px), (Some(0.0), 0.001));
        let single = taken(700.0, &[centre(1800.0)]);
        assert_eq!((single.scatter_px, single.sigma_px), (None, 0.002));
        let mut flagged = centre(1800.0);
        (flagged.misfits, flagged.correlated) = (2, Some(5));
        let mut worse = flagged;
        worse.correlated = Some(3);
        let point = taken(700.0, &[centre(1800.0), flagged, worse]);
        assert_eq!((point.misfits, point.correlated), (4, Some(3)));
    }

    #[test]
    fn a_shape_is_the_mean_of_all_frames() {
        let mut centres = [7.1, 17.0, 7.2, 7.3].map(|width_px: f64| Centre {
            shape: Some(Shape {
                width_px,
                components_px: [0.001, -0.002, 0.1 * (width_px - 7.0), 0.0, 0.0],
            }),
            ..centre(1800.0)
        });
        let shape = taken(700.0, &centres).shape.expect("a shape");
        assert_eq!(shape.width_px, 7.25);
        assert_eq!(shape.components_px, [0.001, -0.002, 0.025, 0.0, 0.0]);
        centres[3].shape = None;
        assert_eq!(taken(700.0, &centres).shape, None);
    }

    #[test]
    fn an_image_is_the_mean_of_the_frames_that_have_it() {
        let image = |x_px| Some(SlitImage::new(x_px, 1000.0));
        let with = |first, second| {
            let mut centre = centre(1800.0);
            let slits = centre.slits.insert(SlitImages::default());
            (slits[0], slits[1]) = (first, second);
            centre
        };
        let frames = [
            with(image(900.0), None),
            with(image(901.0), image(1000.0)),
            with(image(902.0), None),
        ];
        let slits = taken(700.0, &frames).slits.expect("images");
        assert_eq!((slits[0], slits[1]), (image(901.0), None));
        let slits = taken(700.0, &frames[..2]).slits.expect("images");
        assert_eq!((slits[0], slits[1]), (image(900.5), image(1000.0)));
        assert_eq!(taken(700.0, &[centre(1800.0)]).slits, None);
    }

    /// 10 mm move the centre by 14.6 px at 1.1 m. Steps of a micrometre move it by less than its noise.
    #[test]
    fn a_target_that_did_not_move_is_told_from_one_that_did() {
        let at = |d_mm: f64, x_px: f64| taken(d_mm, &[centre(x_px); 4]);
        let there = [at(700.0, 2059.46), at(690.0, 2092.14)].map(|point| PointLine::from(&point));
        let found = |d_mm, x_px| at_rest(&there, &at(d_mm, x_px)).map(|point| point.d_mm);
        assert_eq!(found(710.0, 2059.46), Some(700.0));
        assert_eq!(found(710.0, 2059.55), Some(700.0));
        assert_eq!(found(710.0, 2059.57), None);
        assert_eq!(found(680.0, 2092.06), Some(690.0));
        // As eq. (1) has it, and a sensor whose slope is a hundredth.
        assert_eq!(found(710.0, 2027.4), None);
        assert_eq!(found(710.0, 2059.46 - 0.32), None);
        // 0.1 mm: 0.146 px.
        assert_eq!(found(700.1, 2059.463), Some(700.0));
        assert_eq!(found(700.1, 2059.48), None);
        assert_eq!(found(700.001, 2059.46), None);
    }

    #[test]
    fn a_changed_digit_does_not_count() {
        let mut centres = [-0.003, -0.001, 0.0, 0.001, 0.002].map(|by| centre(1800.0 + by));
        assert_eq!(without_outlying(&centres).len(), 5);
        centres[2].x_px += 0.1;
        assert_eq!(without_outlying(&centres).len(), 4);
        centres[3].claimed_px = 0.02;
        assert_eq!(without_outlying(&centres).len(), 4);
        centres[3].claimed_px = 0.0201;
        assert_eq!(without_outlying(&centres).len(), 3);
        // Of three, any may be the odd one.
        assert_eq!(without_outlying(&centres[..3]).len(), 3);
    }
}
