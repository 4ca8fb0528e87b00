//! How the light of the laser's spot is spread over the sensor, for a target at one distance.
//!
//! A scene of a plain gaussian does without; the others compute their shape once for all rows at a distance.

use std::f64::consts::SQRT_2;

use crate::optics::Aperture;
use crate::scene::diffraction::{Diffraction, Gap};
use crate::scene::laser_spot::{image_scale, image_scale_across};
use crate::scene::lens::{Across, Pupil, Ray};
use crate::scene::obliquity::Oblique;
use crate::scene::pattern::{Part, Pattern};
use crate::scene::speckle::RoughSurface;
use crate::scene::{Scene, texture};

/// Light beyond so many details (lambda z / a) of a slit's pattern is left out: it is below 5e-5 of the peak.
const SLIT_DETAILS: f64 = 48.0;
/// The same for a lens, whose pattern falls faster.
const LENS_DETAILS: f64 = 24.0;
/// Sigma, in details, of the gaussian that fits sinc^2 best: 1/2.66 of the distance to its first zero.
pub(crate) const SLIT_WIDTH: f64 = 0.376;
/// The same for Airy's pattern, or a little less.
pub(super) const AIRY_WIDTH: f64 = 0.4;

/// A pattern for each row of the sensor.
#[derive(Clone, Debug)]
pub struct Shape {
    /// What pixels gather, over the spot's height; places are from the geometric centre.
    patterns: Vec<Pattern>,
    /// For each row its pattern and the factor of its light; `None` for a dark one.
    rows: Vec<Option<(usize, f64)>>,
    /// Sigma in metres of a gaussian that is no wider than the spot, nor finer than its details.
    pub width: f64,
}

impl Shape {
    /// Whether the scene's spot is more than a gaussian.
    pub fn is_needed(scene: &Scene) -> bool {
        let of_lens = matches!(scene.optics.aperture, Aperture::Lens { .. });
        scene.diffraction.is_some()
            || scene.obliquity.is_some()
            || scene.texture.is_some()
            || scene.speckle.is_some() && scene.laser_spot.is_some()
            || of_lens && (scene.defocus.is_some() || scene.coma.is_some())
    }

    /// The shape of light that adds up without interference.
    pub fn incoherent(scene: &Scene, surface: Option<&texture::Surface>, distance: f64) -> Self {
        match scene.optics.aperture {
            Aperture::Slit { width, .. } => Self::of_slit(scene, surface, distance, width),
            Aperture::Lens { diameter } => Self::of_lens(scene, surface, distance, diameter),
        }
    }

    /// The shape of coherent light from a rough surface.
    pub fn coherent(scene: &Scene, surface: &RoughSurface, distance: f64) -> Self {
        let rows = surface.rows(scene, distance);
        let mut shape = Self {
            patterns: vec![],
            rows: vec![],
            width: match scene.optics.aperture {
                Aperture::Slit { width, .. } => SLIT_WIDTH * gap(scene, width, distance).detail(),
                Aperture::Lens { diameter } => {
                    AIRY_WIDTH * scene.optics.wavelength * scene.optics.focal_length / diameter
                }
            },
        };
        for light in rows.light {
            if light.is_empty() {
                shape.rows.push(None);
                continue;
            }
            shape.rows.push(Some((shape.patterns.len(), 1.0)));
            let pattern = Pattern::from_knots(rows.step, light);
            shape.patterns.push(pattern.gathered(scene.optics.pitch));
        }
        shape
    }

    /// A row's pattern, and the factor of its light.
    pub fn row(&self, row: usize) -> Option<(&Pattern, f64)> {
        let (pattern, factor) = self.rows[row]?;
        Some((&self.patterns[pattern], factor))
    }

