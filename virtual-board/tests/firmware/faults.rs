//! Provokes every fault. The firmware reports the fault by its name and never gives a distance.

use judges::frames;
use simulator::optics::Optics;
use slitrange_device::protocol::advice::advice;
use virtual_board::FULL_SCALE;

use super::common::*;

/// A spot that is neither dim nor saturated, counts.
const BRIGHT: f64 = 2000.0;

/// Shows the firmware only `light` from its first row on, with these settings. Asserts that every line is the
/// fault of that name, streamed or as the answer to `distance`. Gives one line.
fn only_fault(settings: &[&str], name: &str, light: LightSource) -> String {
    let (mut board, _) = boot(light);
    for setting in settings {
        set(&mut board, setting);
        results(&mut board, 4);
        board.take_lines();
    }
    set(&mut board, "rows 4");
    results(&mut board, 8);
    // All since the start or the last setting.
    let lines = take_results(&mut board);
    assert_distance_gives_advice(&mut board, name);
    assert_all_are(&lines, name);
    println!("{} lines like: {}", lines.len(), lines[0]);
    lines[0].clone()
}

/// Asserts that `distance` is answered by the fault and its advice.
pub fn assert_distance_gives_advice(board: &mut VirtualBoard, name: &str) {
    board.take_lines();
    board.send("distance\r\n");
    await_line(board, |line| line.starts_with('('));
    let lines: Vec<String> = take_texts(board);
    let [.., fault, advice] = &lines[..] else {
        panic!("advice without a fault: {lines:#?}");
    };
    assert_all_are(std::slice::from_ref(fault), name);
    assert_eq!(*advice, format!("({})", advice_for(name)), "{lines:#?}");
}

pub fn assert_all_are(lines: &[String], name: &str) {
    let fault = format!("f {name}");
    let is_fault = |line: &String| {
        let rest = line.strip_prefix(&fault);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(": "))
    };
    let all = !lines.is_empty() && lines.iter().all(is_fault);
    assert!(all, "{fault} and nothing else: {lines:#?}");
}

fn advice_for(name: &str) -> &'static str {
    let faults = frames::faults([0; 2], [0; 2]);
    let fault = faults.iter().find(|fault| fault.name() == name);
    advice(fault.expect("the name of a fault"))
}

fn noise() -> f64 {
    Scene::white_paper().read_noise.expect("noise").counts
}

#[test]
fn without_a_laser_there_is_no_spot() {
    let scene = with(Scene::white_paper(), |it| it.spot = None);
    let line = only_fault(&[], "no spot", of_scene(scene, Target::at(DISTANCE)));
    let highest = number(&line, ": ", " counts at most") / noise();
    assert!((0.0..5.0).contains(&highest), "{line}");
}

#[test]
fn a_spot_in_the_noise_is_too_dim() {
    // In standard deviations of the noise, a spot of 8.6 pixels is found from 1.5 on and gives a centre from
    // 3 on.
    let noise = noise();
    let light = || spot_at(1800.0, 2.25 * noise);
    let line = only_fault(&["exposure 5600"], "too dim", light());
    let (height, needed) = (number(&line, ": ", " counts"), number(&line, "needs ", ""));
    assert!((noise..needed).contains(&height), "{line}");
    let range = 2.25 * noise..4.0 * noise;
    assert!(range.contains(&needed), "{line}");
    // Auto exposure can do no more.
    let line = only_fault(&[], "too dim at the longest exposure", light());
    assert!(line.ends_with(" in 5600 us"), "{line}");
}

/// White paper with spots at pixels `first` and `second`, of which the second is a little lower.
fn two_spots(first: f64, second: f64) -> LightSource {
    // The sum of two lights, without the black level and the noise of one of them.
    let mut light = spot_at(first, BRIGHT);
    Box::new(move |exposure| {
        let mut counts = light(exposure);
        Spot::new(8.6, 0.0).add(&mut counts[LIGHT], second, 0.95 * BRIGHT);
        counts
    })
}

