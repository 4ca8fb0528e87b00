//! Readings as a live view, as lines and as a file, from a sensor that goes away and starts anew.

use slitrange_tool::sensor::stream::{FrameResult, Kind};

use super::screen::Person;
use super::stand_in::StandIn;
use crate::command::*;

fn recorded(sensor: &StandIn, name: &str) -> Vec<FrameResult> {
    let file = csv::Reader::from_path(sensor.path(name)).expect("the file");
    let lines = file.into_deserialize().collect::<Result<Vec<_>, _>>();
    lines.expect("the documented columns")
}

#[test]
fn lines_are_shown_and_the_stream_is_left_as_it_was() {
    for lines in [
        "stream on; format text",
        "stream off; format text",
        "stream on; format csv",
    ] {
        let sensor = StandIn::new(1);
        sensor.state().type_lines(lines);
        let output = sensor.done("monitor --port PORT --count 20");
        let readings = output.lines().filter(|line| line.contains(" mm   u "));
        assert_eq!(readings.count(), 20, "{output}");
        says(
            &output,
            [": 20 readings", "no faults\n0 rows lost, 0 lines dropped\n"],
        );
        let streams = lines.starts_with("stream on");
        assert_eq!(sensor.state().settings().stream, streams);
    }
}

/// A line without `distance` has no distance to show.
#[test]
fn the_distance_is_added_to_the_columns_for_the_time_of_the_command() {
    let sensor = StandIn::new(5);
    let lines = "output counter u; units um; echo on";
    sensor.state().type_lines(lines);
    let found = sensor.state().settings();
    sensor.at_steps([(500, |state| state.unplug(Duration::from_secs(2)))]);
    let output = sensor.done("monitor --port PORT --count 200");
    // In millimetres, although the lines are in micrometres.
    let deviation = "standard deviation 0.0007 mm";
    let added = "; `output` also has `distance` for now\n";
    says(&output, [added, ": 200 readings", deviation]);
    assert!(!output.contains("could not be read"), "{output}");
    // The echo, too, which was off meanwhile, although the cable was out.
    assert_eq!(sensor.state().settings(), found);
}

/// With `hold`, a sensor sends an earlier reading after a fault. With `rate`, it leaves readings out.
#[test]
fn held_readings_are_faults_and_what_rate_leaves_out_is_not_missing() {
    let sensor = StandIn::new(6);
    sensor.state().trouble.fault = 0.2;
    sensor.state().type_line("output counter distance");
    for (line, name) in [("hold 1000", "hold"), ("rate 10", "rate")] {
        sensor.state().type_line(line);
        let output = sensor.done(&format!("monitor --port PORT --csv @{name} --count 300"));
        assert!(!output.contains("did not arrive"), "{output}");
        let lines = recorded(&sensor, name);
        let count = |kind| lines.iter().filter(|line| line.kind == kind).count();
        // Before the first reading there is none to hold.
        let (held, faults) = (count(Kind::Held), count(Kind::Fault));
        let readings = format!(": {} readings", 300 - held - faults);
        says(&output, [readings, format!("faults: {held} held")]);
        // A fifth of 300, with a standard deviation of 7.
        assert!((32..=88).contains(&held), "{held}");
    }
}

#[test]
fn the_first_reading_comes_in_a_quarter_of_a_second() {
    let sensor = StandIn::new(2);
    sensor.done("monitor --port PORT --count 1");
    let took = sensor.now();
    println!("{took:?}");
    assert!(took < Duration::from_millis(250), "{took:?}");
}

#[test]
fn a_recording_goes_on_after_the_cable_was_out_and_the_power_off() {
    let sensor = StandIn::new(3);
    sensor.state().trouble.fault = 0.05;
    sensor.at_steps([
        (1000, |state| state.unplug(Duration::from_secs(2))),
        (8000, |state| state.cut_power(Duration::from_millis(300))),
        (16_000, |state| state.cut_power(Duration::from_secs(8))),
    ]);
    let command = "monitor --port PORT --csv @run.csv --seconds 40";
    let output = sensor.done(command);
    let lines = recorded(&sensor, "run.csv");
    let of = |kind| lines.iter().filter(|line| line.kind == kind).count();
    let (readings, faults, gaps) = (of(Kind::Reading), of(Kind::Fault), of(Kind::Gap));
    println!("{readings} readings, {faults} faults, {gaps} gaps");
    assert_eq!(gaps, 3);
    let parts = [
        format!(": {readings} readings"),
        format!("faults: {faults} too dim\n"),
        format!(", {} lines\n", lines.len()),
    ];
    says(&output, parts);
    // No reading has a fault, and no fault a distance.
    for line in &lines {
        assert_eq!(line.distance_mm.is_some(), line.kind == Kind::Reading);
        assert_eq!(line.fault.is_empty(), line.kind == Kind::Reading);
        assert_eq!(line.exposure_us.is_some(), line.kind == Kind::Reading);
        assert_eq!(line.number.is_some(), line.kind != Kind::Gap);
        assert_eq!(line.sensor_us.is_some(), line.kind != Kind::Gap);
        assert!(
            line.utc.starts_with("20") && line.utc.ends_with('Z'),
            "{line:?}"
        );
    }
    // One in twenty frames: of some 4000, 200 with a standard deviation of 14.
    let share = faults as f64 / (readings + faults) as f64;
    assert!((share - 0.05).abs() < 0.02, "{share}");
    // It goes on to the end.
    assert!(lines.last().is_some_and(|line| line.time_s > 39.5));
    // A recording is not overwritten.
    let again = sensor.refused(command);
    says(&again, ["run.csv cannot be made: it exists; "]);
    let nowhere = sensor.refused("monitor --port PORT --csv @nowhere/run.csv");
    says(
        &nowhere,
        [
            "run.csv cannot be made: there is no folder ",
            "; make it, or name another",
        ],
    );
    assert_eq!(recorded(&sensor, "run.csv"), lines);
}

#[test]
fn the_live_view_shows_readings_faults_and_that_the_sensor_is_away() {
    let sensor = StandIn::new(4);
    let person = Person::new(&sensor, &[(20, Key::Char(' ')), (10, Key::Quit)]);
    let (seen, output) = person.types("monitor --port PORT");
    says(&output, ["no faults"]);
    let named = seen[0].replace(&sensor.port(), "PORT");
    let border = named.lines().next().expect("a border").replace('─', "");
    let below: Vec<&str> = named.lines().skip(1).collect();
    insta::assert_snapshot!(format!("{border}\n{}", below.join("\n")));
    sensor.state().trouble.fault = 1.0;
    let (seen, _) = Person::new(&sensor, &[(20, Key::Quit)]).types("monitor --port PORT");
    says(&seen[0], ["fault: too dim: 35.0 counts, needs 60.0"]);

    // Without power, an old reading does not stay on the screen.
    sensor.state().trouble.fault = 0.0;
    sensor.at_steps([
        (1000, |state| state.cut_power(Duration::from_secs(60))),
        (20_000, |state| state.unplug(Duration::from_secs(60))),
    ]);
    let keys = [(25, Key::Char(' ')), (15, Key::Char(' ')), (30, Key::Quit)];
    let (seen, _) = Person::new(&sensor, &keys).types("monitor --port PORT");
    says(&seen[0], ["no reading for 2 s"]);
    says(&seen[1], ["no sensor answers `stream` at "]);
    says(&seen[2], ["there is no serial port "]);
    assert_eq!(seen.len(), 3);
}
