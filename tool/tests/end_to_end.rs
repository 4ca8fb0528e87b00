//! From a sensor whose geometry nobody knows to distances: each command as its user gives it, against the
//! firmware on the emulated
//! board, with a power cycle in between.
#![cfg(unix)]

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use simulator::bound;
use simulator::distorted_optics::DistortedOptics;
use simulator::optics::Optics;
use simulator::scene::{Scene, Simulation};
use virtual_board::light::{Target, of_scene_through};
use virtual_board::pty::{Pace, PseudoTerminal};
use virtual_board::stage::Stage;
use virtual_board::{Firmware, SharedFlash, VirtualBoard};

/// How far the sensor is from eq. (1), in metres.
const DEPARTURE: f64 = 300e-6;

/// Where it is used, in metres.
const NEAREST: f64 = 0.60;
const FARTHEST: f64 = 1.02;

/// Distances at which it is tried, and readings at each.
const STEPS: u32 = 22;
const READINGS: usize = 4;

const ROWS: u16 = 16;

/// More than a frame takes, and an answer behind it.
const PATIENCE: Duration = Duration::from_secs(2);

/// A sensor on its bench.
struct Bench {
    firmware: Firmware,
    optics: DistortedOptics,
    target: Target,
    flash: SharedFlash,
}

impl Bench {
    fn power_on(&self) -> VirtualBoard {
        let light = of_scene_through(self.optics, Scene::white_paper(), self.target.clone());
        VirtualBoard::power_on_with_flash(&self.firmware, light, self.flash.clone())
            .expect("the board starts")
    }

    /// Powers the sensor on, works with it at a serial port, and cuts its power.
    fn work(&self, stage: &Path, work: impl FnOnce(&str) + Send) {
        let mut board = self.power_on();
        let mut terminal = PseudoTerminal::open().expect("a pseudo-terminal");
        let port = terminal.path().display().to_string();
        let mut stage = Stage::new(stage, self.target.clone());
        std::thread::scope(|scope| {
            let worker = scope.spawn(|| work(&port));
            terminal
                .serve(&mut board, Pace::Unbound, |_| {
                    stage.look();
                    !worker.is_finished()
                })
                .expect("a clean run");
        });
        board.finish().expect("a clean run");
    }
}

/// A command of the tool, and what it says.
fn slitrange(folder: &Path, arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_slitrange"))
        .arg("calibrate")
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the tool starts");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let complained = String::from_utf8_lossy(&output.stderr);
    println!(
        "$ slitrange calibrate {}\n{said}{complained}",
        arguments.join(" ")
    );
    assert!(output.status.success(), "{complained}");
    said
}

/// An error beside the bound, in micrometres.
struct Compared {
    error: f64,
    bound: f64,
}

/// The first frames may still have rows of the place before.
fn readings(board: &mut VirtualBoard) -> Vec<f64> {
    let results = (0..2 + READINGS).map(|_| {
        let line = board.run_until_line(
            |line| line.starts_with("d ") || line.starts_with("f "),
            PATIENCE,
        );
        line.expect("a result").text
    });
    let results: Vec<String> = results.skip(2).collect();
    let distances = results.iter().map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        assert_eq!(words[0], "d", "{line}");
        words[1].parse().expect("a distance")
    });
    distances.collect()
}

/// The errors of readings over the sensor's range, with the calibration that its flash holds.
fn errors(bench: &Bench) -> Vec<Compared> {
    let mut board = bench.power_on();
    board.send(&format!("rows {ROWS}\r\n"));
    board
        .run_until_line(|line| line == format!("rows {ROWS}"), PATIENCE)
        .expect("an answer");
    let simulation = Simulation::new(Scene::white_paper());
    let mut errors = vec![];
    for step in 0..STEPS {
        let share = f64::from(step) / f64::from(STEPS - 1);
        let distance = NEAREST + share * (FARTHEST - NEAREST);
        bench.target.move_to(distance);
        let found = readings(&mut board);
        let exposure = board.head(|head| head.last_row().map(|row| row.exposure.duration()));
        let centre = bench.optics.centre(distance);
        let seen_at = simulation.scene().optics.distance(centre);
        let of_row = bound::of_row(&simulation, seen_at, exposure.expect("a row") as f64 * 1e-9);
        let of_reading = of_row.expect("the scene has a bound") / f64::from(ROWS).sqrt();
        let bound = of_reading * bench.optics.metres_per_pixel(centre) * 1e6;
        errors.extend(found.iter().map(|found| Compared {
            error: (found - distance * 1e3) * 1e3,
            bound,
        }));
    }
    board.finish().expect("a clean run");
    errors
}

fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

/// RMS error of at most 1.2 of the bound and a micrometre: the bound is what the light's noise leaves, the
/// default estimator takes up to 1.1 of
/// it, and 60 points of two frames of 64 rows have an eighth of a reading's variance each.
#[test]
fn a_sensor_of_unknown_geometry_is_calibrated() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let stage = folder.join("stage");
    let bench = Bench {
        firmware: Firmware::build().expect("the firmware builds"),
        optics: DistortedOptics::unknown(6, DEPARTURE).expect("a geometry"),
        target: Target::at(NEAREST),
        flash: SharedFlash::default(),
    };
    // It really is another geometry.
    let centre = bench.optics.centre(NEAREST);
    let nominal = Optics::nominal().distance(centre);
    println!("nominal at {NEAREST} m: {nominal:.4} m");
    assert!((nominal - NEAREST).abs() > 1e-3);

    bench.work(&stage, |port| {
        let command = format!("echo {{}} > {}", stage.display());
        // A little more than the range in which it is used: a calibration ends with its points.
        let run = [
            "run", "--port", port, "--from", "598", "--to", "1022", "--points", "60",
        ];
        let how = [
            "--frames",
            "2",
            "--settle",
            "0.05",
            "--stage-command",
            &command,
            "points.csv",
        ];
        slitrange(folder, &[&run[..], &how].concat());
        slitrange(
            folder,
            &[
                "fit",
                "points.csv",
                "-o",
                "sensor.record",
                "--figure",
                "fit.svg",
            ],
        );
        slitrange(folder, &["write", "--port", port, "sensor.record"]);
        slitrange(folder, &["show", "sensor.record", "--port", port]);
    });

    let errors = errors(&bench);
    let rms_error = rms(errors.iter().map(|compared| compared.error));
    let bound = rms(errors.iter().map(|compared| compared.bound));
    let largest = errors.iter().fold(0.0, |largest: f64, compared| {
        largest.max(compared.error.abs())
    });
    println!(
        "{} readings after a power cycle: RMS error {rms_error:.2} um, bound {bound:.2} um, largest {largest:.2} um",
        errors.len()
    );
    assert!(rms_error <= 1.2 * bound + 1.0);
}
