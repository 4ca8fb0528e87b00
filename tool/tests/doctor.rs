//! `slitrange doctor` on the virtual board: a good sensor is all right, and of each fault the first line that
//! is not ok names it.

use std::time::Duration;

use simulator::scene::{Ambient, BlackLevel, FrontEnd, HotPixels, ReadNoise, Scene};
use slitrange_device::record::Record;
use slitrange_device::record::encoded::EncodedRecord;
use slitrange_tool::record_file;
use virtual_board::board::Conditions;
use virtual_board::flash::Contents;
use virtual_board::light::{Target, of_scene};
use virtual_board::{Exposure, Firmware, LightSource, OpenLine, SharedFlash, VirtualBoard};

use crate::command::done;
use crate::desk::Desk;

/// A fault. `found` is the check that must name it, and words of that line. What follows puts the fault in.
struct Fault {
    name: &'static str,
    found: (&'static str, &'static str),
    scene: fn(&mut Scene),
    light: fn(LightSource) -> LightSource,
    conditions: fn(&mut Conditions),
    board: fn(&mut VirtualBoard),
    /// A command of the tool that comes before.
    before: &'static str,
}

const NONE: Fault = Fault {
    name: "none",
    found: ("", ""),
    scene: |_| {},
    light: |light| light,
    conditions: |_| {},
    board: |_| {},
    before: "",
};

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

fn spot_of(scene: &mut Scene, factor: f64) {
    scene.spot.as_mut().expect("a spot").counts_per_second *= factor;
}

const FAULTS: &[Fault] = &[
    Fault {
        name: "no converter",
        found: ("rows", "converter"),
        board: |it| it.open_line(Some(OpenLine::Ones)),
        ..NONE
    },
    Fault {
        name: "MISO and SCLK exchanged",
        found: ("rows", "wires"),
        board: |it| it.open_line(Some(OpenLine::Zeros)),
        ..NONE
    },
    Fault {
        name: "ICG and SH exchanged",
        found: ("laser", "ICG and SH"),
        light: without_shift,
        ..NONE
    },
    Fault {
        name: "no laser",
        found: ("laser", "adds no light"),
        scene: |it| {
            it.spot = None;
            it.ambient = Some(Ambient {
                counts_per_second: 10e3,
                slope: 0.0,
            });
        },
        ..NONE
    },
    Fault {
        name: "covered",
        found: ("laser", "uncover"),
        scene: |it| it.spot = None,
        ..NONE
    },
    Fault {
        name: "inverted laser",
        found: ("laser", "inverted"),
        light: inverted,
        ..NONE
    },
    Fault {
        name: "dim spot",
        found: ("light", "dim"),
        scene: |it| spot_of(it, 0.026),
        ..NONE
    },
    Fault {
        name: "saturated",
        found: ("light", "saturated"),
        scene: |it| spot_of(it, 3e4),
        ..NONE
    },
    Fault {
        name: "lamp",
        found: ("light", "lamp"),
        light: with_lamp,
        ..NONE
    },
    Fault {
        name: "gain of 1",
        found: ("gain", "amplifier"),
        scene: |it| {
            it.front_end = Some(FrontEnd {
                gain: 0.2,
                offset: 0.0,
                saturation: None,
            })
        },
        ..NONE
    },
    Fault {
        name: "trimmer at one end",
        found: ("black", "too high"),
        scene: |it| {
            it.black_level = Some(BlackLevel {
                counts: 2.0,
                drift: 0.0,
            })
        },
        ..NONE
    },
    Fault {
        name: "trimmer at the other end",
        found: ("black", "too low"),
        scene: |it| {
            it.black_level = Some(BlackLevel {
                counts: 1900.0,
                drift: 0.0,
            })
        },
        ..NONE
    },
    Fault {
        name: "noise",
        found: ("noise", "ripple"),
        scene: |it| it.read_noise = Some(ReadNoise { counts: 60.0 }),
        ..NONE
    },
    Fault {
        name: "dead pixels",
        found: ("pixels", "stand out"),
        scene: |it| {
            it.hot_pixels = Some(HotPixels {
                share: 0.01,
                counts_per_second: 60e3,
            })
        },
        ..NONE
    },
    Fault {
        name: "no external clock",
        found: ("clock", "ST-LINK"),
        conditions: |it| it.has_clock = false,
        ..NONE
    },
    Fault {
        name: "SCLK with gaps",
        found: ("timing", "late"),
        board: |it| {
            it.pause_words(Some((3600, Duration::from_micros(2))))
                .expect("a gap")
        },
        ..NONE
    },
    Fault {
        name: "out of focus",
        found: ("width", "focus"),
        scene: |it| it.spot.as_mut().expect("a spot").width = 12.0,
        conditions: |it| it.flash = SharedFlash::default(),
        ..NONE
    },
    Fault {
        name: "laser off",
        found: ("laser", "`laser off` is set"),
        board: |it| it.send("laser off\r\n"),
        ..NONE
    },
    Fault {
        name: "distances off, and other columns",
        found: ("calibration", "calibration on"),
        board: |it| it.send("calibration off\r\noutput counter time\r\n"),
        ..NONE
    },
    Fault {
        name: "noisy line",
        found: ("line", "spoilt"),
        board: |it| it.garble_serial_line(20_000, 20_000, 3).expect("a line"),
        ..NONE
    },
    Fault {
        name: "nobody calibrated it",
        found: ("calibration", "nobody"),
        conditions: |it| it.flash = SharedFlash::default(),
        ..NONE
    },
    Fault {
        name: "another estimator",
        found: ("calibration", "estimator"),
        before: "settings set estimator centroid --port board",
        ..NONE
    },
];

