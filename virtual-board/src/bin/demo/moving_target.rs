//! Moves a target from step to step, and compares the firmware's readings with the truth.
//!
//! The sensor was calibrated before. Its record is `paper.record`, which `cargo surfaces --write` makes as an
//! owner would: from points at known distances, by the tool's fit. The curve is from a target without
//! speckle, and the surface's part of u from white paper in the light of a laser with a single wavelength.
//!
//! With a comb, the record has the same curve: it is that of a slit on the optical axis, and the nominal mask
//! is as it was drawn. The surface's part of u then comes from the scatter of the slits alone.

use std::time::Duration;

use anyhow::{Context as _, Result, ensure};
use serde::Serialize;
use simulator::bound;
use simulator::scene::comb::Comb;
use simulator::scene::{Scene, Sensor, Simulation};
use slitrange::base::places::PLACES;
use slitrange::base::units::Micrometres;
use slitrange::frame::comb::Slits;
use slitrange::reading::uncertainty::{CalibrationErrors, FittedErrors, FittedSurface};
use slitrange_device::record::encoded::EncodedRecord;
use slitrange_device::record::{self, Record};
use statistics::{mean, rms, upper_median};
use virtual_board::light::{Target, of_scene};
use virtual_board::upload::upload;
use virtual_board::{Exposure, Firmware, Line, VirtualBoard};

use crate::command_line::{Options, say};
use crate::lines::{Reading, Report};

/// The range of the paper's position table, in metres.
pub const NEAREST: f64 = 0.60;
/// The far end of the range, in metres.
pub const FARTHEST: f64 = 1.02;

/// The number of steps if the target moves over the table, and if it stays.
const STEPS: u32 = 43;
const STEPS_AT_REST: u32 = 8;

/// The results at each step that count. Results of frames in which the target moved come before and do not
/// count.
const RESULTS_A_STEP: usize = 4;

/// A target whose surface moves the spot shows another surface for each result that counts: so many at each
/// step of the table, or at rest.
const SURFACES_A_STEP: u32 = 4;
const SURFACES_AT_REST: u32 = 32;

/// Steps and results at each step if the targets have different reflectivity: each target is seen some ten
/// times.
const STEPS_OF_TARGETS: u32 = 4;
const RESULTS_OF_TARGETS: usize = 58;

/// How long a sensor warms up, in seconds of the scene. The board does not run meanwhile.
const WARM_UP: f64 = 600.0;

const RECORD: &[u8] = include_bytes!("paper.record");

#[derive(Debug, Serialize)]
pub struct Summary {
    /// Root mean square error of the readings; `None` without readings.
    rms_error_um: Option<f64>,
    /// The Cramér-Rao bound for the scene, root mean square over the readings; `None` if the scene has more
    /// than a gaussian and noise.
    bound_um: Option<f64>,
    max_error_um: Option<f64>,
    /// Share of readings whose error is within twice the claimed uncertainty.
    within_2u: Option<f64>,
    median_u_um: Option<f64>,
    median_r_um: Option<f64>,
    /// Mean over the readings of the slits used: 1 for a sensor with one slit.
    slits_used: Option<f64>,
    readings_per_s: f64,
    rows_per_s: f64,
    rows_lost: u64,
    sleep_share: f64,
    faults: usize,
    /// Faults in frames that began a frame or more after the target's last change of reflectivity.
    late_faults: usize,
}

/// The error, claimed uncertainty, repeatability and bound of a reading, in micrometres.
struct Compared {
    error: f64,
    uncertainty: f64,
    repeatability: f64,
    bound: Option<f64>,
    slits: u8,
}

/// The scene to show, with the comb that the options ask for, and the first distance of its target.
pub fn scene(options: &Options) -> Result<(Scene, f64)> {
    let (mut scene, distance) = scene_by_name(options)?;
    if options.comb && scene.comb.is_none() {
        scene.comb = Some(Comb::nominal());
        scene.check().context("--comb")?;
    }
    Ok((scene, distance))
}

fn slits_of(scene: &Scene) -> Slits {
    (scene.comb.as_ref()).map_or(Slits::One, |_| Slits::Comb)
}

