//! What a row of a scene costs to simulate on one core, and how much of it each effect.

use std::hint::black_box;
use std::time::{Duration, Instant};

use host_tests::budget;
use host_tests::scene::{Scene, Simulation, quantise};
use serde::Serialize;

/// What a scene costs.
#[derive(Serialize)]
pub struct Timing {
    /// Nanoseconds a row, the median.
    pub nanoseconds_a_row: f64,
    /// Nanoseconds that the first row takes longer: what stays for as long as the target does is computed once.
    pub nanoseconds_once: f64,
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
    /// Nanoseconds of [`Timing::nanoseconds_once`]; none as above.
    pub nanoseconds_once: Option<f64>,
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
        let whole = Rows::of(scene);
        let without: Vec<(&'static str, Option<Rows>)> = budget::effects(scene)
            .map(|effect| {
                let rest = budget::without(scene, effect);
                (effect.name(), rest.as_ref().map(Rows::of))
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
            nanoseconds_once: (whole.first - nanoseconds_a_row).max(0.0),
            pixels_a_second: scene.geometry().words as f64 / nanoseconds_a_row * 1e9,
            effects: (without.into_iter().zip(differences))
                .map(|((effect, rest), differences)| {
                    EffectTiming::of(effect, whole.first, rest, differences)
                })
                .collect(),
        }
    }
}

impl EffectTiming {
    /// `first` is [`Rows::first`] with the effect, `differences` are the nanoseconds a row with it less without it.
    fn of(
        effect: &'static str,
        first: f64,
        without: Option<Rows>,
        mut differences: Vec<f64>,
    ) -> Self {
        let middle = median(&mut differences);
        let mut off: Vec<f64> = (differences.iter())
            .map(|difference| (difference - middle).abs())
            .collect();
        // Of normal values the standard deviation is 1.483 medians, and that of a median of n of them 1.253/sqrt(n) of it.
        let deviation = 1.483 * median(&mut off);
        Self {
            effect,
            nanoseconds_a_row: without.as_ref().map(|_| middle),
            uncertainty: 1.253 * deviation / (off.len().max(1) as f64).sqrt(),
            nanoseconds_once: without.map(|without| first - without.first - middle),
        }
    }
}

/// A scene, and how many of its first rows make a repetition.
struct Rows {
    simulation: Simulation,
    /// Nanoseconds for the first row with all that is prepared for it: the median of three.
    first: f64,
    count: u64,
}

impl Rows {
    fn of(scene: &Scene) -> Self {
        let a_frame = scene.sensor.rows();
        let mut first = [(); 3].map(|()| {
            let start = Instant::now();
            let rows = Simulation::new(scene.clone());
            make(&rows, 0);
            start.elapsed().as_nanos() as f64
        });
        // Two frames at least: what is kept for a target at rest must not serve for one that moves.
        let mut rows = Self {
            simulation: Simulation::new(scene.clone()),
            first: median(&mut first),
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
}

/// A row as the core gets it, in whole counts.
fn make(simulation: &Simulation, row: u64) {
    let scene = simulation.scene();
    let counts = simulation.row(row, scene.distance, scene.exposure);
    black_box(quantise(&counts, scene.sensor.geometry().full_scale()));
}

/// Zero of nothing.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
