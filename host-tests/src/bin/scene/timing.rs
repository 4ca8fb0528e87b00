//! What a row of a scene costs to simulate on one core, and how much of it each effect.

use std::hint::black_box;
use std::time::{Duration, Instant};

use host_tests::budget;
use host_tests::scene::{Scene, Simulation};
use serde::Serialize;

/// What a scene costs.
#[derive(Serialize)]
pub struct Timing {
    /// Nanoseconds a row, the median.
    pub nanoseconds_a_row: f64,
    /// Nanoseconds that the first row at a place takes longer: what stays for as long as the target does is computed once.
    pub nanoseconds_a_place: f64,
    /// Pixels a second on one core.
    pub pixels_a_second: f64,
    /// By how much a row takes longer with each effect than without, in the order of the scene's effects.
    pub effects: Vec<EffectTiming>,
}

/// What an effect costs.
#[derive(Serialize)]
pub struct EffectTiming {
    /// Its name.
    pub effect: &'static str,
    /// Nanoseconds a row, the median; none where the scene's other effects need this one.
    pub nanoseconds_a_row: Option<f64>,
    /// Its standard uncertainty, from the scatter of the repetitions.
    pub uncertainty: f64,
}

/// Time for a repetition of a scene, but two rows or frames at least: so short that most of them nothing interrupts.
const REPETITION: Duration = Duration::from_micros(250);

/// Repetitions, in which the scenes take turns so that all meet the same disturbances.
const REPETITIONS: usize = 151;

/// Where that takes longer in all, there are fewer.
const PATIENCE: Duration = Duration::from_secs(10);

/// The fewest.
const FEWEST: usize = 3;

impl Timing {
    /// Times a scene, and the scene without each of its effects.
    pub fn of(scene: &Scene) -> Self {
        let whole = Rows::of(scene.clone());
        let without: Vec<(&'static str, Option<Rows>)> = budget::effects(scene)
            .map(|effect| {
                let rest = budget::without(scene, effect);
                (effect.name(), rest.map(Rows::of))
            })
            .collect();
        let mut times = vec![];
        let mut differences = vec![vec![]; without.len()];
        let start = Instant::now();
        while times.len() < FEWEST || times.len() < REPETITIONS && start.elapsed() < PATIENCE {
            let time = whole.nanoseconds_a_row();
            for ((_, rest), differences) in without.iter().zip(&mut differences) {
                if let Some(rest) = rest {
                    differences.push(time - rest.nanoseconds_a_row());
                }
            }
            times.push(time);
        }
        let nanoseconds_a_row = median(&mut times);
        Self {
            nanoseconds_a_row,
            nanoseconds_a_place: (nanoseconds_of_a_first_row(scene) - nanoseconds_a_row).max(0.0),
            pixels_a_second: scene.geometry().words as f64 / nanoseconds_a_row * 1e9,
            effects: without
                .into_iter()
                .zip(differences)
                .map(|((effect, rest), mut differences)| {
                    let middle = median(&mut differences);
                    let mut off: Vec<f64> = (differences.iter())
                        .map(|difference| (difference - middle).abs())
                        .collect();
                    // Of normal values the standard deviation is 1.483 medians, and that of a median of n of them 1.253/sqrt(n) of it.
                    let deviation = 1.483 * median(&mut off);
                    EffectTiming {
                        effect,
                        nanoseconds_a_row: rest.map(|_| middle),
                        uncertainty: 1.253 * deviation / (off.len().max(1) as f64).sqrt(),
                    }
                })
                .collect(),
        }
    }
}

/// With all that is prepared for it; the median of three.
fn nanoseconds_of_a_first_row(scene: &Scene) -> f64 {
    let mut times = [0.0; 3];
    for time in &mut times {
        let start = Instant::now();
        let simulation = Simulation::new(scene.clone());
        black_box(simulation.row(0, scene.distance, scene.exposure));
        *time = start.elapsed().as_nanos() as f64;
    }
    median(&mut times)
}

/// A scene, and how many of its first rows make a repetition.
struct Rows {
    simulation: Simulation,
    count: u64,
}

impl Rows {
    fn of(scene: Scene) -> Self {
        let a_frame = scene.sensor.rows();
        // Two frames at least: what is kept for a target at rest must not serve for one that moves.
        let mut rows = Self {
            simulation: Simulation::new(scene),
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
        let scene = self.simulation.scene();
        let start = Instant::now();
        for row in 0..self.count {
            black_box((self.simulation).row(row, scene.distance, scene.exposure));
        }
        start.elapsed().as_nanos() as f64 / self.count as f64
    }
}

/// Zero of nothing.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