/// The command that tells the firmware about a scene's slits. The answer is the same text.
pub fn slits_command(scene: &Scene) -> String {
    format!("slits {}", slits_of(scene).name())
}

fn record(slits: Slits) -> Result<EncodedRecord> {
    let paper = record::decode(RECORD).context("the demo's record")?;
    let errors = match (slits, paper.errors) {
        (Slits::Comb, CalibrationErrors::Fitted(errors)) => {
            let surface = errors.surface.map(|surface| FittedSurface {
                deviation: [Micrometres::default(); PLACES],
                ..surface
            });
            CalibrationErrors::Fitted(FittedErrors { surface, ..errors })
        }
        (_, errors) => errors,
    };
    EncodedRecord::new(Record { errors, ..paper }).context("the demo's record")
}

fn scene_by_name(options: &Options) -> Result<(Scene, f64)> {
    let Some(name) = &options.scene else {
        // At a terminal a person may put the target anywhere, and give the sensor another geometry: speckle
        // is made for neither.
        let scene = match options.pty {
            true => Scene::white_paper(),
            false => Scene::load("speckle-at-rest")?,
        };
        return Ok((scene, options.distance.unwrap_or(NEAREST)));
    };
    let scene = Scene::load(name)?;
    ensure!(
        scene.sensor == Sensor::Tcd1304dg,
        "the scene {name} is seen by {:?}, and the board has a TCD1304DG: `cargo scene {name}` shows it",
        scene.sensor
    );
    ensure!(
        options.steps.is_none() || scene.motion.is_none(),
        "the target of {name} moves by itself: leave out --steps"
    );
    let distance = options.distance.unwrap_or(scene.distance);
    let mut distances = vec![distance];
    if options.steps.is_some() && options.distance.is_none() {
        distances.extend([NEAREST, FARTHEST]);
    }
    if let Some(motion) = &scene.motion {
        ensure!(
            !options.pty || scene.speckle.is_none(),
            "the target of {name} moves on for as long as the terminal is open, and its speckle is not made \
             for any distance: leave out --pty"
        );
        // The motion starts again at each step. A step ends at the latest after this many results.
        let results = 2 + RESULTS_A_STEP as u32;
        distances.push(motion.distance(distance, (patience(options.rows) * results).as_secs_f64()));
    }
    let mut checks = distances.into_iter().map(|it| scene.check_distance(it));
    (checks.try_for_each(|it| it)).with_context(|| format!("the scene {name}"))?;
    Ok((scene, distance))
}

/// The longest wait for an answer: after at most a frame.
fn patience(rows: u16) -> Duration {
    Duration::from_secs(1) + 4 * Duration::from_millis(6) * u32::from(rows)
}

