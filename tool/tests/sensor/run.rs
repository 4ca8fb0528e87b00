//! `calibrate run` takes all points and loses none, whatever goes wrong.

use std::collections::BTreeSet;

use slitrange::spot::choice::SpotChoice;
use slitrange_tool::sensor::line::RECONNECT;

use super::stand_in::{NOISE_PX, SHAPE, StandIn, State, Trouble, centre_px};
use crate::command::*;

/// `slitrange calibrate run` with further arguments, and what a person types.
fn run(sensor: &StandIn, more: &str, typed: &str) -> Ended {
    let line = format!("calibrate run --port PORT @points.csv {more}");
    sensor.type_in(&line, typed)
}

/// The same with a stage that goes to these positions.
fn run_stage(sensor: &StandIn, positions: &[f64], more: &str) -> Ended {
    list(sensor, positions);
    let more = format!("--positions @list.txt --stage-command STAGE {more}");
    run(sensor, &more, "")
}

/// Ten positions, three frames each, killed some uses of the port after `count` points. Whether it ended.
fn run_killed(sensor: &StandIn, count: usize, uses: usize) -> bool {
    once_there_are(sensor, count, move |state| {
        state.trouble.kill_after = Some(uses)
    });
    sensor.ends_before_it_is_killed(|| run_stage(sensor, &TEN, "--frames 3").0.is_ok())
}

/// Does something to the sensor as soon as the file has `count` points.
fn once_there_are(sensor: &StandIn, count: usize, then: impl FnOnce(&mut State) + 'static) {
    let (file, mut then) = (sensor.path("points.csv"), Some(then));
    sensor.each_step(move |state| {
        if let Some(then) = then.take_if(|_| lines_of(&file).len() >= count) {
            then(state);
        }
    });
}

fn points(sensor: &StandIn) -> Points {
    Points::read(&sensor.path("points.csv")).expect("points")
}

fn lines(sensor: &StandIn) -> Vec<String> {
    lines_of(&sensor.path("points.csv"))
}

fn lines_of(file: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let whole = text.rfind('\n').map_or("", |end| &text[..end]).lines();
    let points = whole.filter(|line| line.starts_with(|first: char| first.is_ascii_digit()));
    points.map(str::to_owned).collect()
}

/// Holds that a file has those points, in order, where the target was; a centre is off by at most so much.
fn check(sensor: &StandIn, distances: &[f64], off_px: f64) {
    let taken = points(sensor).points;
    assert!(taken.is_sorted_by(|a, b| a.d_mm < b.d_mm), "{taken:#?}");
    let there: Vec<f64> = taken.iter().map(|point| point.d_mm).collect();
    assert_eq!(there, distances);
    let off = |point: &Point| (point.x_px - centre_px(point.d_mm)).abs();
    let most = taken.iter().map(off).fold(0.0, f64::max);
    println!("centres are off by {most:.5} px at most, {off_px:.5} expected");
    assert!(most <= off_px, "{taken:#?}");
}

/// Five standard deviations of the mean of some frames' noise.
fn noise(frames: u16) -> f64 {
    5.0 * NOISE_PX / f64::from(frames).sqrt()
}

/// How the error of a run begins that stopped.
const STOPPED: &str = "stopped; run the same command again to go on: ";
const TEN: [f64; 10] = [
    600.0, 630.0, 660.0, 700.0, 740.0, 790.0, 840.0, 900.0, 960.0, 1020.0,
];

fn list(sensor: &StandIn, positions: &[f64]) {
    let text: Vec<String> = positions.iter().map(f64::to_string).collect();
    sensor.write("list.txt", text.join("\n"));
}

