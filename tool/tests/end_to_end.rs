//! Calibrates a sensor of unknown geometry, and measures a front end that nobody knows, with the commands
//! that the sensor's user gives, against the firmware on the emulated board, with a power cycle in between.
#![cfg(unix)]

use simulator::bound;
use simulator::distorted_optics::DistortedOptics;
use simulator::optics::Optics;
use statistics::rms;
use virtual_board::SharedFlash;
use virtual_board::board::Conditions;
use virtual_board::light::of_scene_through;
use virtual_board::stage::Stage;

use crate::command::*;
use crate::desk::Desk;

/// Where it is used, in metres.
const NEAREST: f64 = 0.60;
const FARTHEST: f64 = 1.02;
const ROWS: u16 = 16;
/// More than a frame takes, and an answer behind it.
const PATIENCE: Duration = Duration::from_secs(2);

struct Bench {
    firmware: Firmware,
    optics: DistortedOptics,
    scene: Scene,
    target: Target,
    flash: SharedFlash,
}

impl Bench {
    fn power_on(&self) -> VirtualBoard {
        let light = of_scene_through(self.optics, self.scene.clone(), self.target.clone());
        let conditions = with(Conditions::default(), |it| it.flash = self.flash.clone());
        VirtualBoard::power_on_under(&self.firmware, light, conditions).expect("the board starts")
    }

    /// Powers the sensor on, works with it at a PC, and cuts its power.
    fn work(&self, stage: &Path, work: impl FnOnce(&Desk)) {
        let stage = Stage::new(stage, self.target.clone());
        let desk = Desk::new(self.power_on(), Some(stage));
        work(&desk);
        desk.board.into_inner().finish().expect("a clean run");
    }
}

/// The first frames may still have rows of the place before.
fn readings(board: &mut VirtualBoard, count: usize) -> Vec<f64> {
    let results = (0..2 + count).map(|_| {
        let is_result = |line: &str| line.starts_with("d ") || line.starts_with("f ");
        let line = board.run_until_line(is_result, PATIENCE);
        line.expect("a result").text
    });
    let distances = results.skip(2).map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        assert_eq!(words[0], "d", "{line}");
        words[1].parse().expect("a distance")
    });
    distances.collect()
}

/// Errors of readings at even distances over the sensor's range, each beside the bound, in micrometres.
fn errors(bench: &Bench, steps: u32, count: usize) -> Vec<(f64, f64)> {
    let mut board = bench.power_on();
    board.send(&format!("rows {ROWS}\r\n"));
    let is_answer = |line: &str| line == format!("rows {ROWS}");
    board
        .run_until_line(is_answer, PATIENCE)
        .expect("an answer");
    let simulation = Simulation::new(Scene::white_paper());
    let mut errors = vec![];
    for step in 0..steps {
        let share = f64::from(step) / f64::from(steps - 1);
        let distance = NEAREST + share * (FARTHEST - NEAREST);
        bench.target.move_to(distance);
        let found = readings(&mut board, count);
        let exposure = board.head(|head| head.last_row().map(|row| row.exposure.laser));
        let centre = bench.optics.centre(distance);
        let seen_at = simulation.scene().optics.distance(centre);
        let of_row = bound::of_row(&simulation, seen_at, exposure.expect("a row") as f64 * 1e-9);
        let of_reading = of_row.expect("the scene has a bound") / f64::from(ROWS).sqrt();
        let bound = of_reading * bench.optics.metres_per_pixel(centre) * 1e6;
        let error = |found: &f64| (found - distance * 1e3) * 1e3;
        errors.extend(found.iter().map(|found| (error(found), bound)));
    }
    board.finish().expect("a clean run");
    errors
}

