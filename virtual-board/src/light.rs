//! What falls on the sensor head: a scene's rows for the exposures that the firmware gives, or given rows.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use host_tests::scene::{Scene, Simulation};

use crate::{Exposure, LightSource, Line, Nanos, PIXELS, VirtualBoard};

/// The target, which whoever holds a clone can move, and ask where it was.
#[derive(Clone, Debug)]
pub struct Target(Arc<Mutex<Place>>);

#[derive(Debug)]
struct Place {
    /// In metres; of a scene whose target moves by itself, at the first row.
    distance: f64,
    /// Ends of the last exposures, and where it was in the middle of them.
    seen: VecDeque<(Nanos, f64)>,
}

/// Exposures that are remembered: those of four of the longest frames.
const REMEMBERED: usize = 256;

impl Target {
    /// A target at a distance in metres.
    pub fn at(distance: f64) -> Self {
        Self(Arc::new(Mutex::new(Place {
            distance,
            seen: VecDeque::new(),
        })))
    }

    fn place(&self) -> MutexGuard<'_, Place> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Moves it.
    pub fn move_to(&self, distance: f64) {
        self.place().distance = distance;
    }

    /// Where it was in the mean over the middles of so many exposures of which the last is given, in metres, if all of them are
    /// remembered: the last 256 are.
    pub fn mean_distance(&self, last: &Exposure, exposures: usize) -> Option<f64> {
        let place = self.place();
        let until = (place.seen.iter()).position(|(end, _)| *end == last.end)?;
        let from = (until + 1).checked_sub(exposures)?;
        let sum: f64 = (place.seen.range(from..=until))
            .map(|(_, distance)| distance)
            .sum();
        Some(sum / exposures as f64)
    }

    /// A row is exposed: gives the distance to show it for.
    fn expose(&self, exposure: &Exposure, true_distance: impl Fn(f64) -> f64) -> f64 {
        let mut place = self.place();
        let distance = place.distance;
        if place.seen.len() == REMEMBERED {
            place.seen.pop_front();
        }
        (place.seen).push_back((exposure.end, true_distance(distance)));
        distance
    }
}

/// A scene's rows. A target that the caller moves stands still during an exposure, where it was found at the end; one that the scene
/// moves ([`host_tests::scene::Motion`]) does so from row to row and during exposures, from there.
pub fn of_scene(scene: Scene, target: Target) -> LightSource {
    let simulation = Simulation::new(scene);
    let mut row = 0;
    Box::new(move |exposure: &Exposure| {
        row += 1;
        let distance = target.expose(exposure, |distance| simulation.true_distance(row, distance));
        simulation.row(row, distance, exposure.duration() as f64 * 1e-9)
    })
}

/// Where the target of a scene was, in the mean over the so many rows of the frame that a line is the result of, in metres. `None` where
/// the rows are no longer known, or not all of the scene.
pub fn true_distance(
    board: &mut VirtualBoard,
    target: &Target,
    line: &Line,
    rows: usize,
) -> Option<f64> {
    /// Of the serial line: ten bits at 115200 a second, in nanoseconds.
    const BYTE: Nanos = 86_806;
    // The line begins as soon as the frame's last row has been computed: before the next one is read.
    let begin = line.at.saturating_sub((line.text.len() as u64 + 2) * BYTE);
    let last = board.head(|head| {
        let read = head.rows().rev().find(|row| row.last_word < begin);
        read.map(|row| row.exposure)
    })?;
    target.mean_distance(&last, rows)
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
        assert_eq!(target.mean_distance(&exposure(20), 21), None);
        assert_eq!(target.mean_distance(&exposure(21), 1), None);
    }
}