#[test]
fn two_spots_of_similar_height_are_a_fault() {
    let (first, second) = (1600.0, 2000.0);
    let line = only_fault(&[], "two spots", two_spots(first, second));
    let higher = number(&line, "x ", " and") - first;
    let other = number(&line, "and ", "") - second;
    assert!(higher.abs() < 10.0 && other.abs() < 10.0, "{line}");
}

#[test]
fn the_settings_region_and_peak_choose_one_of_two_spots() {
    let (first, second) = (1600.0, 2000.0);
    let mut board = measuring_in(two_spots(first, second), 4);
    for (setting, centre) in [
        ("peak first", first),
        ("peak last", second),
        ("region 1800 2600", second),
        ("region 1000 1800", first),
        ("peak strongest", first),
    ] {
        set(&mut board, setting);
        for line in fresh_results(&mut board, 4) {
            println!("{setting}: {line}");
            assert!(is_reading(&line), "{setting}: {line}");
            let error = number(&line, "x ", " a") - centre;
            assert!(error.abs() < 0.05, "{setting}: {line}");
        }
    }
    assert!(ask(&mut board, "region 3600 3700").starts_with("E22 "));
    // With `peak`, the first row of a frame takes several searches, in less than the time of a row.
    let slowest = Status::ask(&mut board).count("slowest row cycles");
    println!("slowest row: {slowest} cycles of the virtual board");
    assert!(slowest < 957_600);
}

#[test]
fn rows_that_disagree_are_unsteady() {
    // Every other row of the frame shows the spot elsewhere: 50 px to either side of the mean, with a width
    // of 8.6 px.
    let (mut here, mut there) = (spot_at(1750.0, BRIGHT), spot_at(1850.0, BRIGHT));
    let mut rows = 0;
    let light = move |exposure: &virtual_board::Exposure| {
        rows += 1;
        match rows % 2 {
            0 => here(exposure),
            _ => there(exposure),
        }
    };
    let line = only_fault(&[], "unsteady", Box::new(light));
    let scatter = number(&line, "scatter by ", " px");
    assert!((49.9..50.1).contains(&scatter), "{line}");
}

#[test]
fn a_spot_with_its_top_cut_off_is_saturated() {
    let light = || spot_at(1800.0, 3.0 * f64::from(FULL_SCALE));
    let line = only_fault(&["exposure 5600"], "saturated", light());
    // A gaussian of sigma 8.6 that is three times as high is cut off over 26 pixels.
    let pixels = number(&line, ": ", " pixels");
    assert!((20.0..=30.0).contains(&pixels), "{line}");
    // This light does not depend on the laser, so auto exposure ends at the shortest.
    let name = "saturated at the shortest exposure";
    let line = only_fault(&["exposure auto"], name, light());
    assert!(line.ends_with(" pixels in 10 us"), "{line}");
}

#[test]
fn a_spot_at_either_edge_is_a_fault() {
    // A quarter of a width beyond the edge. If less is cut off, the fit still works.
    for edge in [-2.0, 3649.0] {
        let line = only_fault(&[], "spot at the edge", spot_at(edge, BRIGHT));
        assert!((number(&line, "x ", "") - edge).abs() < 20.0, "{line}");
    }
}

#[test]
fn a_target_outside_the_calibration_is_out_of_range() {
    for distance in [0.50, 1.20] {
        let light = of_scene(Scene::white_paper(), Target::at(distance));
        let line = only_fault(&[], "out of range", light);
        let (centre, expected) = (number(&line, "x ", ""), Optics::nominal().centre(distance));
        assert!((centre - expected).abs() < 0.2, "{expected}: {line}");
    }
}

#[test]
fn without_calibration_there_is_a_centre_and_no_distance() {
    let mut board = measuring(4);
    assert_readings(&fresh_results(&mut board, 2));
    set(&mut board, "calibration off");
    let lines = fresh_results(&mut board, 4);
    assert_all_are(&lines, "not calibrated");
    let error = number(&lines[0], "x ", " ") - Optics::nominal().centre(DISTANCE);
    assert!(error.abs() < 0.1, "{error} px off: {lines:#?}");
    let uncertainty = number(&lines[0], "u ", "");
    assert!((0.001..0.1).contains(&uncertainty), "{lines:#?}");
    assert_distance_gives_advice(&mut board, "not calibrated");

    set(&mut board, "calibration on");
    assert_all_measure(&fresh_results(&mut board, 4));
}

