//! Tests of the laser: when it is on, for how long, and when it must be off.

use std::process::Command;

use judges::changing_light::{self, BRIGHTEST};
use simulator::scene::Exposure as Times;

use super::common::*;
use super::identical::{logarithmic, run_as_on_this_pc};

/// Each row has its exposure to the nanosecond, and the pulse lies in the row's middle, without jitter.
#[test]
fn the_laser_is_on_for_the_exposure_in_the_middle_of_each_row() {
    let mut board = measuring(4);
    let longest = 5600;
    for us in [10, 11, 187, longest - 1, longest] {
        set(&mut board, &format!("exposure {us}"));
        // The first frame has no row of the exposure before.
        let first = &results(&mut board, 3)[0];
        println!("exposure {us}: {first}");
        match us {
            5600 => assert!(!first.contains(" t "), "{first}"),
            10 | 11 => assert!(first.starts_with("f "), "{first}"),
            _ => assert!(first.contains(&format!(" n 4/4 t {us}")), "{first}"),
        }
        let (rows, pulses) = board.head(|head| {
            let exposures: Vec<_> = head.rows().rev().take(8).map(|row| row.exposure).collect();
            let pulses: Vec<_> = head.laser_pulses().cloned().collect();
            (exposures, pulses)
        });
        let mut middles = vec![];
        for exposure in rows {
            assert_eq!(exposure.laser, us * 1000, "{us} us");
            let during = exposure.start..exposure.end;
            let pulse = pulses.iter().find(|pulse| during.contains(&pulse.start));
            let pulse = pulse.expect("a pulse in each row");
            assert!(pulse.end < exposure.end, "{pulse:?} in {exposure:?}");
            middles.push(pulse.start.midpoint(pulse.end) - exposure.start);
        }
        middles.sort_unstable();
        let (least, most) = (middles[0], middles[middles.len() - 1]);
        println!("{us} us: middle of the pulse {least} to {most} ns after the row's begin");
        // The timer starts at once, and the longest exposure has the same middle.
        let middle = longest * 500;
        assert!((middle..middle + 3_000).contains(&least), "{least}");
        assert!(most - least < 100, "a jitter of {} ns", most - least);
    }
    board.send("info\r\n");
    let rate = await_line(&mut board, |line| line.starts_with("info rate ")).text;
    assert!(rate.ends_with(&format!(" to {longest} us")), "{rate}");
}

#[test]
fn a_laser_that_is_set_off_stays_off_and_the_answer_says_so() {
    let mut board = measuring(4);
    set(&mut board, "laser off");
    results(&mut board, 3);
    let before = laser_time(&mut board);
    results(&mut board, 3);
    assert_eq!(laser_time(&mut board), before);
    board.send("distance\r\n");
    await_text(&mut board, "(send `laser on`)");
    // It is off after a start, if that is what was saved.
    save(&mut board);
    press_reset(&mut board);
    results(&mut board, 2);
    assert_eq!(laser_time(&mut board), before);
    set(&mut board, "laser on");
    results(&mut board, 2);
    assert!(laser_time(&mut board) > before);
}

/// A panic stops everything. The pulse under way ends by itself, and the reset brings no other before the
/// settings are known.
#[test]
fn the_laser_goes_off_when_the_firmware_stops() {
    let mut board = measuring(4);
    results(&mut board, 3);
    board.panic_at("measure_row").expect("the function");
    // The panic comes within a row, and the pulse under way ends in another.
    run_ms(&mut board, 20);
    let stopped = laser_time(&mut board);
    while board.resets().expect("resets").is_empty() {
        run_ms(&mut board, 10);
        assert!(board.now() < 5_000_000_000, "no reset");
        assert_eq!(laser_time(&mut board), stopped);
    }
    board.unhang("measure_row").expect("the function");
    results(&mut board, 2);
    assert!(laser_time(&mut board) > stopped);
    // In a reset the pin has no output.
    run_into_a_pulse(&mut board);
    board.reset_pin().expect("the emulator");
    let at_reset = laser_time(&mut board);
    run_ms(&mut board, 6);
    // The instruction under way ends later than the time of the reset.
    let most = cycles_an_instruction() * 1e9 / 168e6;
    let later = laser_time(&mut board) - at_reset;
    assert!(later as f64 <= most, "{later} ns");
    results(&mut board, 1);
}

