//! A target that moves from step to step, and how far the firmware's readings lie from the truth.

use std::time::Duration;

use anyhow::{Context as _, Result, ensure};
use host_tests::bound;
use host_tests::scene::Simulation;
use serde::Serialize;
use virtual_board::light::{Target, of_scene};
use virtual_board::{Exposure, Firmware, Line, Nanos, VirtualBoard};

use crate::lines::{Reading, Report};
use crate::shown::{FARTHEST, NEAREST, Shown};
use crate::{Options, say};

/// Bits a second on the serial line, and for each of its characters.
const BAUD: Nanos = 115_200;
const BITS: Nanos = 10;

/// What the demo found.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// The scene; none for white paper.
    scene: Option<String>,
    /// Readings that were compared with the truth.
    readings: usize,
    /// Root mean square error of the readings; none without readings.
    rms_error_um: Option<f64>,
    /// Mean error of the readings: what more of them would not remove.
    mean_error_um: Option<f64>,
    /// What the Cramér-Rao bound gives for the scene, root mean square over the readings; none where it has no bound.
    bound_um: Option<f64>,
    max_error_um: Option<f64>,
    /// Share of readings whose error is within twice the claimed uncertainty.
    within_2u: Option<f64>,
    readings_per_s: f64,
    rows_per_s: f64,
    rows_lost: u64,
    /// Share of time in which the core executes nothing.
    sleep_share: f64,
    /// Frames without a distance.
    faults: usize,
}

/// A reading beside the truth, in micrometres.
struct Compared {
    error: f64,
    uncertainty: f64,
    /// None where the scene has none.
    bound: Option<f64>,
}

/// Opens the serial line as a pseudo-terminal.
#[cfg(unix)]
pub fn serve(firmware: &Firmware, shown: &Shown) -> Result<()> {
    let target = Target::at(shown.distances[0]);
    let light = of_scene(shown.scene.clone(), target.clone());
    let moves = shown.distances.iter().any(|it| *it != shown.distances[0]);
    let light = if moves {
        // To the far end and back in 20 s of virtual time.
        let mut light = light;
        Box::new(move |exposure: &Exposure| {
            let turns = exposure.end as f64 * 1e-9 / 20.0;
            let there = 1.0 - (2.0 * turns.fract() - 1.0).abs();
            target.move_to(NEAREST + there * (FARTHEST - NEAREST));
            light(exposure)
        })
    } else {
        light
    };
    virtual_board::pty::serve(&mut VirtualBoard::power_on(firmware, light)?)
}

#[cfg(not(unix))]
pub fn serve(_: &Firmware, _: &Shown) -> Result<()> {
    anyhow::bail!("--pty needs a system with pseudo-terminals")
}

/// Measures at each distance and sums up.
pub fn measure(firmware: &Firmware, options: &Options, shown: Shown) -> Result<Summary> {
    let simulation = Simulation::new(shown.scene.clone());
    let target = Target::at(shown.distances[0]);
    let light = of_scene(shown.scene.clone(), target.clone());
    let mut board = VirtualBoard::power_on(firmware, light)?;
    let frame = Duration::from_millis(6) * u32::from(options.rows);
    // Boot, and the answer, wait behind at most a frame.
    let patience = Duration::from_secs(1) + 4 * frame;
    board.send(&format!("rows {}\r\n", options.rows));
    board
        .run_until_line(|line| line == format!("rows {}", options.rows), patience)
        .context("the firmware did not take the command `rows`")?;

    if let Some(words) = shown.in_words() {
        say(options.json, &words);
    }
    say(
        options.json,
        "   true mm  reported mm  error um  claimed u um  rows  virtual s",
    );
    let (started, first_row) = (board.now(), board.head(|head| head.row_count()));
    let (mut readings, mut faults, mut compared) = (0, 0, vec![]);
    for &distance in &shown.distances {
        target.move_to(distance);
        // The row that is under way, and the one that is being computed, still show the old place: two frames at most
        // end with such a row.
        for result in 0..2 + shown.results {
            let line = board
                .run_until_line(
                    |line| matches!(Report::parse(line), Ok(Some(_)) | Err(_)),
                    patience,
                )
                .context("the firmware reports nothing")?;
            let report =
                Report::parse(&line.text)?.context("the line was a result a moment ago")?;
            readings += u32::from(matches!(report, Report::Reading(_)));
            if result < 2 {
                continue;
            }
            let is_printed = shown.prints_all || result == 2;
            let last = last_exposure(&mut board, &line)?;
            let truth = target
                .mean_distance(&last, options.rows.into())
                .context("a result came before its rows")?;
            match report {
                Report::Reading(reading) => {
                    let found = compare(&simulation, &last, truth, &reading)?;
                    if is_printed {
                        say(
                            options.json,
                            &format!(
                                "{:>10.3} {:>12.4} {:>+9.2} {:>13.2} {:>5} {:>10.3}",
                                truth * 1e3,
                                reading.distance,
                                found.error,
                                found.uncertainty,
                                reading.rows,
                                line.at as f64 * 1e-9
                            ),
                        );
                    }
                    compared.push(found);
                }
                Report::Fault(fault) => {
                    faults += 1;
                    if is_printed {
                        say(options.json, &format!("{:>10.3} {fault}", truth * 1e3));
                    }
                }
            }
        }
    }
    let seconds = (board.now() - started) as f64 * 1e-9;
    let rows = board.head(|head| head.row_count()) - first_row;
    let rows_lost = rows_lost(&mut board, patience)?;
    let statistics = board.finish()?;
    let bounds: Option<Vec<f64>> = compared.iter().map(|reading| reading.bound).collect();
    let count = compared.len() as f64;
    let is_any = !compared.is_empty();
    let summary = Summary {
        scene: shown.name,
        readings: compared.len(),
        rms_error_um: rms(compared.iter().map(|reading| reading.error)),
        mean_error_um: is_any
            .then(|| compared.iter().map(|reading| reading.error).sum::<f64>() / count),
        bound_um: bounds.and_then(|bounds| rms(bounds.into_iter())),
        max_error_um: compared
            .iter()
            .map(|reading| reading.error.abs())
            .reduce(f64::max),
        within_2u: is_any.then(|| {
            let within = compared
                .iter()
                .filter(|reading| reading.error.abs() <= 2.0 * reading.uncertainty)
                .count();
            within as f64 / count
        }),
        readings_per_s: f64::from(readings) / seconds,
        rows_per_s: rows as f64 / seconds,
        rows_lost,
        sleep_share: statistics.asleep(),
        faults,
    };
    say(options.json, &summary.in_words());
    Ok(summary)
}