fn assert_all_measure(lines: &[String]) {
    assert_readings(lines);
    let centre = Scene::white_paper().optics.centre(DISTANCE);
    for line in lines {
        let error = number(line, "x ", " ") - centre;
        assert!(error.abs() < 0.05, "{error} px off: {lines:#?}");
        let error = number(line, "d ", " mm") - DISTANCE * 1e3;
        assert!(error.abs() < 0.05, "{error} mm off: {lines:#?}");
    }
}

/// Whatever an open line brings, the sensor is silent until the converter is back.
#[test]
fn a_disconnected_converter_is_a_silent_sensor_until_it_is_back() {
    let mut board = measuring(4);
    for line in OpenLine::ALL {
        assert_all_measure(&fresh_results(&mut board, 2));
        board.open_line(Some(line));
        let lines = fresh_results(&mut board, 12);
        println!("{line:?}: {}", lines[0]);
        assert_all_are(&lines, "sensor silent");
        assert_distance_gives_advice(&mut board, "sensor silent");
        board.open_line(None);
        fresh_results(&mut board, 4);
    }
    assert_all_measure(&fresh_results(&mut board, 2));
}

/// No row arrives for 100 ms, because no read-out ends.
#[test]
fn read_outs_that_never_end_are_a_silent_sensor() {
    let mut board = measuring(4);
    assert_all_measure(&fresh_results(&mut board, 2));
    board.expect_violations();
    let before = Status::ask(&mut board).count("rows read");
    board.take_lines();
    // A read-out takes 5.6 ms, so each is stopped early.
    for _ in 0..350 {
        stop_the_transfer(&mut board);
        run_ms(&mut board, 1);
    }
    let lines: Vec<String> = take_texts(&mut board);
    println!("{lines:#?}");
    let status = Status::ask(&mut board);
    // The rows that were under way at first, and those that came later.
    let read = status.count("rows read") - before;
    assert!(read < 20, "{read} rows: {status:#?}");
    assert!(status.count("rows failed") >= 5, "{status:#?}");
    let silent = lines.iter().filter(|line| *line == "f sensor silent");
    assert_eq!(silent.count(), 3, "one every 100 ms: {lines:#?}");
    assert_all_measure(&fresh_results(&mut board, 4));
}

#[test]
fn an_impossible_word_spoils_only_its_own_row() {
    let mut board = measuring(1);
    assert_all_measure(&fresh_results(&mut board, 2));
    // A bit above the converter's twelve.
    with_processor(&mut board, |it| {
        let converter = it.converter_bus().place_mut(0);
        converter.expect("a converter").flip(1 << 15);
    });
    let lines = results(&mut board, 10);
    let (readings, faults): (Vec<_>, Vec<_>) = lines.iter().partition(|line| is_reading(line));
    assert_eq!(faults, ["f sensor silent"], "{lines:#?}");
    assert_eq!(readings.len(), 9);
}

#[test]
fn a_read_out_that_stops_half_way_is_dropped_and_measuring_continues() {
    let mut board = measuring(4);
    assert_all_measure(&fresh_results(&mut board, 2));
    // The row has too few words. The sensor head counts this as a violation, although the firmware did
    // nothing wrong.
    board.expect_violations();
    run_into_a_row(&mut board);
    let moment = board.now();
    stop_the_transfer(&mut board);
    assert_all_measure(&fresh_results(&mut board, 4));

    let status = Status::ask(&mut board);
    assert_eq!(status.count("rows failed"), 1, "{status:#?}");
    let violations = board.head(|head| head.violations.first.clone());
    println!("stopped at {:.3} ms: {violations:#?}", moment as f64 * 1e-6);
    assert_eq!(violations.len(), 1, "and no other: {violations:#?}");
}
