//! A rough target lit by coherent light.

use std::f64::consts::PI;
use std::ops::Range;

use rand::Rng as _;
use serde::{Deserialize, Serialize};

use crate::field::{
    self, Image, Laser, LensAperture, Scattering, SlitAperture, View, lens_image, lens_mean,
    slit_image,
};
use crate::optics::Aperture;
use crate::scene::laser_spot::image_scale_across;
use crate::scene::lens::{Across, Pupil};
use crate::scene::pattern::Pattern;
use crate::scene::shape::{AIRY_WIDTH, Parts, place_across, spot_deviation};
use crate::scene::{Effect, LaserSpot, Scene, random, texture};

/// Coherent light from a rough surface, summed as a field through the aperture ([`crate::field`]).
///
/// It takes the place of the scene's other ways to spread a point's light: the pattern is that of Fresnel's
/// integrals whatever [`crate::scene::Diffraction`] says, and the mean over all surfaces is that of the scene
/// without speckle. It needs a
/// [`LaserSpot`]: a point of light does not interfere with itself.
///
/// Speckle belongs to the surface, and so to the seed: it is the same in all rows and frames for a target at
/// rest, and changes as the target moves, over some millimetres, or slides ([`LaserSpot::wander`]). The rows
/// of a frame see different parts of it; a line sensor's tall pixel sees the mean over its height.
///
/// Where the distance is less than 0.4 m the lattice on which the surface's scatterers lie begins to show
/// ([`Scattering::pitch`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Speckle {
    /// 1 for a surface that keeps the laser's polarisation (metal, gloss), 2 for one that does not (paper,
    /// wood).
    pub polarisations: u8,
    /// Full width at half maximum of the laser's spectrum, in metres.
    #[serde(default)]
    pub linewidth: f64,
    /// Mean of the exponentially distributed extra path of light within the material, in metres.
    #[serde(default)]
    pub path_spread: f64,
}

/// A surface, ready to be seen from any distance.
#[derive(Clone, Debug)]
pub struct RoughSurface {
    surface: field::Surface,
    spot: LaserSpot,
}

/// The light on some rows of the sensor, as speckle makes it.
#[derive(Clone, Debug)]
pub struct Rows {
    /// From one column to the next, in metres; the middle one is at the geometric centre.
    pub step: f64,
    /// Light of each row over the spot's height; empty where a row is dark.
    pub light: Vec<Vec<f64>>,
}

/// The surface is made for a beam from here, in metres, or from the scene's distance where that is nearer ...
pub(super) const NEAREST: f64 = 0.3;
/// ... to so many times the scene's distance.
pub(super) const FARTHEST: f64 = 1.5;
/// Patterns are computed to so many details (lambda z / a) from the centre, with so many columns in each.
const DETAILS: f64 = 24.0;
const COLUMNS: f64 = 16.0;

impl Speckle {
    /// Speckle of a surface in light of one wavelength.
    pub const fn of_one_wavelength(polarisations: u8) -> Self {
        Self {
            polarisations,
            linewidth: 0.0,
            path_spread: 0.0,
        }
    }