/// Calibrates a sensor that is `departure` metres from eq. (1), cuts its power, and holds that the RMS error
/// of its readings is at most `most` of the bound and a micrometre.
fn check(departure: f64, points: &str, frames: &str, (steps, count): (u32, usize), most: f64) {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let stage = folder.join("stage");
    let bench = Bench {
        firmware: Firmware::build().expect("the firmware builds"),
        optics: DistortedOptics::unknown(6, departure).expect("a geometry"),
        scene: Scene::white_paper(),
        target: Target::at(NEAREST),
        flash: SharedFlash::default(),
    };
    // It really is another geometry.
    let nominal = Optics::nominal().distance(bench.optics.centre(NEAREST));
    println!("nominal at {NEAREST} m: {nominal:.4} m");
    assert!((nominal - NEAREST).abs() > 1e-3);
    let file = |name| folder.join(name).display().to_string();
    let [points_file, record, recording] = ["points.csv", "sensor.record", "run.csv"].map(file);
    let [figure, settings] = ["fit.svg", "bench.toml"].map(file);
    bench.work(&stage, |desk| {
        // A little more than the range in which it is used: a calibration ends with its points.
        let run = format!(
            "calibrate run --port board --from 598 --to 1022 --points {points} --frames {frames} --settle 0.05"
        );
        let move_to = format!("echo {{}} > {}", stage.display());
        let mut words: Vec<&str> = run.split(' ').collect();
        words.extend(["--stage-command", &move_to, &points_file]);
        done(slitrange(desk, &words, ""));
        for line in [
            format!("calibrate fit {points_file} -o {record} --figure {figure}"),
            format!("calibrate write --port board {record}"),
            format!("calibrate show {record} --port board"),
            format!("monitor --port board --csv {recording} --count 5"),
            format!("settings export {settings} --port board"),
            format!("settings import {settings} --port board"),
        ] {
            done(desk.run(&line));
        }
    });
    let lines = std::fs::read_to_string(&recording).expect("a recording");
    assert_eq!(lines.lines().count(), 6, "{lines}");
    let errors = errors(&bench, steps, count);
    let rms_error = rms(errors.iter().map(|(error, _)| error));
    let bound = rms(errors.iter().map(|(_, bound)| bound));
    let largest = errors.iter().map(|it| it.0.abs()).fold(0.0, f64::max);
    println!(
        "{} readings after a power cycle: RMS error {rms_error:.2} um, bound {bound:.2} um, largest \
         {largest:.2} um",
        errors.len()
    );
    assert!(rms_error <= most * bound + 1.0);
}

/// The limit is 1.1 * 1.04 * 1.61 of the bound, which is the error by the noise of the light. 1.1: the
/// default estimator. 1.04: the calibration has nine points, each with a quarter of the variance of a
/// reading, for the three parameters of eq. (1), which adds a twelfth to the variance. 1.61: twelve readings
/// give an RMS to 20 %, and the test allows three standard deviations.
#[test]
fn a_sensor_of_unknown_geometry_is_calibrated() {
    check(0.0, "9", "1", (6, 2), 1.84);
}

/// The calibration has 60 points of two frames, each with an eighth of the variance of a reading.
#[test]
#[ignore = "78 s of an emulated board; takes 180 CPU s; run by .ci/run"]
fn a_sensor_that_departs_from_eq1_is_calibrated() {
    check(300e-6, "60", "2", (22, 4), 1.2);
}

/// After a power cycle the sensor says what was measured of `scenes/unknown-front-end.toml`.
#[test]
#[ignore = "a minute of an emulated board; takes minutes of CPU time; run by .ci/run"]
fn a_front_end_is_measured() {
    let scene = Scene::load("unknown-front-end").expect("a scene");
    let amplifier = scene.front_end.expect("a front end");
    let electrons = scene.shot_noise.expect("shot noise").electrons_per_count;
    let bench = Bench {
        firmware: Firmware::build().expect("the firmware builds"),
        optics: DistortedOptics {
            optics: scene.optics,
            third: 0.0,
            fifth: 0.0,
        },
        target: Target::at(scene.distance),
        scene: scene.clone(),
        flash: SharedFlash::default(),
    };
    let folder = tempfile::tempdir().expect("a folder");
    bench.work(&folder.path().join("stage"), |desk| {
        done(desk.run("head measure --port board"));
        println!("{:.0} s of the board's time", desk.now().as_secs_f64());
    });
    let mut board = bench.power_on();
    board.send("stream off\r\ninfo\r\n");
    let mut number = |before: &str, after: &str| -> f64 {
        let line = board.run_until_line(|line| line.contains(before), PATIENCE);
        let text = line.expect("a line of `info`").text;
        println!("{text}");
        let (_, rest) = text.split_once(before).expect("found");
        let (number, _) = rest.split_once(after).expect("a unit");
        number.parse().expect("a number")
    };
    let read_noise = scene.read_noise.expect("read noise").counts;
    let saturation = amplifier.saturation.expect("a saturation");
    for (name, unit, truth) in [
        ("gain", " electrons", electrons / amplifier.gain),
        ("read noise", " counts", read_noise),
        ("saturation", " counts", saturation),
    ] {
        let found = number(&format!("info front end {name} "), unit);
        println!("{name}: {found} of {truth:.2}");
        assert!((found / truth - 1.0).abs() < 0.05, "{name}");
    }
    board.finish().expect("a clean run");
}