    fn of_slit(
        scene: &Scene,
        surface: Option<&texture::Surface>,
        distance: f64,
        slit_width: f64,
    ) -> Self {
        let optics = &scene.optics;
        let (point, width) = match scene.diffraction {
            Some(diffraction) => {
                let gap = gap(scene, slit_width, distance);
                let point = gap.pattern(diffraction, SLIT_DETAILS * gap.detail());
                (point, SLIT_WIDTH * gap.detail())
            }
            None => gaussian(scene),
        };
        let parts = Parts::new(scene, surface, distance, width);
        let height = parts.height(&point);
        let pattern = point.spread(&parts.of_surface()).scaled(1.0 / height);
        Self {
            patterns: vec![pattern.gathered(optics.pitch)],
            rows: (heights(scene, distance).into_iter())
                .map(|height| (height > 0.0).then_some((0, height)))
                .collect(),
            width,
        }
    }

    fn of_lens(
        scene: &Scene,
        surface: Option<&texture::Surface>,
        distance: f64,
        diameter: f64,
    ) -> Self {
        let pupil = Pupil::of(scene, diameter, distance);
        let blur = spot_deviation(scene, distance) * image_scale_across(&scene.optics, distance);
        let point = match scene.diffraction {
            Some(_) => LensPoint::by_waves(scene, pupil, blur),
            None => LensPoint::by_rays(scene, &pupil, blur),
        };
        let parts = Parts::new(scene, surface, distance, point.width);
        let of_surface = parts.of_surface();
        let height = parts.height(&point.ideal);
        let rows = scene.sensor.rows() as usize;
        let mut shape = Self {
            patterns: vec![],
            rows: vec![None; rows],
            width: point.width,
        };
        // The rows above the middle are as those below.
        for row in 0..rows.div_ceil(2) {
            let place = place_across(scene, row);
            if place.abs() > point.farthest {
                continue;
            }
            let pattern = (point.along)(place).spread(&of_surface);
            let pattern = pattern.scaled(1.0 / height);
            shape.rows[row] = Some((shape.patterns.len(), 1.0));
            shape.rows[rows - 1 - row] = shape.rows[row];
            shape.patterns.push(pattern.gathered(scene.optics.pitch));
        }
        shape
    }
}

/// What a lens makes of the points of the laser spot that lie one above the other.
struct LensPoint {
    /// Light along the row that is so many metres from the middle.
    along: Box<dyn Fn(f64) -> Pattern>,
    /// The same in the middle row without aberrations.
    ideal: Pattern,
    /// There is no light so far from the middle row, in metres.
    farthest: f64,
    /// Sigma in metres of a gaussian that is no wider, nor finer than its details.
    width: f64,
}

impl LensPoint {
    /// By diffraction at the pupil. `blur` is the sigma of the laser spot's image across the rows, in metres.
    fn by_waves(scene: &Scene, pupil: Pupil, blur: f64) -> Self {
        let step = pupil.detail() / 16.0;
        let reach = LENS_DETAILS * pupil.detail() + 1.5 * pupil.farthest_ray();
        let farthest = 5.0 * blur + 12.0 * pupil.detail() + pupil.farthest_ray();
        let height = scene.sensor.pixel_height();
        // A pixel of a line sensor is as high as 25 details.
        let many_rows = scene.sensor.rows() > 1;
        let across = move |place| match many_rows {
            true => Across::Pixel {
                place,
                height,
                blur,
            },
            false => Across::All,
        };
        let chords = pupil.chords(step, reach, farthest);
        let ideal = match pupil.ideal() {
            ideal if ideal == pupil => chords.row(across(0.0)),
            ideal => ideal.chords(step, reach, 0.0).row(across(0.0)),
        };
        Self {
            along: Box::new(move |place| Pattern::from_knots(step, chords.row(across(place)))),
            ideal: Pattern::from_knots(step, ideal),
            farthest,
            width: AIRY_WIDTH * pupil.detail(),
        }
    }