    /// The surface that a seed makes, with a texture.
    ///
    /// # Panics
    /// If polarisations are neither 1 nor 2, or a length is below zero.
    pub fn surface(
        &self,
        scene: &Scene,
        spot: &LaserSpot,
        texture: Option<&texture::Surface>,
    ) -> RoughSurface {
        let wavelength = scene.optics.wavelength;
        let mut laser = Laser {
            wavelength,
            linewidth: self.linewidth,
            wavelengths: 1,
            waist_diameter: spot.waist,
            waist_distance: spot.waist_distance,
        };
        // For paths that differ by 2.5 times their mean, which 92 % do not exceed (Laser::spectrum).
        let phase = 2.5 * self.path_spread * laser.wavenumber_deviation();
        laser.wavelengths = ((2.0 / PI * phase * phase).ceil() as usize).clamp(5, 15);
        // The beam reaches to 2.25 times its radius. A target may come half as far again
        // (Scene::check_distance).
        let distances = [NEAREST, scene.distance, FARTHEST * scene.distance];
        let diameters = distances.map(|distance| spot.diameter(distance, wavelength));
        let diameter = diameters.into_iter().fold(0.0, f64::max);
        let size = (2.4 * diameter).max(Scattering::surface().size[0]);
        let scattering = Scattering {
            polarisations: usize::from(self.polarisations),
            path_spread: self.path_spread,
            size: [size; 2],
            ..Scattering::surface()
        };
        let seed = random::of_scene(scene.seed, Effect::Speckle).random();
        let mut surface = field::Surface::new(&laser, &scattering, seed)
            .expect("a scene's speckle has 1 or 2 polarisations and lengths above zero");
        if let Some(texture) = texture {
            surface = surface.with_reflectance_along(|x| texture.reflectance(x));
        }
        RoughSurface {
            surface,
            spot: *spot,
        }
    }
}

impl RoughSurface {
    /// The rows of a frame, or the one row of a line sensor, for a target at a distance in metres.
    ///
    /// # Panics
    /// If the laser's spot is wider there than the surface.
    pub fn rows(&self, scene: &Scene, distance: f64) -> Rows {
        match scene.optics.aperture {
            Aperture::Slit { width, height } => self.by_slit(scene, distance, width, height),
            Aperture::Lens { diameter } => self.by_lens(scene, distance, diameter),
        }
    }

    fn view(&self, scene: &Scene, distance: f64) -> View {
        View {
            distance: distance - scene.optics.offset,
            baseline: scene.optics.baseline,
            lateral: [self.spot.place(distance), 0.0],
        }
    }

    fn by_slit(&self, scene: &Scene, distance: f64, width: f64, height: f64) -> Rows {
        let optics = &scene.optics;
        let slit = SlitAperture {
            width,
            height,
            to_sensor: optics.focal_length,
        };
        let detail = optics.wavelength * optics.focal_length / width;
        let (step, columns) = columns(detail, DETAILS * detail);
        let rows = scene.sensor.rows() as usize;
        let view = self.view(scene, distance);
        let image = |places: &[f64]| {
            slit_image(&self.surface, &view, &slit, &columns, places).expect(TOO_WIDE)
        };
        let light = if rows > 1 {
            const EVERY: usize = 4;
            let places: Vec<f64> = (0..rows).map(|row| place_across(scene, row)).collect();
            let image = image(&field::every(&places, EVERY)).with_rows_between(EVERY, rows);
            (0..rows).map(|row| mean(&image, row..row + 1)).collect()
        } else {
            // Along the slit light varies over 0.1 mm: the slit's fringes, or a spot of some millimetres.
            let places = within(scene.sensor.pixel_height(), 25e-6);
            let image = image(&places);
            vec![mean(&image, 0..places.len())]
        };
        Rows { step, light }
    }

