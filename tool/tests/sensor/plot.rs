//! A recording becomes a figure.

use slitrange_tool::plot::Series;
use slitrange_tool::sensor::stream::{FrameResult, Kind};

use crate::command::{ends, says};

use super::stand_in::{NOISE_PX, StandIn};

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
fn another_file_is_an_error() {
    let sensor = StandIn::new(2);
    sensor.write("points.csv", "distance_mm,x\n1,2\n");
    let error = sensor.refused("plot @points.csv");
    says(&error, ["is no recording of `slitrange monitor --csv`"]);
}