#[test]
fn a_stage_goes_through_all_positions() {
    let sensor = StandIn::new(10);
    let arguments = "--from 600 --to 1020 --points 12 --stage-command STAGE";
    done(run(&sensor, arguments, ""));
    let text = sensor.text("points.csv");
    println!("{text}");
    for line in [
        "# head TCD1304DG",
        "# serial 0",
        "# estimator adaptive",
        "# black shielded",
    ] {
        assert!(text.lines().any(|there| there == line), "{line}");
    }
    let taken = points(&sensor);
    assert_eq!(taken.setup.estimator, Some(Estimator::Adaptive));
    let mut distances: Vec<f64> = taken.points.iter().map(|point| point.d_mm).collect();
    distances.sort_by(f64::total_cmp);
    let outer = (distances.len(), distances[0], distances[11]);
    assert_eq!(outer, (12, 600.0, 1020.0));
    check(&sensor, &distances, noise(8));
    // The sigma of eight frames that scatter as they claim to, give or take: 0.71 of it is the claim's own.
    let least = NOISE_PX / 8f64.sqrt();
    for point in &taken.points {
        let shape = point.shape.expect("a shape").shape;
        let same = |px: f64, pixels: Pixels| (px - pixels.to_f64()).abs() < 1e-5;
        let mut components = shape.components_px.into_iter().zip(SHAPE.components);
        assert!(same(shape.width_px, SHAPE.width) && components.all(|(px, it)| same(px, it)));
        assert!((0.99 * least..3.0 * least).contains(&point.sigma_px.expect("a sigma")));
    }
    let set = sensor.state().settings();
    assert!(set.stream && set.rows == 16, "put back");
    // Once more: nothing is missing, nothing changes.
    let again = done(run(&sensor, arguments, ""));
    says(&again, ["0 of 12 positions to go"]);
    ends(&again, ", and no position is left\n");
    assert_eq!(sensor.text("points.csv"), text);
}

#[test]
fn a_person_is_asked_and_asked_again() {
    let sensor = StandIn::new(11);
    list(&sensor, &[600.0, 700.0, 800.0]);
    sensor.write("stage", "800");
    // The target stays at 800 mm. The first is skipped, the second said to be there, the third left.
    let arguments = "--positions @list.txt --frames 2";
    let output = done(run(&sensor, arguments, "s\n799.5\nq\n"));
    says(&output, ["move the target to 600 mm, then Enter;"]);
    assert_eq!(lines(&sensor).len(), 1);
    says(&lines(&sensor)[0], [",799.500,"]);
    // On going on, that point stands for the position that it was typed for, and for the one that it is near.
    sensor.state().trouble.fault = 1.0;
    let output = done(run(&sensor, arguments, "799.5\n\n\ns\n"));
    let is_there = "there is a point at 799.5 mm already\n";
    says(&output, ["1 of 3 positions to go", is_there]);
    ends(&output, "; 1 of 3 positions are left: 600 mm\n");
    let fault = "600 mm  too dim: 35.0 counts, needs 60.0 (a longer exposure, more laser power, a \
                 brighter target or less ambient light)";
    assert_eq!(output.matches(fault).count(), 2, "{output}");
    assert_eq!(lines(&sensor).len(), 1);
}

/// Without a stage, positions between are whole millimetres.
#[test]
fn a_person_is_asked_for_whole_millimetres() {
    let sensor = StandIn::new(33);
    let arguments = "--from 600 --to 800 --points 3 --frames 2";
    let output = done(run(&sensor, arguments, "s\nq\n"));
    says(&output, ["move the target to 688 mm, then Enter"]);
}

/// A list of the first of ten positions, and a person who moves the target to these distances: to the next of
/// them when the file has a point more.
fn by_hand(seed: u64, distances: &'static [f64], positions: usize) -> (StandIn, &'static str) {
    let sensor = StandIn::new(seed);
    let (file, stage) = (sensor.path("points.csv"), sensor.path("stage"));
    let mut at = None;
    sensor.each_step(move |_| {
        let next = lines_of(&file).len().min(distances.len() - 1);
        if at.replace(next) != Some(next) {
            std::fs::write(&stage, distances[next].to_string()).expect("written");
        }
    });
    list(&sensor, &TEN[..positions]);
    (sensor, "--positions @list.txt --frames 2")
}