/// The output of the doctor for a sensor that was calibrated, with a fault.
fn doctor(firmware: &Firmware, calibrated: &Contents, fault: &Fault) -> String {
    let mut scene = Scene::white_paper();
    (fault.scene)(&mut scene);
    let flash = SharedFlash::default();
    flash.put(calibrated.clone());
    let mut conditions = Conditions {
        flash,
        has_brown_out_reset: true,
        ..Conditions::default()
    };
    (fault.conditions)(&mut conditions);
    let light = (fault.light)(of_scene(scene, Target::at(0.8)));
    let board = VirtualBoard::power_on_under(firmware, light, conditions);
    let mut board = board.expect("the board starts");
    board.expect_violations();
    let banner = board.run_until_line(|line| line.contains("slitrange "), Duration::from_secs(6));
    banner.expect("a banner");
    (fault.board)(&mut board);
    board.run_for(Duration::from_millis(500)).expect("a run");
    let desk = Desk::new(board, None);
    if !fault.before.is_empty() {
        done(desk.run(fault.before));
    }
    // Over a noisy line so many questions may find no answer.
    let is_noisy = fault.found.0 == "line";
    let settings = || (!is_noisy).then(|| done(desk.run("settings --port board")));
    let before = settings();
    let said = done(desk.run("doctor --port P"));
    assert_eq!(settings(), before, "{}", fault.name);
    said
}

/// What flash holds of a sensor that was calibrated.
fn calibrated(firmware: &Firmware) -> Contents {
    let record = Record {
        serial_number: 7,
        ..Record::nominal().expect("a record")
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.record");
    let record = EncodedRecord::new(record).expect("a record");
    record_file::write(&path, &record, false).expect("a file");
    let flash = SharedFlash::default();
    let conditions = Conditions {
        flash: flash.clone(),
        ..Conditions::default()
    };
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
    let good = doctor(&firmware, &calibrated, &NONE);
    assert_eq!(good.matches("ok    ").count(), 16, "{good}");
    assert_shown(include_str!("../../docs/tool.md"), &good);
    let mut wrong = vec![];
    for fault in faults {
        println!("{}:", fault.name);
        let said = doctor(&firmware, &calibrated, fault);
        let first = said
            .lines()
            .find(|line| line.starts_with("WRONG "))
            .unwrap_or("all is ok");
        let (check, words) = fault.found;
        if !first.starts_with(&format!("WRONG {check}: ")) || !first.contains(words) {
            wrong.push(format!("{}: {first}", fault.name));
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
    let bare = Fault {
        conditions: |it| (it.flash, it.has_brown_out_reset) = (SharedFlash::default(), false),
        board: |it| it.open_line(Some(OpenLine::Ones)),
        ..NONE
    };
    let firmware = Firmware::build().expect("the firmware builds");
    let said = doctor(&firmware, &SharedFlash::default().contents(), &bare);
    assert_shown(include_str!("../../docs/first-hour.md"), &said);
}
