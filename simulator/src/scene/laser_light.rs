//! What comes of the laser in a row: the spot, and what goes with it.

use std::sync::{Arc, Mutex, PoisonError};

use crate::optics::{Aperture, Optics};
use crate::scene::comb::{Slit, relative_height};
use crate::scene::obliquity::Oblique;
use crate::scene::pattern::Pattern;
use crate::scene::shape::{self, Shape};
use crate::scene::speckle::RoughSurface;
use crate::scene::spot::{Spot, between};
use crate::scene::{Motion, Scene, texture};

/// What the laser's light needs that is drawn or computed once. Empty without a spot.
#[derive(Clone, Debug, Default)]
pub struct LaserLight {
    surface: Surface,
    /// What the light passes: the slits of a comb, or the one slit or lens.
    openings: Vec<Opening>,
}

/// The target's surface, which all openings see.
#[derive(Clone, Debug, Default)]
struct Surface {
    texture: Option<texture::Surface>,
    rough: Option<Arc<RoughSurface>>,
}

/// A slit or a lens, and what was last seen through it.
#[derive(Debug)]
struct Opening {
    /// The scene with this opening alone.
    scene: Scene,
    /// The scene's optics before [`Optics::behind`], with this opening's aperture.
    optics: Optics,
    /// From the optical axis along the row, in metres.
    place: f64,
    /// Width in metres of the slit that makes a spot of the scene's height: `None` for a lens.
    nominal_width: Option<f64>,
    /// The last shape and its distance: a target at rest has one shape for all rows.
    last: Mutex<Option<(f64, Arc<Shape>)>>,
}

impl Clone for Opening {
    fn clone(&self) -> Self {
        Self {
            scene: self.scene.clone(),
            last: Mutex::default(),
            ..*self
        }
    }
}

impl LaserLight {
    /// Draws what the scene's effects need.
    pub fn new(scene: &Scene) -> Self {
        if scene.spot.is_none() {
            return Self::default();
        }
        let texture = scene.texture.map(|it| it.surface(scene.seed));
        let rough = (scene.speckle.zip(scene.laser_spot))
            .map(|(speckle, spot)| Arc::new(speckle.surface(scene, &spot, texture.as_ref())));
        let openings = match &scene.comb {
            Some(comb) => {
                let slits = comb.slits.iter();
                slits.map(|slit| Opening::slit(scene, slit)).collect()
            }
            None => vec![Opening::alone(scene)],
        };
        Self {
            surface: Surface { texture, rough },
            openings,
        }
    }

    /// Adds it to a row of light. `distance` is that of [`Scene::row`], `time` that of the row. The laser is
    /// on for `exposure` seconds.
    pub fn add(&self, light: &mut [f32], row: u64, time: f64, distance: f64, exposure: f64) {
        if exposure == 0.0 {
            return;
        }
        for opening in &self.openings {
            opening.add(&self.surface, light, row, time, distance, exposure);
        }
    }
}

impl Opening {
    /// The one slit or lens of a scene without a comb.
    fn alone(scene: &Scene) -> Self {
        Self {
            scene: Scene {
                about: String::new(),
                comb: None,
                ..scene.clone()
            },
            optics: scene.optics,
            place: 0.0,
            nominal_width: match scene.optics.aperture {
                Aperture::Slit { width, .. } => Some(width),
                Aperture::Lens { .. } => None,
            },
            last: Mutex::default(),
        }
    }

    fn slit(scene: &Scene, slit: &Slit) -> Self {
        let mut opening = Self::alone(scene);
        opening.place = slit.place;
        opening.optics = slit.narrow(&scene.optics);
        opening.scene.optics = slit.optics(&scene.optics);
        // A slit twice as wide makes the gaussian of a point half as wide.
        if let (Some(spot), Some(width)) = (&mut opening.scene.spot, opening.nominal_width) {
            spot.width *= width / slit.width;
        }
        opening
    }