/// The error names the positions that are left when the input ends, and the points are kept.
#[test]
fn the_end_of_the_input_is_an_error_while_positions_are_left() {
    let (sensor, arguments) = by_hand(30, &TEN, 4);
    let (result, output) = run(&sensor, arguments, "\n\n");
    let error = format!("{STOPPED}the input ended, with 660, 700 mm left");
    assert_eq!(result.expect_err("positions are left"), error);
    ends(&output, "; 2 of 4 positions are left: 660, 700 mm\n");
    // After the last position, the end of the input is the end.
    done(run(&sensor, arguments, "\n\n"));
    check(&sensor, &TEN[..4], noise(2));
}

#[test]
fn a_target_that_nobody_moved_gives_no_second_point() {
    let (sensor, arguments) = by_hand(31, &[600.0], 3);
    let output = done(run(&sensor, arguments, "t\n\n\n\nq\n"));
    let unmoved =
        " px, is that of the point at 600 mm: the target did not move (move it; or type t to take";
    assert_eq!(output.matches(unmoved).count(), 2, "{output}");
    says(&output, ["there is no point to take\n"]);
    assert_eq!(lines(&sensor).len(), 1);
    // A person may know better. A stage cannot be asked.
    done(run(&sensor, arguments, "\nt\nq\n"));
    assert_eq!(lines(&sensor).len(), 2);
    let mut words = sensor.words("calibrate run --port PORT @points.csv --positions @list.txt");
    words.extend(["--frames", "2", "--stage-command", "true {}"].map(str::to_owned));
    let error = refused(slitrange(&sensor, &words, ""));
    begins(&error, "there is no point at 660 mm: ");
    let remark = "\n# failed at 660.000 mm: the centre, ";
    says(&sensor.text("points.csv"), [remark]);
}

#[test]
fn a_person_takes_points_back() {
    let (sensor, arguments) = by_hand(32, &TEN, 3);
    // Two points; the second again; all three; the last again, after the last position.
    let output = done(run(&sensor, arguments, "u\n\n\nu\n\n\nu\n\n\n"));
    says(&output, ["this run has no point to take back\n"]);
    for mm in [630, 660] {
        let says = format!("the point at {mm} mm is taken back\n");
        assert_eq!(output.matches(&says).count(), 1, "{output}");
    }
    check(&sensor, &TEN[..3], noise(2));
    let text = sensor.text("points.csv");
    assert_eq!(text.matches("\n# taken back: ").count(), 2, "{text}");
}

#[test]
fn an_interrupted_run_keeps_its_points_and_puts_the_sensor_back() {
    let sensor = StandIn::new(34);
    once_there_are(&sensor, 4, |state| state.trouble.interrupted = true);
    let (result, output) = run_stage(&sensor, &TEN, "--frames 3");
    let error = result.expect_err("interrupted");
    assert_eq!(error, format!("{STOPPED}stopped by Ctrl-C"));
    says(&output, ["4 points are in "]);
    let set = sensor.state().settings();
    assert_eq!((set.rows, set.stream), (16, true));
    check(&sensor, &TEN[..4], noise(3));
    sensor.state().trouble.interrupted = false;
    done(run_stage(&sensor, &TEN, "--frames 3"));
    check(&sensor, &TEN, noise(3));
}

#[test]
fn a_stage_that_fails_stops_the_run_and_loses_nothing() {
    let sensor = StandIn::new(12);
    list(&sensor, &TEN);
    let mut words = sensor.words("calibrate run --port PORT @points.csv --positions @list.txt");
    let fails = format!("test {{}} != 660.000 && {}", sensor.stage_command());
    words.extend(["--stage-command".to_owned(), fails]);
    let error = refused(slitrange(&sensor, &words, ""));
    let command = "the stage's command `test 660.000 != 660.000 && ";
    begins(&error, &format!("{STOPPED}{command}"));
    ends(&error, "failed: exit status: 1");
    let before = lines(&sensor);
    assert_eq!(before.len(), 2);
    done(run_stage(&sensor, &TEN, ""));
    check(&sensor, &TEN, noise(8));
    assert!(before.iter().all(|line| lines(&sensor).contains(line)));
}

