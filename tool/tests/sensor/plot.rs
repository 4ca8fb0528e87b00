//! A recording becomes a figure.

use slitrange_tool::plot::Series;
use slitrange_tool::sensor::stream::{FrameResult, Kind};

use super::stand_in::{NOISE_PX, StandIn};
use crate::command::*;

#[test]
fn a_recording_is_drawn() {
    let sensor = StandIn::new(1);
    sensor.state().trouble.fault = 0.002;
    sensor.done("monitor --port PORT --csv @run.csv --count 3000");
    let output = sensor.done("plot @run.csv");
    ends(&output, &format!("drawn: {}\n", sensor.file("run.svg")));
    let words = [
        "mm from the mean",
        "distance in mm",
        "histogram",
        "Allan deviation",
        "spectrum",
    ];
    says(&sensor.text("run.svg"), words);
    // The stand-in's noise is white: 0.002 px of some 0.39 mm each at 800 mm.
    let (_, of_one) = output.split_once("Allan deviation ").expect("a deviation");
    let (of_one, _) = of_one.split_once(' ').expect("a unit");
    let of_one: f64 = of_one.parse().expect("a number");
    println!("{of_one} mm of {NOISE_PX} px");
    assert!((of_one - 0.0008).abs() < 0.0001, "{of_one}");
}

fn line(time_s: f64, kind: Kind) -> FrameResult {
    let distance_mm = (kind == Kind::Reading).then_some(time_s);
    FrameResult {
        time_s,
        kind,
        distance_mm,
        ..FrameResult::default()
    }
}

#[test]
fn a_run_ends_at_a_fault_and_at_a_pause() {
    // 20 readings, a fault, 30 readings, a pause of a second, 25 readings.
    let lines = |fault| -> Vec<FrameResult> {
        let lines = (0..76).map(|at| {
            let pause = if at > 50 { 1.0 } else { 0.0 };
            let kind = if at == 20 { fault } else { Kind::Reading };
            line(f64::from(at) * 0.1 + pause, kind)
        });
        lines.collect()
    };
    let mut held = lines(Kind::Held);
    held[20].distance_mm = Some(1.9);
    for lines in [lines(Kind::Fault), held] {
        let series = Series::of(&lines).expect("a run");
        assert_eq!((series.readings.len(), series.faults.len()), (75, 1));
        assert_eq!((series.run.len(), series.run[0]), (30, 2.1));
        assert!((series.interval_s - 0.1).abs() < 1e-9);
    }
    // Too short.
    let error = Series::of(&lines(Kind::Fault)[60..70]).expect_err("ten readings");
    says(&error.to_string(), ["has 10 readings, and 16 are needed"]);
    assert!(Series::of(&[]).is_err());
}

#[test]
fn good_lines_are_drawn_and_others_are_counted() {
    let sensor = StandIn::new(3);
    sensor.done("monitor --port PORT --csv @run.csv --count 40");
    let whole = sensor.text("run.csv");
    let cut = &whole[..whole.len() - 30];
    let middle = whole.lines().nth(20).expect("a line");
    let torn = whole.replace(middle, &format!("\0\0\0{middle}"));
    let header = "distance,u,m,z,h,fault\r\n";
    let lines = "800.1,0.4,0,0,0,\r\n".repeat(39);
    let of_sensor = format!("stream on\r\n{header}{lines}{header},,,,,too dim\r\n");
    let headless = format!(
        "stream on\n{}",
        "800.1,0.4,0.1,9.5,99,16,16,1,5600,0,,1,0,0,0,\n".repeat(39)
    );
    let no_times =
        "the lines have no times (`output` without `time`): a second stands for a result\n";
    let left_out =
        |line| format!("lines left out, because they are no results: 1, from line {line} on\n");
    for (text, says, count) in [
        (cut, &*left_out(41), "39 readings"),
        (&torn, &left_out(21), "39 readings"),
        (&of_sensor, no_times, "39 readings, 1.0 a second, 1 faults"),
        (
            &headless,
            &format!("{}{no_times}", left_out(1)),
            "39 readings",
        ),
    ] {
        sensor.write("other.csv", text);
        let output = sensor.done("plot @other.csv");
        assert!(output.starts_with(&format!("{says}{count}")), "{output}");
    }
}

#[test]
fn another_file_is_an_error() {
    let sensor = StandIn::new(2);
    sensor.write("points.csv", "distance_mm,x\n1,2\n");
    let error = sensor.refused("plot @points.csv");
    says(&error, ["is no recording of `slitrange monitor --csv`"]);
}