    /// By rays, on the scene's gaussian.
    fn by_rays(scene: &Scene, pupil: &Pupil, blur: f64) -> Self {
        let (gaussian, sigma) = gaussian(scene);
        let sigma_across = libm::hypot(sigma, blur);
        let many_rows = scene.sensor.rows() > 1;
        let rays = match pupil.farthest_ray() {
            // All light goes straight.
            0.0 => vec![Ray {
                x: 0.0,
                y: 0.0,
                weight: 1.0,
            }],
            _ => pupil.rays(sigma),
        };
        let point = gaussian.clone();
        let along = move |place: f64| {
            let light = |off: f64| match many_rows {
                true => libm::exp(-0.5 * (off / sigma_across).powi(2)),
                false => 1.0,
            };
            let part = |ray: &Ray| Part::new(ray.x, ray.weight * light(place - ray.y));
            point.spread(&rays.iter().map(part).collect::<Vec<_>>())
        };
        Self {
            along: Box::new(along),
            ideal: gaussian,
            farthest: 7.0 * sigma_across + pupil.farthest_ray(),
            width: sigma,
        }
    }
}

/// Sigma of the plain gaussian's image of the whole laser spot, along the row, in pixels.
pub fn gaussian_width(scene: &Scene, distance: f64) -> f64 {
    let blur = spot_deviation(scene, distance) * image_scale(&scene.optics, distance);
    let width = scene.spot.map_or(0.0, |spot| spot.width);
    libm::hypot(width, blur / scene.optics.pitch)
}

/// Light in a row of the sensor, over that in the middle, of a gaussian whose sigma is `width` pixels for a
/// point: one row of a line sensor sees all of it.
pub fn gaussian_height(scene: &Scene, width: f64, distance: f64, row: usize) -> f64 {
    if scene.sensor.rows() == 1 {
        return 1.0;
    }
    let place = place_across(scene, row);
    let blur = spot_deviation(scene, distance) * image_scale_across(&scene.optics, distance);
    match scene.optics.aperture {
        Aperture::Slit { height, .. } => {
            // The shadow of the slit's ends, from a spot that is no point.
            let range = scene.optics.range(distance);
            let end = 0.5 * height * (range + scene.optics.focal_length) / range;
            let scale = 1.0 / (SQRT_2 * blur.max(scene.sensor.pixel_height() / 12f64.sqrt()));
            0.5 * (libm::erf((end - place) * scale) + libm::erf((end + place) * scale))
        }
        Aperture::Lens { .. } => {
            let sigma = width * scene.optics.pitch;
            libm::exp(-0.5 * (place / libm::hypot(sigma, blur)).powi(2))
        }
    }
}

/// Light of each row behind a slit, over that of the middle.
fn heights(scene: &Scene, distance: f64) -> Vec<f64> {
    let rows = scene.sensor.rows() as usize;
    let optics = &scene.optics;
    match (scene.diffraction, optics.aperture) {
        (Some(Diffraction::Fresnel), Aperture::Slit { height, .. }) if rows > 1 => {
            let gap = gap(scene, height, distance);
            // From the shadow's end on light falls with the square of the distance, a detail being 11 um.
            let reach = 0.7 * height + 0.5 * rows as f64 * scene.sensor.pixel_height();
            let blur = spot_deviation(scene, distance) * image_scale_across(optics, distance);
            let pattern = gap
                .pattern(Diffraction::Fresnel, reach)
                .spread(&gaussian_parts(blur, blur / 4.0))
                .gathered(scene.sensor.pixel_height());
            let light = |row| pattern.at(place_across(scene, row)) / pattern.at(0.0);
            (0..rows).map(|row| light(row).max(0.0)).collect()
        }
        _ => (0..rows)
            .map(|row| gaussian_height(scene, 0.0, distance, row))
            .map(|height| if height < 1e-9 { 0.0 } else { height })
            .collect(),
    }
}

/// Metres from the sensor's middle to the middle of a row.
pub fn place_across(scene: &Scene, row: usize) -> f64 {
    (row as f64 - 0.5 * (scene.sensor.rows() as f64 - 1.0)) * scene.sensor.pixel_height()
}

/// The geometric centre in metres from the axis.
pub(super) fn geometric_centre(scene: &Scene, distance: f64) -> f64 {
    (scene.optics.centre(distance) - scene.optics.axis) * scene.optics.pitch
}

