//! From a scene to its rows: the order in which the effects are computed.
//!
//! Each effect that is listed is one pass over the row, or over the few pixels that it touches; one that is
//! not listed is one test a row.

use crate::least_squares;
use crate::scene::laser_light::LaserLight;
use crate::scene::{Effect, Exposure, Scene, random};

/// A scene, and what its listed effects draw and compute once for all of its rows.
#[derive(Clone, Debug)]
pub struct Simulation {
    scene: Scene,
    laser_light: LaserLight,
    /// [`crate::scene::Response`]: a factor for each light pixel of each line.
    response: Option<Vec<Vec<f32>>>,
    /// [`crate::scene::FixedPattern`]: an offset for each output of each line.
    fixed_pattern: Option<Vec<Vec<f32>>>,
    /// [`crate::scene::HotPixels`]: numbers of light pixels of each line.
    hot_pixels: Option<Vec<Vec<usize>>>,
    /// [`crate::scene::MainsLight`]: its phase in radians.
    mains_phase: Option<f64>,
}

impl Simulation {
    /// Prepares a scene.
    pub fn new(scene: Scene) -> Self {
        Self::on_surface(scene, 0)
    }

    /// Prepares a scene with the surface of a number ([`Simulation::set_surface`]). It takes half the time of
    /// preparing the scene and then replacing its surface.
    pub fn on_surface(scene: Scene, number: u64) -> Self {
        let (seed, geometry) = (scene.seed, scene.sensor.geometry());
        let (pixels, words) = (geometry.light.len(), geometry.words);
        let lines = || 0..scene.sensor.rows();
        Self {
            laser_light: laser_light(&scene, number),
            response: (scene.response)
                .map(|it| lines().map(|line| it.factors(seed, line, pixels)).collect()),
            fixed_pattern: (scene.fixed_pattern)
                .map(|it| lines().map(|line| it.offsets(seed, line, words)).collect()),
            hot_pixels: (scene.hot_pixels)
                .map(|it| lines().map(|line| it.places(seed, line, pixels)).collect()),
            mains_phase: scene.mains_light.map(|it| it.phase(seed)),
            scene,
        }
    }

