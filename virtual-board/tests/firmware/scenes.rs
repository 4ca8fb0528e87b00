//! The scenes that come with the project, one after the other before a board that is on: each is measured, or is the fault that
//! its file announces.

use host_tests::scene::{Scene, Sensor, file};
use virtual_board::light::{Target, of_scene, true_distance};
use virtual_board::{Exposure, LightSource};

use crate::common::{PATIENCE, Status, boot, is_reading, is_result, number, paper, set};

/// Rows in a frame.
const ROWS: usize = 2;

/// Distances in metres for which the firmware has a calibration.
const CALIBRATED: std::ops::Range<f64> = 0.55..1.10;

/// Millimetres: four times what speckle's RMS error is at 0.8 m (docs/accuracy.md), and a thousand times that of noise.
const FARTHEST_OFF: f64 = 2.0;

/// A scene at its own exposure, however long the firmware's is.
fn at_its_exposure(scene: Scene, target: Target) -> LightSource {
    let nanoseconds = (scene.exposure * 1e9) as u64;
    let mut light = of_scene(scene, target);
    Box::new(move |exposure: &Exposure| {
        light(&Exposure {
            start: exposure.end.saturating_sub(nanoseconds),
            end: exposure.end,
        })
    })
}

/// What the board must say instead of a distance.
fn fault(name: &str, scene: &Scene) -> Option<String> {
    let text = std::fs::read_to_string(file::folder().join(format!("{name}.toml")));
    let announced = text.expect("a file").lines().find_map(|line| {
        let fault = line.strip_prefix("# Expected fault: ")?;
        Some(fault.trim_end_matches('.').to_owned())
    });
    match announced {
        None if !CALIBRATED.contains(&scene.distance) => Some("out of range".to_owned()),
        announced => announced,
    }
}

#[test]
fn each_scene_is_measured_or_is_the_fault_that_it_announces() {
    let (mut board, _) = boot(paper());
    set(&mut board, &format!("rows {ROWS}"));
    let (mut measured, mut faults) = (0, 0);
    for name in file::names().expect("the folder of scenes") {
        let scene = Scene::load(&name).expect("a scene");
        if scene.sensor != Sensor::Tcd1304dg {
            println!("{name}: for another sensor");
            continue;
        }
        let target = Target::at(scene.distance);
        board.set_light(at_its_exposure(scene.clone(), target.clone()));
        // Of the frames under way when the scene is shown, two may have rows of the one before.
        for result in 0..4 {
            let line = board.run_until_line(is_result, PATIENCE).expect("a result");
            if result < 2 {
                continue;
            }
            if result == 2 {
                println!("{name}: {}", line.text);
            }
            if let Some(fault) = fault(&name, &scene) {
                let announced = line.text.starts_with(&format!("f {fault}"));
                assert!(announced, "{name}: {fault} and not {line}");
                faults += 1;
                continue;
            }
            assert!(is_reading(&line.text), "{name}: {line}");
            let truth = true_distance(&mut board, &target, &line, ROWS).expect("rows of the scene");
            let off = number(&line.text, "d ", " mm") - truth * 1e3;
            assert!(off.abs() < FARTHEST_OFF, "{name}: {off} mm off, {line}");
            measured += 1;
        }
    }
    println!(
        "{measured} readings, {faults} faults, {:.3} s",
        board.now() as f64 * 1e-9
    );
    assert!(measured >= 20 && faults >= 4);
    Status::ask(&mut board).assert_none(&["rows lost", "rows failed", "lines dropped"]);
    board.finish().expect("a clean run");
}