pub(crate) fn gap(scene: &Scene, width: f64, distance: f64) -> Gap {
    Gap {
        width,
        to_light: scene.optics.range(distance),
        to_sensor: scene.optics.focal_length,
        wavelength: scene.optics.wavelength,
    }
}

/// The scene's plain gaussian of a point, and its sigma in metres.
fn gaussian(scene: &Scene) -> (Pattern, f64) {
    let sigma = scene.spot.map_or(1.0, |spot| spot.width) * scene.optics.pitch;
    let light = |x: f64| libm::exp(-0.5 * (x / sigma).powi(2));
    (Pattern::new(sigma / 16.0, 7.0 * sigma, light), sigma)
}

/// Standard deviation of the laser's light over the target, in metres: 0 for a point.
pub(crate) fn spot_deviation(scene: &Scene, distance: f64) -> f64 {
    let wavelength = scene.optics.wavelength;
    (scene.laser_spot).map_or(0.0, |it| it.deviation(distance, wavelength))
}

/// The places of the laser's spot along the baseline, and where their light goes.
pub(super) struct Parts<'a> {
    /// Metres on the target from the beam's middle, and share of the light.
    places: Vec<Part>,
    /// Metres on the sensor for one on the target.
    scale: f64,
    /// The surface, and the place that the beam's middle hits.
    surface: Option<(&'a texture::Surface, f64)>,
}

impl<'a> Parts<'a> {
    /// For patterns no narrower than a gaussian of sigma `width` metres.
    pub(super) fn new(
        scene: &Scene,
        surface: Option<&'a texture::Surface>,
        distance: f64,
        width: f64,
    ) -> Self {
        let mut scale = image_scale(&scene.optics, distance);
        if scene.obliquity.is_some() {
            let centre = geometric_centre(scene, distance);
            scale *= Oblique::new(centre, scene.optics.focal_length).cosine();
        }
        let deviation = spot_deviation(scene, distance);
        let mut step = (deviation / 4.0).min(width / scale.abs());
        if let Some(texture) = scene.texture {
            step = step.min(texture.length / 4.0);
        }
        let middle = scene.laser_spot.map_or(0.0, |it| it.place(distance));
        Self {
            places: gaussian_parts(deviation, step),
            scale,
            surface: surface.map(|surface| (surface, middle)),
        }
    }

    /// Where the light goes, from a surface that is equally bright everywhere.
    fn even(&self) -> impl Iterator<Item = Part> {
        let part = |part: &Part| Part::new(part.shift * self.scale, part.weight);
        self.places.iter().map(part)
    }

    /// Where the light goes from the surface.
    fn of_surface(&self) -> Vec<Part> {
        let reflectance = |place: f64| {
            self.surface
                .map_or(1.0, |(surface, middle)| surface.reflectance(middle + place))
        };
        let pairs = self.even().zip(&self.places);
        pairs
            .map(|(part, at)| Part::new(part.shift, part.weight * reflectance(at.shift)))
            .collect()
    }

    /// Height of the spot on a surface that is equally bright everywhere, over that of a point's pattern.
    pub(super) fn height(&self, point: &Pattern) -> f64 {
        let light = self.even().map(|part| part.weight * point.at(-part.shift));
        light.sum()
    }
}

/// A gaussian in parts `step` apart, up to five sigma (the trapezoidal rule, which is exact for a gaussian
/// but for e^-(2 pi^2 / step^2) with the step in sigma). One part for a point.
fn gaussian_parts(sigma: f64, step: f64) -> Vec<Part> {
    if sigma == 0.0 {
        return vec![Part::new(0.0, 1.0)];
    }
    let half = (5.0 * sigma / step).ceil() as i64;
    let part = |shift: f64| Part::new(shift, libm::exp(-0.5 * (shift / sigma).powi(2)));
    let mut parts: Vec<Part> = (-half..=half).map(|i| part(i as f64 * step)).collect();
    let sum: f64 = parts.iter().map(|part| part.weight).sum();
    parts.iter_mut().for_each(|part| part.weight /= sum);
    parts
}
