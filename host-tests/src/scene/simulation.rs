//! From a scene to its rows: the order in which the effects are computed.
//!
//! Each effect that is listed is one pass over the row, or over the few pixels that it touches; one that is not listed is one test a row.

use crate::scene::{Effect, Scene, random};

/// A scene, and what it draws and computes once for all of its rows.
#[derive(Clone, Debug)]
pub struct Simulation {
    scene: Scene,
    prepared: Prepared,
}

impl Simulation {
    /// Prepares a scene.
    pub fn new(scene: Scene) -> Self {
        let prepared = Prepared::new(&scene);
        Self { scene, prepared }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// As [`Scene::row`].
    pub fn row(&self, row: u64, distance: f64, exposure: f64) -> Vec<f32> {
        self::row(&self.scene, &self.prepared, row, distance, exposure)
    }
}

/// What listed effects draw or compute once.
#[derive(Clone, Debug)]
pub(crate) struct Prepared {
    /// [`crate::scene::Response`]: a factor for each light pixel.
    response: Option<Vec<f32>>,
    /// [`crate::scene::FixedPattern`]: an offset for each output.
    fixed_pattern: Option<Vec<f32>>,
    /// [`crate::scene::HotPixels`]: numbers of light pixels.
    hot_pixels: Option<Vec<usize>>,
}

impl Prepared {
    pub(crate) fn new(scene: &Scene) -> Self {
        let (seed, geometry) = (scene.seed, scene.sensor.geometry());
        let pixels = geometry.light.len();
        Self {
            response: scene.response.map(|it| it.factors(seed, pixels)),
            fixed_pattern: (scene.fixed_pattern).map(|it| it.offsets(seed, geometry.words)),
            hot_pixels: scene.hot_pixels.map(|it| it.places(seed, pixels)),
        }
    }
}

/// As [`Scene::row`].
pub(crate) fn row(
    scene: &Scene,
    prepared: &Prepared,
    row: u64,
    distance: f64,
    exposure: f64,
) -> Vec<f32> {
    let geometry = scene.sensor.geometry();
    // Rows of one frame are exposed at once.
    let time = (row / scene.sensor.rows()) as f64 * scene.sensor.period();
    let mut counts = vec![0.0; geometry.words];

    let light = &mut counts[geometry.light.clone()];
    add_laser_light(scene, prepared, light, row, time, distance, exposure);
    if let Some(ambient) = &scene.ambient {
        ambient.add(light, exposure);
    }
    if let Some(factors) = &prepared.response {
        for (light, factor) in light.iter_mut().zip(factors) {
            *light *= factor;
        }
    }
    if let (Some(hot), Some(places)) = (&scene.hot_pixels, &prepared.hot_pixels) {
        for &place in places {
            light[place] += (hot.counts_per_second * exposure) as f32;
        }
    }
    if let Some(noise) = &scene.shot_noise {
        noise.apply(
            light,
            &mut random::of_row(scene.seed, Effect::ShotNoise, row),
        );
    }
    if let Some(saturation) = &scene.saturation {
        saturation.apply(light);
    }

    if let Some(black_level) = &scene.black_level {
        let level = black_level.after(time) as f32;
        counts.iter_mut().for_each(|count| *count += level);
    }
    if let Some(offsets) = &prepared.fixed_pattern {
        for (count, offset) in counts.iter_mut().zip(offsets) {
            *count += offset;
        }
    }
    if let Some(noise) = &scene.read_noise {
        noise.apply(
            &mut counts,
            &mut random::of_row(scene.seed, Effect::ReadNoise, row),
        );
    }
    if let Some(quantisation) = &scene.quantisation {
        quantisation.apply(&mut counts);
    }
    counts
}

/// Adds what comes of the laser: the spot, and what goes with it.
fn add_laser_light(
    scene: &Scene,
    _prepared: &Prepared,
    light: &mut [f32],
    _row: u64,
    time: f64,
    distance: f64,
    exposure: f64,
) {
    let Some(spot) = &scene.spot else {
        return;
    };
    let optics = match &scene.temperature {
        Some(temperature) => temperature.optics(&scene.optics, time),
        None => scene.optics,
    };
    let mut amplitude = spot.counts_per_second * exposure;
    if let Some(lobe) = &scene.specular_lobe {
        amplitude *= lobe.factor(optics.viewing_angle(distance));
    }
    let mut centre = optics.centre(distance);
    if let Some(distortion) = &scene.distortion {
        centre = distortion.displaced(centre, optics.axis, optics.pitch);
    }
    spot.add(light, centre, amplitude);
    if let Some(reflection) = &scene.second_reflection {
        reflection.add(light, centre, amplitude);
    }
}