pub fn measure(firmware: &Firmware, options: &Options) -> Result<Summary> {
    let (scene, start) = scene(options)?;
    let has_surface = scene.speckle.is_some() || scene.texture.is_some();
    // Where the target stays, if it does not move over the whole table.
    let stays = options.distance.is_some() || options.scene.is_some() && options.steps.is_none();
    let has_targets = scene.reflectivity.is_some() && options.steps.is_none();
    let (steps, results) = match (options.steps, has_surface) {
        _ if has_targets => (STEPS_OF_TARGETS, RESULTS_OF_TARGETS),
        (Some(steps), true) => (steps, 1),
        (Some(steps), false) => (steps, RESULTS_A_STEP),
        (None, true) if stays => (SURFACES_AT_REST, 1),
        (None, true) => (STEPS * SURFACES_A_STEP, 1),
        (None, false) if stays => (STEPS_AT_REST, RESULTS_A_STEP),
        (None, false) => (STEPS, RESULTS_A_STEP),
    };
    if options.scene.is_some() {
        say(options.json, &scene.about);
    }
    let target = Target::at(start);
    let warms_up = scene.temperature.is_some();
    let simulation = Simulation::new(scene.clone());
    let record = record(slits_of(&scene))?;
    let command = slits_command(&scene);
    let mut board = VirtualBoard::power_on(firmware, of_scene(scene, target.clone()))?;
    let patience = patience(options.rows);
    upload(&mut board, record.bytes(), patience)?;
    board.tell(&command, patience)?;
    if !has_surface && has_targets {
        // The scene has no speckle.
        board.tell("surface off", patience)?;
    }
    for line in &options.set {
        board.tell(line, patience)?;
    }
    board.tell(&format!("rows {}", options.rows), patience)?;

    say(
        options.json,
        "   true mm  reported mm  error um      u um     r um  rows  slits  exposure us  virtual s  flags",
    );
    let (started, first_row) = (board.now(), board.head(|head| head.row_count));
    let (mut readings, mut faults, mut late_faults, mut compared) = (0, 0, 0, vec![]);
    for step in 0..steps {
        let share = f64::from(step) / f64::from(steps.max(2) - 1);
        match stays {
            // A target that the scene moves starts again.
            true => target.move_to(start),
            false => target.move_to(NEAREST + share * (FARTHEST - NEAREST)),
        }
        if warms_up && step > 0 {
            target.let_time_pass(WARM_UP / f64::from(steps.max(2) - 1));
        }
        if has_surface {
            target.show_surface(step.into());
        }
        // The rows that are being read and computed still show the old place. At most two frames end with
        // such a row.
        for result in 0..2 + results {
            let (line, report) = next_report(&mut board, patience)?;
            readings += u32::from(matches!(report, Report::Reading(_)));
            if result < 2 {
                continue;
            }
            let shown = result == 2 || has_targets && result % 3 == 2;
            let last = last_exposure(&mut board, &line).context("a result came before its rows")?;
            let rows = usize::from(options.rows);
            let distance = target.mean_distance(&last, rows);
            let distance = distance.context("too many rows ago")?;
            match report {
                Report::Reading(reading) => {
                    let laser = board.head(|head| head.last_row().map(|row| row.exposure.laser));
                    let found = compare(&simulation, laser, distance, &reading)?;
                    if shown {
                        let at = line.at as f64 * 1e-9;
                        say(options.json, &table_line(distance, &reading, &found, at));
                    }
                    compared.push(found);
                }
                Report::Fault(fault) => {
                    faults += 1;
                    // The frame before is as long ago as the target.
                    let has_settled = target.stayed_as_bright(&last, 2 * rows).unwrap_or(true);
                    late_faults += usize::from(has_settled);
                    if shown {
                        say(options.json, &format!("{:>10.3} {fault}", distance * 1e3));
                    }
                }
            }
        }
    }
    let seconds = (board.now() - started) as f64 * 1e-9;
    let rows = board.head(|head| head.row_count) - first_row;
    let rows_lost = rows_lost(&mut board, patience)?;
    let statistics = board.finish()?;
    let is_within_2u = |it: &Compared| f64::from(u8::from(it.error.abs() <= 2.0 * it.uncertainty));
    let of_readings = |value: f64| (!compared.is_empty()).then_some(value);
    let summary = Summary {
        rms_error_um: of_readings(rms(compared.iter().map(|reading| reading.error))),
        bound_um: (compared.iter())
            .map(|reading| reading.bound)
            .collect::<Option<Vec<f64>>>()
            .and_then(|bounds| of_readings(rms(bounds))),
        max_error_um: (compared.iter().map(|it| it.error.abs())).reduce(f64::max),
        within_2u: of_readings(mean(compared.iter().map(is_within_2u))),
        median_u_um: of_readings(upper_median(compared.iter().map(|it| it.uncertainty))),
        median_r_um: of_readings(upper_median(compared.iter().map(|it| it.repeatability))),
        slits_used: of_readings(mean(compared.iter().map(|it| f64::from(it.slits)))),
        readings_per_s: f64::from(readings) / seconds,
        rows_per_s: rows as f64 / seconds,
        rows_lost,
        sleep_share: statistics.asleep(),
        faults,
        late_faults,
    };
    say(options.json, &summary.in_words(compared.len()));
    Ok(summary)
}

fn last_exposure(board: &mut VirtualBoard, line: &Line) -> Option<Exposure> {
    /// The time of a byte on the serial line: ten bits at 115200 a second, in nanoseconds.
    const BYTE: u64 = 86_806;
    // The line begins when the frame's last row has been computed, before the next row is read.
    let begin = line.at.saturating_sub((line.text.len() as u64 + 2) * BYTE);
    board.head(|head| {
        let read = head.rows().rev().find(|row| row.last_word < begin);
        read.map(|row| row.exposure)
    })
}

