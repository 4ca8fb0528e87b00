//! `slitrange doctor` on the virtual board: a good sensor is all right, and of each fault the first line that
//! is not ok names it.

use virtual_board::board::Conditions;
use virtual_board::flash::Contents;
use virtual_board::{Exposure, LightSource, OpenLine, SharedFlash};

use crate::command::*;
use crate::desk::Desk;

/// The name of a fault, the check of `doctor` that must find it, and words that the check's line must have.
/// [`scene`], [`light_of`], [`conditions`], [`board_with`] and [`ANOTHER_ESTIMATOR`] look for these names and
/// cause the faults.
type Fault = (&'static str, &'static str, &'static str);

const FAULTS: &[Fault] = &[
    ("no converter", "rows", "converter"),
    ("MISO and SCLK exchanged", "rows", "wires"),
    ("ICG and SH exchanged", "laser", "ICG and SH"),
    ("no laser", "laser", "adds no light"),
    ("covered", "laser", "uncover"),
    ("inverted laser", "laser", "inverted"),
    ("dim spot", "light", "dim"),
    ("saturated", "light", "saturated"),
    ("lamp", "light", "lamp"),
    ("gain of 1", "gain", "amplifier"),
    ("trimmer at one end", "black", "too high"),
    ("trimmer at the other end", "black", "too low"),
    ("noise", "noise", "ripple"),
    ("dead pixels", "pixels", "stand out"),
    ("no external clock", "clock", "ST-LINK"),
    ("SCLK with gaps", "timing", "late"),
    ("out of focus", "width", "focus"),
    ("laser off", "laser", "`laser off` is set"),
    (
        "distances off, and other columns",
        "calibration",
        "calibration on",
    ),
    ("noisy line", "line", "spoilt"),
    ("nobody calibrated it", "calibration", "nobody"),
    (ANOTHER_ESTIMATOR, "calibration", "estimator"),
];

const ANOTHER_ESTIMATOR: &str = "another estimator";

fn scene(fault: &str) -> Scene {
    let (width, factor, effects) = match fault {
        "no laser" => (
            8.6,
            0.0,
            "ambient = { counts_per_second = 10e3, slope = 0.0 }",
        ),
        "covered" => (8.6, 0.0, ""),
        "dim spot" => (8.6, 0.026, ""),
        "saturated" => (8.6, 3e4, ""),
        "out of focus" => (12.0, 1.0, ""),
        "gain of 1" => (8.6, 1.0, "front_end = { gain = 0.2, offset = 0.0 }"),
        "trimmer at one end" => (8.6, 1.0, "black_level.counts = 2.0"),
        "trimmer at the other end" => (8.6, 1.0, "black_level.counts = 1900.0"),
        "noise" => (8.6, 1.0, "read_noise.counts = 60.0"),
        "dead pixels" => (
            8.6,
            1.0,
            "hot_pixels = { share = 0.01, counts_per_second = 60e3 }",
        ),
        _ => (8.6, 1.0, ""),
    };
    let mut scene = Scene::white_paper().listing(effects).expect("a scene");
    let height = scene.spot.expect("a spot").counts_per_second * factor;
    scene.spot = (factor > 0.0).then_some(Spot::new(width, height));
    scene
}

fn light_of(fault: &str) -> LightSource {
    let light = of_scene(scene(fault), Target::at(0.8));
    match fault {
        "ICG and SH exchanged" => without_shift(light),
        "inverted laser" => inverted(light),
        "lamp" => with_lamp(light),
        _ => light,
    }
}

fn conditions(fault: &str, calibrated: &Contents) -> Conditions {
    let flash = match fault {
        "out of focus" | "nobody calibrated it" | "bare" => SharedFlash::default(),
        _ => SharedFlash::holding(calibrated.clone()),
    };
    Conditions {
        flash,
        has_brown_out_reset: fault != "bare",
        has_clock: fault != "no external clock",
        ..Conditions::default()
    }
}

fn board_with(fault: &str, board: &mut VirtualBoard) -> anyhow::Result<()> {
    match fault {
        "no converter" | "bare" => board.open_line(Some(OpenLine::Ones)),
        "MISO and SCLK exchanged" => board.open_line(Some(OpenLine::Zeros)),
        "SCLK with gaps" => board.pause_words(Some((3600, Duration::from_micros(2))))?,
        "laser off" => board.send("laser off\r\n"),
        "distances off, and other columns" => {
            board.send("calibration off\r\noutput counter time\r\n")
        }
        "noisy line" => board.garble_serial_line(20_000, 20_000, 3)?,
        _ => {}
    }
    Ok(())
}

/// The laser is on when it should be off.
fn inverted(mut light: LightSource) -> LightSource {
    Box::new(move |exposure: &Exposure| {
        let mut inverted = *exposure;
        inverted.laser = exposure.duration() - exposure.laser;
        light(&inverted)
    })
}

/// A lamp behind the slit.
fn with_lamp(mut light: LightSource) -> LightSource {
    Box::new(move |exposure: &Exposure| {
        let mut outputs = light(exposure);
        for (output, place) in outputs.iter_mut().zip(-2500i32..) {
            *output += 400.0 * (-0.005 * (place * place) as f32).exp();
        }
        outputs
    })
}

/// SH does what ICG should: no pixel shows light.
fn without_shift(mut light: LightSource) -> LightSource {
    Box::new(move |exposure: &Exposure| {
        let mut outputs = light(exposure);
        outputs.fill(300.0);
        // The converter's noise.
        for (number, output) in outputs.iter_mut().enumerate() {
            *output += (number * 7919 % 13) as f32 - 6.0;
        }
        outputs
    })
}

/// The output of the doctor for a sensor that was calibrated, with a fault.
fn doctor(firmware: &Firmware, calibrated: &Contents, (fault, check, _): Fault) -> String {
    let (light, conditions) = (light_of(fault), conditions(fault, calibrated));
    let board = VirtualBoard::power_on_under(firmware, light, conditions);
    let mut board = board.expect("the board starts");
    board.expect_violations();
    let banner = board.run_until_line(|line| line.contains("slitrange "), Duration::from_secs(6));
    banner.expect("a banner");
    board_with(fault, &mut board).expect("the fault");
    board.run_for(Duration::from_millis(500)).expect("a run");
    let desk = Desk::new(board, None);
    if fault == ANOTHER_ESTIMATOR {
        done(desk.run("settings set estimator centroid --port board"));
    }
    // Over a noisy line so many questions may find no answer.
    let is_noisy = check == "line";
    let settings = || (!is_noisy).then(|| done(desk.run("settings --port board")));
    let before = settings();
    let said = done(desk.run("doctor --port P"));
    assert_eq!(settings(), before, "{fault}");
    said
}

/// What flash holds of a sensor that was calibrated.
fn calibrated(firmware: &Firmware) -> Contents {
    let record = with(Record::nominal().expect("a record"), |it| {
        it.serial_number = 7
    });
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.record");
    let record = EncodedRecord::new(record).expect("a record");
    record_file::write(&path, &record, false).expect("a file");
    let flash = SharedFlash::default();
    let conditions = with(Conditions::default(), |it| it.flash = flash.clone());
    let light = of_scene(Scene::white_paper(), Target::at(0.8));
    let board = VirtualBoard::power_on_under(firmware, light, conditions).expect("a board");
    let desk = Desk::new(board, None);
    done(desk.run(&format!("calibrate write --port board {}", path.display())));
    flash.contents()
}

/// Holds that a page shows this output, but for its numbers.
fn assert_shown(page: &str, output: &str) {
    let without_numbers = |text: &str| text.replace(|it: char| it.is_ascii_digit(), "");
    let page = without_numbers(page).replace("\n    ", "\n");
    assert!(
        page.contains(&without_numbers(output)),
        "no page shows\n{output}"
    );
}

fn check(faults: &[Fault]) {
    let firmware = Firmware::build().expect("the firmware builds");
    let calibrated = calibrated(&firmware);
    let good = doctor(&firmware, &calibrated, ("none", "", ""));
    assert_eq!(good.matches("ok    ").count(), 16, "{good}");
    assert_shown(include_str!("../../docs/tool.md"), &good);
    let mut wrong = vec![];
    for &fault in faults {
        let (name, check, words) = fault;
        println!("{name}:");
        let said = doctor(&firmware, &calibrated, fault);
        let first = said.lines().find(|line| line.starts_with("WRONG "));
        let first = first.unwrap_or("all is ok");
        if !first.starts_with(&format!("WRONG {check}: ")) || !first.contains(words) {
            wrong.push(format!("{name}: {first}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_good_sensor_is_ok_and_a_missing_laser_is_named() {
    check(&FAULTS[3..4]);
}

#[test]
#[ignore = "two minutes of the virtual board; .ci/run runs it"]
fn each_fault_is_named_by_the_first_line_that_is_not_ok() {
    check(FAULTS);
    let bare = ("bare", "", "");
    let firmware = Firmware::build().expect("the firmware builds");
    let said = doctor(&firmware, &SharedFlash::default().contents(), bare);
    assert_shown(include_str!("../../docs/first-hour.md"), &said);
}