#[test]
fn a_position_without_a_centre_is_remarked_and_taken_later() {
    let sensor = StandIn::new(13);
    sensor.state().trouble.fault = 1.0;
    let (result, output) = run_stage(&sensor, &[600.0, 700.0], "");
    let none = "there is no point at 600, 700 mm: run the same command again";
    begins(&result.expect_err("no point"), none);
    assert_eq!(output.matches("600 mm  too dim: ").count(), 3, "{output}");
    let remark = "\n# failed at 600.000 mm: too dim: 35.0 counts, needs 60.0 (";
    says(&sensor.text("points.csv"), [remark]);
    assert!(lines(&sensor).is_empty());
    sensor.state().trouble.fault = 0.0;
    done(run_stage(&sensor, &[600.0, 700.0], ""));
    check(&sensor, &[600.0, 700.0], noise(8));
}

#[test]
fn another_sensor_another_setting_or_another_file_is_refused() {
    let sensor = StandIn::new(14);
    let run = || run_stage(&sensor, &[600.0, 700.0], "--frames 1");
    done(run());
    let text = sensor.text("points.csv");
    let refused = |text: &str| {
        sensor.write("points.csv", text);
        let error = refused(run());
        assert_eq!(sensor.text("points.csv"), text);
        error
    };
    let other = |file: &str, sensor: &str| {
        let set =
            format!("and the sensor is set to `{sensor}`: set it to that, or take another file");
        format!("taken with `{file}`, {set}")
    };
    let serial = "taken with the sensor of serial number 7, and this one's is 0: take another file";
    let head = "taken with sensor head X, and this is TCD1304DG: take another file";
    let black = "it does not say with which black its points were taken";
    let estimator = other("estimator phase-table", "estimator adaptive");
    let region = other("region 1000 2000", "region all");
    let peak = other("peak first", "peak strongest");
    let foreign = "it was not made by `calibrate run`";
    let no_point =
        ", is no point: delete that line, and its point is taken again; expected x_px,d_mm,";
    for (from, to, reason) in [
        ("# serial 0", "# serial 7", serial),
        ("# head TCD1304DG", "# head X", head),
        ("# black shielded", "", black),
        ("estimator adaptive", "estimator phase-table", &estimator),
        (" adaptive\n", " adaptive\n# region 1000 2000\n", &region),
        (" adaptive\n", " adaptive\n# peak first\n", &peak),
        ("# points of", "# Points of", foreign),
        (&*text, "x_px,d_mm\n1800,700\n", foreign),
        (",700.000,", ",seven,", no_point),
    ] {
        says(&refused(&text.replace(from, to)), [reason]);
    }
    let torn = [text.as_bytes(), b"\xff\n"].concat();
    sensor.write("points.csv", torn);
    let line = text.lines().count() + 1;
    let advice = format!("line {line} is not text: delete that line");
    says(&crate::command::refused(run()), [advice]);
    sensor.write("points.csv", &text);
    done(run());
}

/// The first record gave the sensor its serial number. Points can be added after that.
#[test]
fn points_are_added_once_the_sensor_has_a_number() {
    let sensor = StandIn::new(18);
    let more = |positions: &[f64]| done(run_stage(&sensor, positions, ""));
    more(&[600.0, 700.0]);
    let mut record = EncodedRecord::nominal().expect("a record").record().clone();
    record.serial_number = 42;
    sensor.state().start_with(EncodedRecord::new(record).ok());
    more(&[600.0, 650.0, 700.0]);
    check(&sensor, &[600.0, 650.0, 700.0], noise(8));
}

#[test]
fn a_run_waits_for_an_unplugged_cable_and_for_power() {
    const MOMENT: Duration = Duration::from_millis(500);
    let sensor = StandIn::new(15);
    // What was set, and not saved, is set again.
    sensor.state().type_line("estimator adaptive");
    let file = sensor.path("points.csv");
    let mut next = 2;
    sensor.each_step(move |state| {
        if lines_of(&file).len() >= next {
            if next != 4 {
                state.unplug(MOMENT);
            }
            if next != 2 {
                state.cut_power(MOMENT);
            }
            next = if next < 6 { next + 2 } else { usize::MAX };
        }
    });
    let output = done(run_stage(&sensor, &TEN, "--settle 0.01"));
    let back = output.matches("the sensor is back, and set as it was");
    assert_eq!(back.count(), 3, "{output}");
    check(&sensor, &TEN, noise(8));
    says(&sensor.text("points.csv"), ["\n# estimator adaptive\n"]);
    assert_eq!(sensor.state().settings().estimator, Estimator::Adaptive);
}