/// Compares a reading with the truth and with the bound for the scene.
fn compare(
    simulation: &Simulation,
    exposure: Option<u64>,
    distance: f64,
    reading: &Reading,
) -> Result<Compared> {
    let exposure = exposure.context("a reading came before any row")? as f64 * 1e-9;
    ensure!(reading.rows > 0, "a reading of no rows: {reading:?}");
    let optics = &simulation.scene().optics;
    let metres_per_pixel = optics.metres_per_pixel(optics.centre(distance));
    Ok(Compared {
        error: (reading.distance - distance * 1e3) * 1e3,
        uncertainty: reading.uncertainty * 1e3,
        repeatability: reading.repeatability * 1e3,
        slits: reading.slits,
        bound: bound::of_row(simulation, distance, exposure)
            .map(|bound| bound / f64::from(reading.rows).sqrt() * metres_per_pixel * 1e6),
    })
}

/// A line of the table, for a reading that came at a virtual time in seconds.
fn table_line(distance: f64, reading: &Reading, found: &Compared, at: f64) -> String {
    let (truth, reported) = (distance * 1e3, reading.distance);
    let (error, uncertainty, repeatability) = (found.error, found.uncertainty, found.repeatability);
    let (rows, slits, exposure) = (reading.rows, reading.slits, reading.exposure);
    format!(
        "{truth:>10.3} {reported:>12.4} {error:>+9.2} {uncertainty:>9.2} {repeatability:>8.2} {rows:>5} \
         {slits:>6} {exposure:>12} {at:>10.3}  {}",
        reading.flags
    )
}

pub fn next_report(board: &mut VirtualBoard, patience: Duration) -> Result<(Line, Report)> {
    let is_result = |line: &str| !matches!(Report::parse(line), Ok(None));
    let line = board.run_until_line(is_result, patience);
    let line = line.context("the firmware reports nothing")?;
    let report = Report::parse(&line.text)?.context("the line was a result a moment ago")?;
    Ok((line, report))
}

/// The rows that the firmware lost or failed to read, by its own count.
fn rows_lost(board: &mut VirtualBoard, patience: Duration) -> Result<u64> {
    board.send("status\r\n");
    let mut lost = 0;
    for name in ["status rows lost ", "status rows failed "] {
        let line = board.run_until_line(|line| line.starts_with(name), patience);
        let line = line.context("the firmware did not answer `status`")?.text;
        let count = line[name.len()..].parse::<u64>();
        lost += count.with_context(|| format!("no count in {line:?}"))?;
    }
    Ok(lost)
}

impl Summary {
    fn in_words(&self, readings: usize) -> String {
        let bound = match (self.rms_error_um, self.bound_um) {
            (Some(rms), Some(bound)) => {
                let ratio = rms / bound;
                format!(", {ratio:.2} of the Cramér-Rao bound ({bound:.2} um)")
            }
            _ => String::new(),
        };
        let slits = match self.slits_used {
            Some(slits) if slits > 1.0 => format!("; {slits:.1} slits used"),
            _ => String::new(),
        };
        let accuracy = match (self.rms_error_um, self.max_error_um, self.within_2u) {
            (Some(rms), Some(largest), Some(within)) => format!(
                "RMS error {rms:.2} um{bound}; largest {largest:.2} um; {:.1} % within twice u{slits}\n\
                 median u {:.2} um, what a distance may be off by; median r {:.2} um, what it repeats to",
                within * 100.0,
                self.median_u_um.unwrap_or(f64::NAN),
                self.median_r_um.unwrap_or(f64::NAN)
            ),
            _ => "no reading".to_owned(),
        };
        format!(
            "{readings} readings: {accuracy}\n{:.1} readings and {:.1} rows a second, \
             {} rows lost, {} faults; CPU asleep {:.1} % of the time",
            self.readings_per_s,
            self.rows_per_s,
            self.rows_lost,
            self.faults,
            self.sleep_share * 100.0
        )
    }
}
