//! The scenes in the folder, as far as the paper's experiment and the error budget go by them.

use simulator::scene::{LaserSpot, Scene, Sensor};
use simulator::with;

use crate::budget::Plan;
use crate::paper::apparatus::{LASER, WANDER};
use crate::paper::materials::SCENES;

/// The scenes of the paper's materials have the same laser as the simulated experiment of the paper.
#[test]
fn the_laser_is_that_of_the_experiment() {
    for (_, name) in SCENES {
        let scene = Scene::load(name).expect("a scene");
        let speckle = scene.speckle.expect("speckle");
        assert_eq!(speckle.linewidth, LASER.linewidth, "{name}");
        let spot = LaserSpot {
            waist: LASER.waist_diameter,
            waist_distance: LASER.waist_distance,
            // A line sensor's scenes are of a target that slides nowhere.
            wander: match scene.sensor {
                Sensor::Camera => WANDER,
                _ => 0.0,
            },
        };
        assert_eq!(scene.laser_spot, Some(spot), "{name}");
        assert_eq!(scene.optics.wavelength, LASER.wavelength, "{name}");
    }
}

/// If a plan moves the target beyond the end of its surface, the plan is refused before it runs.
#[test]
fn plans_beyond_the_surface_are_refused() {
    let scene = Scene::load("speckle-receding").expect("a scene");
    // 0.01 m/s from 0.8 m: to 1.2 m in 40 s.
    let plan = |seconds| with(Plan::of(&scene), |it| it.seconds = seconds);
    assert!(plan(39.0).check(&scene).is_ok());
    let error = format!("{:#}", plan(41.0).check(&scene).expect_err("too far"));
    println!("{error}");
    assert!(error.contains("for 41 s: take fewer seconds") && error.contains("1.200 m"));
}
