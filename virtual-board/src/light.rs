//! What falls on the sensor head: a scene's rows for the exposures that the firmware gives, or given rows.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use host_tests::scene::{Scene, Simulation};

use crate::{Exposure, LightSource, Nanos, PIXELS};

/// The target, which whoever holds a clone can move, and where it was in the last rows.
#[derive(Clone, Debug)]
pub struct Target(Arc<Mutex<Places>>);

#[derive(Debug)]
struct Places {
    /// Where it was put.
    distance: f64,
    /// The end of each exposure, and where the target was in its middle.
    shown: VecDeque<(Nanos, f64)>,
}

/// Rows of which it is known where the target was: two of the longest frames.
const SHOWN: usize = 128;

impl Target {
    /// A target at a distance in metres.
    pub fn at(distance: f64) -> Self {
        Self(Arc::new(Mutex::new(Places {
            distance,
            shown: VecDeque::new(),
        })))
    }

    /// Moves it.
    pub fn move_to(&self, distance: f64) {
        self.places().distance = distance;
    }

    /// Where it was put, in metres. A scene may move it from there: [`host_tests::scene::Motion`].
    pub fn distance(&self) -> f64 {
        self.places().distance
    }

    /// Where it truly was, in metres: the mean over so many rows (1 to 64) of a scene, of which `last` is the last one's
    /// exposure. `None` where the scene has not shown as many.
    pub fn mean_distance(&self, last: &Exposure, rows: usize) -> Option<f64> {
        let places = self.places();
        let end = 1 + places.shown.iter().rposition(|(at, _)| *at == last.end)?;
        let frame = places.shown.range(end.checked_sub(rows)?..end);
        Some(frame.map(|(_, distance)| distance).sum::<f64>() / rows as f64)
    }

    fn show(&self, exposure: &Exposure, distance: f64) {
        let shown = &mut self.places().shown;
        if shown.len() == SHOWN {
            shown.pop_front();
        }
        shown.push_back((exposure.end, distance));
    }

    fn places(&self) -> MutexGuard<'_, Places> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A scene's rows, counted from the first one that this light source is asked for. Where the scene has no motion, the target stands still
/// during an exposure: it is where it was found at the end.
pub fn of_scene(scene: Scene, target: Target) -> LightSource {
    let simulation = Simulation::new(scene);
    let mut row = 0;
    Box::new(move |exposure: &Exposure| {
        row += 1;
        let distance = target.distance();
        target.show(exposure, simulation.true_distance(row, distance));
        simulation.row(row, distance, exposure.duration() as f64 * 1e-9)
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

#[cfg(test)]
mod tests {
    use super::*;
    use host_tests::scene::{Motion, Sensor};

    /// 0.1 m/s at 175.4 rows a second: row n shows the target n / 1754 m farther away, and rows 17 to 20 on average 18.5 / 1754.
    #[test]
    fn a_frame_sees_the_target_where_it_was_on_average() {
        let scene = Scene {
            motion: Some(Motion { speed: 0.1 }),
            ..Scene::dark(Sensor::Tcd1304dg)
        };
        let target = Target::at(0.7);
        let mut light = of_scene(scene, target.clone());
        let exposure = |row: Nanos| Exposure {
            start: row * 5_700_000,
            end: (row + 1) * 5_700_000,
        };
        for row in 1..=20 {
            light(&exposure(row));
        }
        let mean = target.mean_distance(&exposure(20), 4).expect("four rows");
        println!("{mean}");
        assert!((mean - (0.7 + 18.5 / 1754.0)).abs() < 1e-12);
        assert_eq!(target.distance(), 0.7);
        assert_eq!(target.mean_distance(&exposure(20), 21), None);
        assert_eq!(target.mean_distance(&exposure(21), 1), None);
    }
}