    /// Replaces the target's surface: its speckle and its texture are new, the sensor stays. Each number is
    /// another surface, and 0 is the scene's own.
    pub fn set_surface(&mut self, number: u64) {
        self.laser_light = laser_light(&self.scene, number);
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// As [`Scene::row`].
    pub fn row(&self, row: u64, distance: f64, exposure: impl Into<Exposure>) -> Vec<f32> {
        let (scene, exposure) = (&self.scene, exposure.into());
        let geometry = scene.sensor.geometry();
        let time = self.time(row);
        // The line of pixels that the row is read from.
        let line = (row % scene.sensor.rows()) as usize;
        let mut counts = vec![0.0; geometry.words];
        let light = &mut counts[geometry.light.clone()];
        self.add_light(light, row, time, distance, exposure);
        if let Some(lag) = &scene.lag {
            let mut before = vec![0.0; light.len()];
            let pulsed = Exposure {
                laser: exposure.laser_before,
                ..exposure
            };
            self.add_light(&mut before, row, time - scene.period(), distance, pulsed);
            let full_well = scene.saturation.map_or(f64::INFINITY, |it| it.full_well);
            lag.apply(light, &before, full_well);
        }
        let stream = |effect| random::of_row(scene.seed, effect, row);
        if let Some(noise) = &scene.shot_noise {
            noise.apply(light, &mut stream(Effect::ShotNoise));
        }
        if let Some(saturation) = &scene.saturation {
            saturation.apply(light);
        }
        if let Some(front_end) = &scene.front_end {
            front_end.amplify(light);
        }
        if let Some(black_level) = &scene.black_level {
            let level = black_level.after(time) as f32;
            counts.iter_mut().for_each(|count| *count += level);
        }
        if let Some(offsets) = &self.fixed_pattern {
            for (count, offset) in counts.iter_mut().zip(&offsets[line]) {
                *count += offset;
            }
        }
        if let Some(settling) = &scene.settling {
            settling.apply(&mut counts);
        }
        if let Some(front_end) = &scene.front_end {
            front_end.shift_and_clip(&mut counts);
        }
        if let Some(noise) = &scene.read_noise {
            noise.apply(&mut counts, &mut stream(Effect::ReadNoise));
        }
        if let Some(quantisation) = &scene.quantisation {
            quantisation.apply(&mut counts, geometry.full_scale());
        }
        counts
    }

    /// Adds light and dark current to an empty row, without noise. `time` is the middle of its exposure.
    fn add_light(&self, light: &mut [f32], row: u64, time: f64, distance: f64, exposure: Exposure) {
        let scene = &self.scene;
        let line = (row % scene.sensor.rows()) as usize;
        (self.laser_light).add(light, row, time, distance, exposure.laser);
        if let Some(reflectivity) = &scene.reflectivity {
            reflectivity.apply(light, time);
        }
        if let Some(ambient) = &scene.ambient {
            ambient.add(light, exposure.row);
        }
        if let (Some(lamps), Some(phase)) = (&scene.mains_light, self.mains_phase) {
            lamps.add(light, phase, time, exposure.row);
        }
        if let Some(factors) = &self.response {
            for (light, factor) in light.iter_mut().zip(&factors[line]) {
                *light *= factor;
            }
        }
        if let (Some(hot), Some(places)) = (&scene.hot_pixels, &self.hot_pixels) {
            hot.add(light, &places[line], exposure.row);
        }
    }

    /// The target's distance in metres in the middle of a row's exposure, where it is at `distance` in that
    /// of the first row: what an estimate is to be compared with.
    pub fn true_distance(&self, row: u64, distance: f64) -> f64 {
        (self.scene.motion).map_or(distance, |it| it.distance(distance, self.time(row)))
    }

    /// The factor of [`crate::scene::Reflectivity`] for a row; 1 for a scene that does not list it.
    pub fn reflectivity(&self, row: u64) -> f64 {
        (self.scene.reflectivity).map_or(1.0, |it| it.factor(self.time(row)))
    }

    /// The centre in pixels that a perfect sensor has for that distance, by eq. (1) as it was calibrated:
    /// what moves the spot besides the target - temperature, distortion, obliquity, aberrations, texture,
    /// speckle - is an error. With a comb this is the centre of a slit on the axis, which the mask need not
    /// have: [`Simulation::true_centres`] has that of each slit.
    pub fn true_centre(&self, row: u64, distance: f64) -> f64 {
        self.scene.optics.centre(self.true_distance(row, distance))
    }

    /// The centre in pixels of each opening's image for that distance: of each slit of a comb in the order of
    /// its list, or the one of [`Simulation::true_centre`].
    pub fn true_centres(&self, row: u64, distance: f64) -> Vec<f64> {
        let distance = self.true_distance(row, distance);
        let openings = self.scene.openings();
        openings.iter().map(|it| it.centre(distance)).collect()
    }

    /// Sigma in pixels of the gaussian that fits the spot best, of a target at rest at a distance in metres:
    /// what an estimator can expect. Speckle and texture are left out. NaN where no gaussian fits, as for a
    /// spot beyond the row's ends. With a comb it is that behind the one slit of [`Scene::optics`].
    pub fn spot_width(&self, distance: f64) -> f64 {
        let sensor = self.scene.sensor;
        let spot = Scene {
            optics: self.scene.optics,
            spot: self.scene.spot,
            diffraction: self.scene.diffraction,
            laser_spot: self.scene.laser_spot,
            obliquity: self.scene.obliquity,
            defocus: self.scene.defocus,
            coma: self.scene.coma,
            ..Scene::dark(sensor)
        };
        let row = spot.row(sensor.rows() / 2, distance, 1.0);
        let light = row[sensor.geometry().light].iter();
        let light: Vec<f64> = light.map(|&light| f64::from(light)).collect();
        least_squares::fit_near(&light, spot.optics.centre(distance))
            .map_or(f64::NAN, |gaussian| gaussian.width)
    }

    /// Seconds from the middle of the first row's exposure. Rows of one frame are exposed at once.
    fn time(&self, row: u64) -> f64 {
        (row / self.scene.sensor.rows()) as f64 * self.scene.period()
    }
}

/// The laser's light on the surface of a number, of which 0 is the scene's own.
fn laser_light(scene: &Scene, number: u64) -> LaserLight {
    LaserLight::new(&Scene {
        seed: scene.seed.wrapping_add(number),
        ..scene.clone()
    })
}