/// White paper's spot on targets whose brightness jumps to any value within 10,000 to 1, every `rows` rows.
fn jumping(rows: u64) -> LightSource {
    let simulation = Simulation::new(changing_light::scene().with_height(BRIGHTEST));
    let mut random = ChaCha8Rng::seed_from_u64(19);
    let (mut row, mut reflectivity) = (0, 1.0);
    Box::new(move |exposure: &Exposure| {
        if row % rows == 0 {
            reflectivity = logarithmic(&mut random, 1e-4, 1.0);
        }
        row += 1;
        let laser = exposure.laser as f64 * 1e-9 * reflectivity;
        let times = Times {
            row: exposure.duration() as f64 * 1e-9,
            laser,
            laser_before: laser,
        };
        simulation.row(row, DISTANCE, times)
    })
}

/// Asserts that the lines of frames of 16 rows are those of the PC, that a frame without a reading holds a
/// jump, and that no reading is off by more than five times the noise that it claims.
fn assert_jumps_are_followed(jumps: u64) {
    // A frame and a half, and some: jumps come anywhere in a frame.
    const ROWS: u64 = 39;
    let (light, rows) = (jumping(ROWS), jumps * ROWS);
    let (_, chip, kinds) =
        run_as_on_this_pc(light, &["exposure auto"], rows, 1, Options::default());
    let optics = Scene::white_paper().optics;
    let truth = optics.centre(DISTANCE);
    let mm_per_pixel = 1e3 * optics.metres_per_pixel(truth).abs();
    let mut worst = 0.0f64;
    for line in chip.iter().filter(|line| is_reading(line)) {
        let error = (number(line, " x ", " a") - truth).abs() * mm_per_pixel;
        worst = worst.max(error / number(line, " r ", " x"));
    }
    println!("{jumps} jumps: {kinds:?}; largest error {worst:.2} r");
    assert!(worst < 5.0);
    let faults = chip.len() - kinds["reading"];
    assert!(faults as u64 <= jumps, "{kinds:?}");
    let mut pairs = chip.windows(2);
    assert!(pairs.all(|pair| is_reading(&pair[0]) || is_reading(&pair[1])));
}

#[test]
fn a_jump_of_the_brightness_costs_at_most_a_frame() {
    assert_jumps_are_followed(12);
}

#[test]
#[ignore = "22 s of virtual time, half a minute; .ci/run runs it"]
fn a_hundred_jumps_of_the_brightness_cost_at_most_a_frame_each() {
    assert_jumps_are_followed(100);
}

fn demo_of_reflectivity(options: &[&str]) -> serde_json::Value {
    let mut demo = Command::new(env!("CARGO_BIN_EXE_demo"));
    let demo = demo.args(["--scene", "reflectivity", "--json"]);
    let output = demo.args(options).output().expect("the demo starts");
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Black tape, white paper and bright metal: a fault is allowed in the first frame after a change only.
#[test]
#[ignore = "44 s of virtual time, a minute; .ci/run runs it"]
fn the_demo_measures_black_tape_and_bright_metal_on_one_setting() {
    let auto = demo_of_reflectivity(&[]);
    let fixed = demo_of_reflectivity(&["--set", "exposure 5600"]);
    println!("auto {auto}\nfixed {fixed}");
    assert_eq!(auto["late_faults"], 0);
    assert!(auto["within_2u"].as_f64() >= Some(0.93), "{auto}");
    assert!(auto["faults"].as_u64() <= Some(16), "{auto}");
    // Three of four targets are too bright for the longest exposure.
    assert!(fixed["late_faults"].as_u64() > Some(100), "{fixed}");
}
