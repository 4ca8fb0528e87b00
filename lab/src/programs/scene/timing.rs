//! What the rows of a scene cost to simulate on one core, and how much of it each effect.

use std::hint::black_box;
use std::time::{Duration, Instant};

use statistics::rms;

use crate::budget;
use crate::prelude::*;

/// What a scene costs. The first row is the one in which all is computed that stays for as long as the target
/// does.
pub struct Timing {
    /// Median nanoseconds of a row.
    pub a_row: f64,
    /// Median nanoseconds of the first row.
    pub first_row: f64,
    /// By how much a row and the first row take longer with each effect, in the order of the scene's effects:
    /// none where the scene's other effects need this one.
    pub effects: Vec<[Option<Difference>; 2]>,
}

#[derive(Clone, Copy)]
pub struct Difference {
    pub nanoseconds: f64,
    /// Its standard uncertainty, from the scatter of the repetitions and the differences of the copies.
    pub uncertainty: f64,
}

/// Time for a repetition of a scene, but two rows or frames at least: so short that most of them nothing
/// interrupts.
const REPETITION: Duration = Duration::from_micros(250);

/// Repetitions, in which the scenes take turns so that all meet the same disturbances.
const REPETITIONS: usize = 151;

/// Where that takes longer in all, there are fewer.
const PATIENCE: Duration = Duration::from_secs(5);

const FEWEST: usize = 5;

/// The scene itself is timed again so many times. What these differ from it is noise that repetitions do not
/// show: each simulation has its own place in memory.
const COPIES: usize = 3;

impl Timing {
    pub fn of(scene: &Scene) -> Self {
        let whole = Rows::of(scene);
        let without = budget::effects(scene)
            .map(|effect| budget::without(scene, effect).as_ref().map(Rows::of));
        let copies = (0..COPIES).map(|_| Some(Rows::of(scene)));
        let without: Vec<Option<Rows>> = without.chain(copies).collect();
        let (a_row, rows) = compare(&whole, &without, Rows::nanoseconds_a_row);
        let (first_row, first_rows) = compare(&whole, &without, Rows::nanoseconds_of_the_first_row);
        Self {
            a_row,
            first_row,
            effects: (rows.into_iter().zip(first_rows))
                .map(|(row, first)| [row, first])
                .collect(),
        }
    }
}

/// The median time of a scene, and by how much it is above that of each of the others, of which the last are
/// copies of the scene.
fn compare(
    whole: &Rows,
    others: &[Option<Rows>],
    time: impl Fn(&Rows) -> f64,
) -> (f64, Vec<Option<Difference>>) {
    let mut times = vec![];
    let mut differences = vec![vec![]; others.len()];
    let start = Instant::now();
    while times.len() < FEWEST || times.len() < REPETITIONS && start.elapsed() < PATIENCE {
        let whole = time(whole);
        for (other, differences) in others.iter().zip(&mut differences) {
            differences.extend(other.as_ref().map(|other| whole - time(other)));
        }
        times.push(whole);
    }
    let mut differences: Vec<_> = differences.into_iter().map(Difference::of).collect();
    let copies = differences.split_off(others.len() - COPIES);
    let noise = rms(copies.into_iter().flatten().map(|it| it.nanoseconds));
    for difference in differences.iter_mut().flatten() {
        difference.uncertainty = difference.uncertainty.hypot(noise);
    }
    (upper_median(times), differences)
}

impl Difference {
    fn of(repetitions: Vec<f64>) -> Option<Self> {
        if repetitions.is_empty() {
            return None;
        }
        let nanoseconds = upper_median(&repetitions);
        let off: Vec<f64> = (repetitions.iter())
            .map(|difference| (difference - nanoseconds).abs())
            .collect();
        // Of normal values the standard deviation is 1.483 medians, and that of a median of n of them
        // 1.253/sqrt(n) of it.
        let deviation = 1.483 * upper_median(&off);
        Some(Self {
            nanoseconds,
            uncertainty: 1.253 * deviation / (off.len() as f64).sqrt(),
        })
    }
}

/// A scene, and how many of its first rows make a repetition.
struct Rows {
    simulation: Simulation,
    count: u64,
}

impl Rows {
    fn of(scene: &Scene) -> Self {
        let a_frame = scene.sensor.rows();
        // Two frames at least: what is kept for a target at rest must not serve for one that moves.
        let mut rows = Self {
            simulation: Simulation::new(scene.clone()),
            count: 2 * a_frame,
        };
        // The first time, what is kept is computed.
        rows.nanoseconds_a_row();
        let frame = rows.nanoseconds_a_row() * a_frame as f64;
        let frames = (REPETITION.as_nanos() as f64 / frame).clamp(2.0, 1000.0) as u64;
        rows.count = frames * a_frame;
        rows
    }

    fn nanoseconds_a_row(&self) -> f64 {
        let start = Instant::now();
        for row in 0..self.count {
            make(&self.simulation, row);
        }
        start.elapsed().as_nanos() as f64 / self.count as f64
    }

    fn nanoseconds_of_the_first_row(&self) -> f64 {
        let scene = self.simulation.scene().clone();
        let start = Instant::now();
        make(&Simulation::new(scene), 0);
        start.elapsed().as_nanos() as f64
    }
}

/// A row as the core gets it, in whole counts.
fn make(simulation: &Simulation, row: u64) {
    let scene = simulation.scene();
    let counts = simulation.row(row, scene.distance, scene.exposure);
    black_box(quantise(&counts, scene.sensor.geometry().full_scale()));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_repetition_that_was_interrupted_does_not_count() {
        let difference = Difference::of(vec![4.0, 1.0, 100.0, 3.0, 2.0]).expect("five");
        // Deviations from 3: 0, 1, 1, 2, 97.
        assert_eq!(difference.nanoseconds, 3.0);
        assert!((difference.uncertainty - 1.253 * 1.483 / 5f64.sqrt()).abs() < 1e-12);
        assert!(Difference::of(vec![]).is_none());
    }
}