    fn add(
        &self,
        surface: &Surface,
        light: &mut [f32],
        row: u64,
        time: f64,
        distance: f64,
        exposure: f64,
    ) {
        let scene = &self.scene;
        let Some(spot) = &scene.spot else {
            return;
        };
        let distance = (scene.motion).map_or(distance, |it| it.distance(distance, time));
        let optics = scene.temperature.map_or(scene.optics, |it| {
            (it.optics(&self.optics, time)).behind(it.scale(time) * self.place)
        });
        let centre_at = move |distance: f64| {
            let centre = optics.centre(distance);
            let distortion = scene.distortion;
            distortion.map_or(centre, |it| it.displaced(centre, optics.axis, optics.pitch))
        };
        let mut amplitude = spot.counts_per_second * exposure;
        if let Some(width) = self.nominal_width {
            amplitude *= relative_height(scene, width, distance);
        }
        if let Some(lobe) = &scene.specular_lobe {
            amplitude *= lobe.factor(optics.viewing_angle(distance));
        }
        let row = (row % scene.sensor.rows()) as usize;
        if Shape::is_needed(scene) {
            let shape = self.shape(surface, distance);
            if let Some((pattern, factor)) = shape.row(row) {
                let width = shape.width / optics.pitch;
                let centres = centres(scene, distance, exposure, width, centre_at);
                let amplitude = amplitude * factor / centres.len() as f64;
                for centre in centres {
                    if scene.obliquity.is_some() {
                        add_oblique(light, pattern, &optics, centre, amplitude);
                    } else {
                        add(light, pattern, optics.pitch, centre, amplitude);
                    }
                }
            }
        } else {
            let factor = shape::gaussian_height(scene, spot.width, distance, row);
            let spot = Spot {
                width: shape::gaussian_width(scene, distance),
                ..*spot
            };
            let centres = centres(scene, distance, exposure, spot.width, centre_at);
            let amplitude = amplitude * factor / centres.len() as f64;
            for centre in centres {
                spot.add(light, centre, amplitude);
            }
        }
        let centre = centre_at(distance);
        if let Some(flare) = &scene.flare {
            let rows_off = shape::place_across(scene, row) / optics.pitch;
            flare.add(light, rows_off, centre, optics.axis, amplitude);
        }
        if let Some(reflection) = &scene.second_reflection {
            let factor = shape::gaussian_height(scene, reflection.width, distance, row);
            reflection.add(light, centre, amplitude * factor);
        }
    }

    /// The last shape, if the distance has not changed. Nobody waits while another thread computes one.
    fn shape(&self, surface: &Surface, distance: f64) -> Arc<Shape> {
        let last = || self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((at, shape)) = &*last()
            && at.to_bits() == distance.to_bits()
        {
            return shape.clone();
        }
        let shape = Arc::new(match &surface.rough {
            Some(rough) => Shape::coherent(&self.scene, rough, distance),
            None => Shape::incoherent(&self.scene, surface.texture.as_ref(), distance),
        });
        *last() = Some((distance, shape.clone()));
        shape
    }
}

/// The spot's centres in even parts of an exposure: one at rest. `width` is the spot's sigma in pixels.
fn centres(
    scene: &Scene,
    distance: f64,
    exposure: f64,
    width: f64,
    centre_at: impl Fn(f64) -> f64,
) -> impl ExactSizeIterator<Item = f64> {
    let motion = scene.motion.unwrap_or(Motion { speed: 0.0 });
    let half_way = 0.5 * motion.speed * exposure;
    let steps = match half_way {
        0.0 => 1,
        _ => {
            let moved = centre_at(distance - half_way) - centre_at(distance + half_way);
            Motion::steps(moved / width)
        }
    };
    motion.distances(distance, exposure, steps).map(centre_at)
}

fn add(light: &mut [f32], pattern: &Pattern, pitch: f64, centre: f64, amplitude: f64) {
    let reach = pattern.reach() / pitch + 1.0;
    for (i, light) in between(light, centre - reach, centre + reach) {
        *light += (amplitude * pattern.at((i as f64 - centre) * pitch)) as f32;
    }
}

fn add_oblique(light: &mut [f32], pattern: &Pattern, optics: &Optics, centre: f64, amplitude: f64) {
    let oblique = Oblique::new((centre - optics.axis) * optics.pitch, optics.focal_length);
    let end = |q: f64| optics.axis + oblique.place(q) / optics.pitch;
    let (from, to) = (end(-pattern.reach()), end(pattern.reach()));
    for (i, light) in between(light, from - 1.0, to + 2.0) {
        let (q, factor) = oblique.seen((i as f64 - optics.axis) * optics.pitch);
        *light += (amplitude * factor * pattern.at(q)) as f32;
    }
}