#[test]
fn a_sensor_that_stays_away_stops_the_run_and_loses_nothing() {
    let sensor = StandIn::new(16);
    once_there_are(&sensor, 3, |state| state.unplug(2 * RECONNECT));
    let error = refused(run_stage(&sensor, &TEN, ""));
    begins(&error, &format!("{STOPPED}there is no serial port"));
    let before = lines(&sensor);
    assert!(before.len() >= 3);
    sensor.sleep(RECONNECT);
    done(run_stage(&sensor, &TEN, ""));
    check(&sensor, &TEN, noise(8));
    assert!(before.iter().all(|line| lines(&sensor).contains(line)));
}

/// Everything that can go wrong on the line goes wrong at random.
#[test]
fn a_bad_line_loses_no_point() {
    const FRAMES: u16 = 4;
    for seed in 20..24 {
        let sensor = StandIn::new(seed);
        sensor.state().trouble = Trouble {
            late: 0.01,
            restart: 0.003,
            fault: 0.01,
            ..Trouble::of_line(0.02, 0.03)
        };
        let mut before = BTreeSet::new();
        let mut runs = 0;
        while before.len() < TEN.len() {
            let result = run_stage(&sensor, &TEN, &format!("--frames {FRAMES}")).0;
            let there: BTreeSet<String> = lines(&sensor).into_iter().collect();
            assert!(there.is_superset(&before));
            before = there;
            runs += 1;
            assert!(runs < 10, "{result:?}");
        }
        println!("seed {seed}: {runs} runs");
        // A digit that noise changed counts if that moves the centre by less than ten times its scatter,
        // which the median of four deviations may put at twice the noise: by 20 of 0.002 px, over four
        // frames.
        let off_px = noise(FRAMES) + 20.0 * NOISE_PX / f64::from(FRAMES);
        check(&sensor, &TEN, off_px);
    }
}

#[test]
fn rows_and_stream_are_put_back_after_a_run_that_was_killed() {
    let sensor = StandIn::new(19);
    assert!(!run_killed(&sensor, 1, 0));
    let set = || {
        let settings = sensor.state().settings();
        (settings.rows, settings.stream)
    };
    assert_eq!(set(), (64, false));
    done(run_stage(&sensor, &TEN, ""));
    assert_eq!(set(), (16, true));
    // What somebody set after that is not of a run that was killed.
    sensor.state().type_line("rows 32");
    done(run_stage(&sensor, &TEN, ""));
    assert_eq!(set(), (32, true));
}

/// The program is killed after each point, at any moment. No line of the file is ever lost.
#[test]
fn a_run_that_is_killed_goes_on_where_it_was() {
    let sensor = StandIn::new(17);
    let mut random = ChaCha8Rng::seed_from_u64(17);
    let mut before = BTreeSet::new();
    for count in 0..=TEN.len() {
        // A point takes about 12 uses.
        let ended = run_killed(&sensor, count, random.random_range(0..16));
        let there: BTreeSet<String> = lines(&sensor).into_iter().collect();
        println!("with {} points: ended {ended}", there.len());
        assert!(
            there.len() >= count && there.is_superset(&before),
            "{there:?}"
        );
        before = there;
    }
    done(run_stage(&sensor, &TEN, "--frames 3"));
    check(&sensor, &TEN, noise(3));
    let there: BTreeSet<String> = lines(&sensor).into_iter().collect();
    assert_eq!(there, before);
}