/// The exposure of the last row that was complete when a line began: the last one of the line's frame, because a frame takes
/// longer than the line of the one before, so that no line waits.
fn last_exposure(board: &mut VirtualBoard, line: &Line) -> Result<Exposure> {
    let characters = (line.text.len() + "\r\n".len()) as Nanos;
    let began = line.at - characters * BITS * 1_000_000_000 / BAUD;
    board
        .head(|head| {
            let mut rows = head.rows().rev();
            (rows.find(|row| row.last_word < began)).map(|row| row.exposure)
        })
        .context("a result came before any row")
}

/// A reading beside the truth in metres, and the bound for the scene.
fn compare(
    simulation: &Simulation,
    exposure: &Exposure,
    truth: f64,
    reading: &Reading,
) -> Result<Compared> {
    ensure!(reading.rows > 0, "a reading of no rows: {reading:?}");
    let optics = &simulation.scene().optics;
    let micrometres_per_pixel = optics.metres_per_pixel(optics.centre(truth)) * 1e6;
    let bound = bound::of_row(simulation, truth, exposure.duration() as f64 * 1e-9);
    Ok(Compared {
        error: (reading.distance - truth * 1e3) * 1e3,
        uncertainty: reading.uncertainty * 1e3,
        bound: bound.map(|pixels| pixels * micrometres_per_pixel / f64::from(reading.rows).sqrt()),
    })
}

/// Rows that the firmware says it lost, or failed to read.
fn rows_lost(board: &mut VirtualBoard, patience: Duration) -> Result<u64> {
    board.send("status\r\n");
    let mut lost = 0;
    for name in ["status rows lost ", "status rows failed "] {
        let line = board
            .run_until_line(|line| line.starts_with(name), patience)
            .context("the firmware did not answer `status`")?;
        lost += line.text[name.len()..]
            .parse::<u64>()
            .with_context(|| format!("no count in {:?}", line.text))?;
    }
    Ok(lost)
}

/// Root mean square; none of nothing.
pub fn rms(values: impl ExactSizeIterator<Item = f64>) -> Option<f64> {
    let count = values.len();
    (count > 0).then(|| (values.map(|value| value * value).sum::<f64>() / count as f64).sqrt())
}

impl Summary {
    fn in_words(&self) -> String {
        let (Some(rms), Some(mean), Some(largest), Some(within)) = (
            self.rms_error_um,
            self.mean_error_um,
            self.max_error_um,
            self.within_2u,
        ) else {
            return format!("no reading, {} faults\n{}", self.faults, self.times());
        };
        let beside = match self.bound_um {
            Some(bound) => format!("{:.2} of the Cramér-Rao bound ({bound:.2} um)", rms / bound),
            None => format!("mean {mean:+.2} um (more than noise: no bound)"),
        };
        format!(
            "{} readings: RMS error {rms:.2} um, {beside}; largest {largest:.2} um; {:.1} % within twice the claimed uncertainty\n{}",
            self.readings,
            within * 100.0,
            self.times()
        )
    }

    fn times(&self) -> String {
        format!(
            "{:.1} readings and {:.1} rows a second, {} rows lost, {} faults; CPU asleep {:.1} % of the time",
            self.readings_per_s,
            self.rows_per_s,
            self.rows_lost,
            self.faults,
            self.sleep_share * 100.0
        )
    }
}
