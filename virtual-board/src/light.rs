//! What falls on the sensor head: a scene's rows for the exposures that the firmware gives, or given rows.

use std::sync::{Arc, Mutex, PoisonError};

use host_tests::scene::{Scene, Simulation};

use crate::{Exposure, LightSource, PIXELS};

/// The target, which whoever holds a clone can move.
#[derive(Clone, Debug)]
pub struct Target(Arc<Mutex<f64>>);

impl Target {
    /// A target at a distance in metres.
    pub fn at(distance: f64) -> Self {
        Self(Arc::new(Mutex::new(distance)))
    }

    /// Moves it.
    pub fn move_to(&self, distance: f64) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = distance;
    }

    /// Where it is, in metres.
    pub fn distance(&self) -> f64 {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A scene's rows. The target stands still during an exposure: it is where it was found at the end.
pub fn of_scene(scene: Scene, target: Target) -> LightSource {
    let simulation = Simulation::new(scene);
    let mut row = 0;
    Box::new(move |exposure: &Exposure| {
        row += 1;
        simulation.row(row, target.distance(), exposure.duration() as f64 * 1e-9)
    })
}

/// The outputs of the sensor that see light.
pub const LIGHT: std::ops::Range<usize> = 32..3680;

/// All of the sensor's outputs for the pixels of its light range; the others are as dark as `level` counts.
pub fn outputs(light: &[f32], level: f32) -> Vec<f32> {
    let mut outputs = vec![level; PIXELS];
    for (output, &count) in outputs[LIGHT].iter_mut().zip(light) {
        *output = count;
    }
    outputs
}