    fn by_lens(&self, scene: &Scene, distance: f64, diameter: f64) -> Rows {
        let optics = &scene.optics;
        let range = optics.range(distance);
        let pupil = Pupil::of(scene, diameter, distance);
        // A lens that is in focus at `focus` from there has the sensor where it is.
        let lens = |pupil: &Pupil| {
            let focus = 1.0 / (1.0 / range - 2.0 * pupil.defocus / pupil.radius.powi(2));
            LensAperture {
                diameter,
                focal_length: 1.0 / (1.0 / optics.focal_length + 1.0 / focus),
                focus_distance: focus,
                coma: pupil.coma / optics.wavelength,
                full_field: 1.0,
                pixel: 0.0,
                samples: 1,
            }
        };
        let laser = &self.surface.laser;
        let view = self.view(scene, distance);
        // Coma is already that of this field.
        let field = 1.0;
        let beam = 0.5 * self.spot.diameter(distance, optics.wavelength);
        let spot = 2.25 * beam * image_scale_across(optics, distance);
        let detail = pupil.detail();
        let reach = spot + 0.5 * DETAILS * detail + 1.5 * pupil.farthest_ray();
        let (step, columns) = columns(detail, reach);
        let image = |places: &[f64]| {
            let lens = lens(&pupil);
            lens_image(&self.surface, &view, &lens, field, &columns, places).expect(TOO_WIDE)
        };
        // In focus the height is that of the spot; out of focus the same light is spread wider.
        let (scattering, sharp) = (&self.surface.scattering, lens(&pupil.ideal()));
        let ideal = lens_mean(laser, scattering, &view, &sharp, field, &[0.0], &[0.0]);
        let count = scene.sensor.rows() as usize;
        let pixel = scene.sensor.pixel_height();
        let mut light = vec![vec![]; count];
        if count > 1 {
            let is_lit = |row: &usize| place_across(scene, *row).abs() <= reach;
            let lit: Vec<usize> = (0..count).filter(is_lit).collect();
            let parts = within(pixel, detail / 3.0);
            let of_row = |&row| (parts.iter()).map(move |part| place_across(scene, row) + part);
            let places: Vec<f64> = lit.iter().flat_map(of_row).collect();
            let image = image(&places);
            let factor = image.density / ideal.density;
            for (i, &row) in lit.iter().enumerate() {
                light[row] = mean(&image, i * parts.len()..(i + 1) * parts.len());
                light[row].iter_mut().for_each(|light| *light *= factor);
            }
        } else {
            // The light that the pixel's height holds, over that in the middle column of the spot in focus.
            let places = within(pixel.min(2.0 * reach), detail / 3.0);
            let image = image(&places);
            let across = pixel.min(2.0 * reach);
            let factor =
                image.density / ideal.density * across / height_in_focus(scene, &pupil, distance);
            light[0] = mean(&image, 0..places.len());
            light[0].iter_mut().for_each(|light| *light *= factor);
        }
        Rows { step, light }
    }
}

const TOO_WIDE: &str = "the surface was made for the laser's spot between 0.3 m and 1.5 times the scene's \
                        distance, where the beam is wider: move the scene's distance or the beam's waist";

/// Height in metres of the spot's image through a lens in focus, in its middle column: its light there over
/// that in its middle.
fn height_in_focus(scene: &Scene, pupil: &Pupil, distance: f64) -> f64 {
    let parts = Parts::new(scene, None, distance, AIRY_WIDTH * pupil.detail());
    let step = pupil.detail() / COLUMNS;
    let chords = pupil.ideal().chords(step, DETAILS * pupil.detail(), 0.0);
    let middle = |across| parts.height(&Pattern::from_knots(step, chords.row(across)));
    let blur = spot_deviation(scene, distance) * image_scale_across(&scene.optics, distance);
    middle(Across::All)
        / middle(Across::Pixel {
            place: 0.0,
            height: 0.0,
            blur,
        })
}

/// Places of columns to `reach` metres on both sides of the middle, and from one to the next.
fn columns(detail: f64, reach: f64) -> (f64, Vec<f64>) {
    let step = detail / COLUMNS;
    let half = (reach / step).ceil() as i64;
    (step, (-half..=half).map(|i| i as f64 * step).collect())
}

/// The middles of even parts of a height, no higher than `step`, from the height's middle.
fn within(height: f64, step: f64) -> Vec<f64> {
    let count = (height / step).ceil().max(1.0);
    let middle = |i| ((i as f64 + 0.5) / count - 0.5) * height;
    (0..count as usize).map(middle).collect()
}

/// Mean of some rows of an image.
fn mean(image: &Image, rows: Range<usize>) -> Vec<f64> {
    let share = 1.0 / rows.len() as f64;
    let mut mean = vec![0.0; image.columns];
    for row in rows {
        for (mean, &light) in mean.iter_mut().zip(image.row(row)) {
            *mean += share * f64::from(light);
        }
    }
    mean
}
