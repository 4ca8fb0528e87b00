//! What the sensor is shown: a scene, and where its target is put.

use anyhow::{Result, ensure};
use host_tests::scene::{Effect, Scene, Sensor};

use crate::Options;

/// The range of the paper's position table, in metres.
pub const NEAREST: f64 = 0.60;
pub const FARTHEST: f64 = 1.02;

/// Distances on the table, unless said otherwise.
const STEPS: u32 = 43;

/// What the sensor is shown.
#[derive(Debug)]
pub struct Shown {
    /// The scene.
    pub scene: Scene,
    /// Where it is from: none for the white paper that is shown without a scene.
    pub name: Option<String>,
    /// Distances of the target in metres, one after the other.
    pub distances: Vec<f64>,
    /// Results at each that count.
    pub results: usize,
    /// Whether all results are printed, or the first one at each distance.
    pub prints_all: bool,
}

impl Shown {
    /// What the options ask for.
    ///
    /// # Errors
    /// There is no such scene, or the board's sensor cannot be shown it, or its target moves and is to be put elsewhere.
    pub fn new(options: &Options) -> Result<Self> {
        let scene = match &options.scene {
            Some(name) => Scene::load(name)?,
            None => Scene::white_paper(),
        };
        ensure!(
            scene.sensor == Sensor::Tcd1304dg,
            "this scene is made for the sensor {:?}, and the board has a TCD1304DG: `cargo scene` shows it",
            scene.sensor
        );
        ensure!(
            options.steps.is_none() || scene.motion.is_none(),
            "this scene's target moves by itself: leave --steps out"
        );
        let shown = match (&options.scene, options.steps) {
            (Some(name), None) => Self {
                distances: vec![options.distance.unwrap_or(scene.distance)],
                results: 16,
                prints_all: true,
                name: Some(name.clone()),
                scene,
            },
            (name, steps) => Self {
                distances: table(options.distance, steps.unwrap_or(STEPS)),
                results: 4,
                prints_all: false,
                name: name.clone(),
                scene,
            },
        };
        Ok(shown)
    }

    /// The scene in words: none for the white paper that is shown without a scene.
    pub fn in_words(&self) -> Option<String> {
        let name = self.name.as_ref()?;
        let effects: Vec<&str> = (Effect::ALL.into_iter())
            .filter(|&effect| self.scene.lists(effect))
            .map(Effect::name)
            .collect();
        let motion = self.scene.motion.map_or(String::new(), |motion| {
            format!(
                ", moving by {} mm/s from the start of the board",
                motion.speed * 1e3
            )
        });
        Some(format!(
            "{name}: {}\ntarget at {:.1} mm{motion}; effects: {}",
            self.scene.about,
            self.distances[0] * 1e3,
            effects.join(", ")
        ))
    }
}

/// Even steps over the position table, or all at one place.
fn table(distance: Option<f64>, steps: u32) -> Vec<f64> {
    let share = |step| f64::from(step) / f64::from(steps.max(2) - 1);
    (0..steps)
        .map(|step| distance.unwrap_or(NEAREST + share(step) * (FARTHEST - NEAREST)))
        .collect()
}