/// The file of a sensor that searches the spot in some pixels only names them, and a run goes on with the
/// same pixels only, also after the sensor lost its settings with its power.
#[test]
fn a_run_with_a_region_goes_on_with_this_region() {
    let sensor = StandIn::new(31);
    sensor.state().type_lines("region 1000 3000; peak last");
    let run = |wanted: &[f64]| run_stage(&sensor, wanted, "--frames 1");
    let mut steps = 0;
    sensor.each_step(move |state| {
        // The run takes frames of 64 rows.
        steps += usize::from(state.settings().rows == 64);
        if steps == 20 {
            state.cut_power(Duration::from_millis(100));
        }
    });
    let output = done(run(&[600.0, 700.0, 800.0]));
    let back = "the sensor is back, and set as it was";
    says(&output, [", region 1000 3000, peak last: ", back]);
    let read = points(&sensor);
    assert_eq!(read.points.len(), 3);
    assert_eq!(Some(read.setup.region), Region::new(1000, 3000));
    assert_eq!(read.setup.peak, SpotChoice::Last);
    let now = sensor.state().settings();
    assert_eq!((now.region, now.peak), (read.setup.region, read.setup.peak));
    sensor.state().type_line("region all");
    let other = "taken with `region 1000 3000`, and the sensor is set to `region all`";
    says(&refused(run(&[600.0, 700.0, 900.0])), [other]);
}

/// A sensor with a comb: the file has the images of all slits, and the record that `fit` makes of them sets
/// the comb again. The line is noisy, and the sensor loses its power and its settings meanwhile.
#[test]
fn a_comb_is_calibrated_from_the_images_of_its_slits() {
    let positions: Vec<f64> = (0..30).map(|i| 560.0 + 18.0 * f64::from(i)).collect();
    let bad = with(Trouble::of_line(0.01, 0.02), |it| it.restart = 0.01);
    for (seed, trouble) in [(20, Trouble::default()), (21, bad)] {
        let sensor = StandIn::new(seed);
        sensor.state().type_line("slits comb");
        sensor.state().trouble = trouble;
        let (mut result, mut output) = run_stage(&sensor, &positions, "--frames 3");
        while result.is_err() {
            println!("{output}");
            sensor.state().type_line("slits comb");
            (result, output) = run_stage(&sensor, &positions, "--frames 3");
        }
        // A run that fails early says nothing.
        says(&output, [", slits comb: "]);
        sensor.state().trouble = Trouble::default();
        check(&sensor, &positions, noise(3));
        let taken = points(&sensor);
        assert_eq!(taken.setup.slits, Slits::Comb);
        for point in &taken.points {
            let images = point.slits.expect("images");
            assert_eq!(images.iter().flatten().count(), 15);
            for (slit, image) in Comb::nominal().slits().iter().zip(images).skip(1) {
                let x0 = Pixels::from_bits((centre_px(point.d_mm) * 65536.0).round() as i32);
                let off = image.expect("an image").x_px - slit.from_axis(x0).to_f64();
                assert!(off.abs() < noise(1) + 1e-3, "{off} px");
            }
        }
        let fit = "calibrate fit @points.csv --serial 7 -o @sensor.record --date 2026-11-21";
        let report = sensor.done(&format!("{fit} --figure @fit.svg"));
        let last = "\n    16      6800      30       3  ";
        says(&report, ["\nThe comb: 16 slits, 450 images\n", last]);
        assert!(report.lines().all(|line| line.len() <= 150), "{report}");
        let of_slits = "corrections of 16 slits in the middle";
        says(&sensor.text("fit.svg"), [of_slits]);
        says(&sensor.done(&format!("{fit} --json")), ["\"residual_px\""]);
        sensor.state().type_line("slits one");
        let output = sensor.done("calibrate write --port PORT @sensor.record");
        says(&output, ["black shielded, slits comb\n"]);
        assert_eq!(sensor.state().settings().slits, Slits::Comb);
        let output = sensor.done("calibrate show --port PORT");
        let of_comb = "slits         16, from -7900 to 6800 um; corrections";
        says(&output, [of_comb, "\n   1     -7900    +0.0000"]);
        // A record without a comb sets one slit.
        let nominal = EncodedRecord::nominal().expect("a record");
        sensor.write("one.record", nominal.bytes());
        let output = sensor.done("calibrate write --no-save --port PORT @one.record");
        assert!(!output.contains("slits"), "{output}");
        assert_eq!(sensor.state().settings().slits, Slits::One);
    }
}
