//! Shows the firmware every scene that the board's sensor can see. It must give readings, or the fault that
//! the scene is made for.

use simulator::scene::{Sensor, file};

use super::common::*;

/// The largest allowed error of a reading in pixels: four standard deviations of the strongest speckle.
const GROSS: f64 = 3.5;

/// The fault that a scene gives; `None` if it gives readings. Some scene files name a fault. Another fault
/// comes from the calibration, which is nominal: valid from 0.55 to 1.10 m.
fn expected_fault(name: &str, scene: &Scene) -> Option<String> {
    let path = file::folder().join(format!("{name}.toml"));
    let text = std::fs::read_to_string(path).expect("a scene's file");
    let is_beyond = !(0.55..1.10).contains(&scene.distance);
    (text.lines())
        .find_map(|line| line.strip_prefix("# Expected fault: "))
        .map(|fault| fault.trim_end_matches('.'))
        .or(is_beyond.then_some("out of range"))
        .map(str::to_owned)
}

/// A result of a row that was exposed after this call. Earlier rows are being read or computed, or their
/// results wait for the serial line.
fn result(board: &mut VirtualBoard) -> Line {
    results(board, 5);
    await_line(board, is_result)
}

/// With `slits one`, the scene of a comb gives the fault that its file names. With `slits comb`, it must give
/// readings.
fn assert_comb_gives_readings(board: &mut VirtualBoard, name: &str, scene: &Scene) {
    set(board, "slits comb");
    let line = result(board);
    println!("{name}, slits comb: {}", line.text);
    assert!(is_reading(&line.text), "{name}: {}", line.text);
    let error = number(&line.text, "d ", " mm") - 1e3 * scene.distance;
    assert!(error.abs() < 0.5, "{name}: {error} mm off: {}", line.text);
    set(board, "slits one");
}

#[test]
fn every_scene_gives_readings_or_its_own_fault() {
    let mut board = measuring(1);
    set(&mut board, "exposure 5600");
    let (mut readings, mut faults, mut combs) = (0, 0, 0);
    for name in file::names().expect("the folder of scenes") {
        let scene = Scene::load(&name).expect("a scene");
        if scene.sensor != Sensor::Tcd1304dg {
            continue;
        }
        let expected = expected_fault(&name, &scene);
        let metres_per_pixel = (scene.optics).metres_per_pixel(scene.optics.centre(scene.distance));
        let target = Target::at(scene.distance);
        board.set_light(of_scene(scene.clone(), target.clone()));
        let line = result(&mut board);
        println!("{name}: {}", line.text);
        match expected {
            None => {
                assert!(is_reading(&line.text), "{name}: {}", line.text);
                let truth = match &scene.motion {
                    // A few older results may still come.
                    Some(_) => {
                        let last = board.head(|head| head.last_row().map(|row| row.exposure));
                        (target.mean_distance(&last.expect("a row"), 1)).expect("remembered")
                    }
                    None => scene.distance,
                };
                let row = scene.motion.map_or(0.0, |it| it.speed) * scene.sensor.period();
                let error = number(&line.text, "d ", " mm") * 1e-3 - truth;
                let most = GROSS * metres_per_pixel + 3.0 * row;
                assert!(error.abs() < most, "{name}: {error} m off: {}", line.text);
                readings += 1;
            }
            Some(fault) => {
                let start = format!("f {fault}");
                assert!(line.text.starts_with(&start), "{name}: {}", line.text);
                faults += 1;
                if scene.comb.is_some() {
                    assert_comb_gives_readings(&mut board, &name, &scene);
                    combs += 1;
                }
            }
        }
    }
    // An empty folder must fail the test.
    println!("{readings} scenes gave readings, {faults} faults, {combs} combs");
    assert!(readings >= 8 && faults >= 3 && combs >= 1);
}
