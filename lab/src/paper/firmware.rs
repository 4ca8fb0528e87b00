//! The firmware on the paper's table: the same pieces of material in the same light, before the product's
//! line sensor with one slit or a comb, and before the paper's camera.

use judges::frames;
use simulator::field::{Image, Surface, View, slit_image};
use simulator::scene::Sensor;
use simulator::scene::comb::Comb;
use slitrange::{Mean, Options};

use crate::paper::apparatus::{Aperture, CAPTURES, LASER, SLIT, TABLE, WANDER};
use crate::paper::camera::SHOT_VARIANCE_PER_COUNT_Q16;
use crate::paper::data_set::{self, DataSet, exposed, positions};
use crate::paper::errors::{self, Judged};
use crate::paper::materials::MATERIALS;
use crate::paper::slit_path;
use crate::prelude::*;

/// What looks at the material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Head {
    /// The paper's camera and slit. A frame is every tenth row of a capture, with the paper's plain mean.
    Camera,
    /// The line sensor. A frame is [`CAPTURES`] rows, with the firmware's mean.
    Line(Slits),
}

/// How a row's centre is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fit {
    /// The paper's gaussian fit: `gauss-newton`, told of no shot noise.
    Plain,
    Firmware(Estimator),
}

/// Of the camera's rows, every so many are measured. A speckle is some 150 rows high.
const ROW_STEP: usize = 10;

/// Pixels that an image of a slit is computed on: the next slit's begins there.
const COLUMNS: usize = 128;

/// Parts of a pixel's height: the slit's fringes along it are a tenth of a millimetre long.
const PARTS: usize = 8;

/// Black level, noise and electrons of a count: those of the TCD1304DG in the scenes.
const BLACK: f64 = 300.0;
const READ_NOISE: f64 = 4.0;
const ELECTRONS: f64 = 10.0;

/// A material before the line sensor.
struct Target {
    surface: Surface,
    material: usize,
    slits: Vec<Optics>,
    optics: Optics,
    /// Counts for an image's light times its density times its brightness.
    counts: f64,
    seed: u64,
}

impl Target {
    fn new(material: usize, seed: u64, slits: Slits) -> anyhow::Result<Self> {
        let optics = Optics::nominal_on(Sensor::Tcd1304dg);
        let of_piece = seed ^ (material as u64) << 48;
        let mut target = Self {
            surface: MATERIALS[material].surface(&LASER, of_piece)?,
            material,
            slits: match slits {
                Slits::One => vec![optics],
                Slits::Comb => (Comb::nominal().slits.iter())
                    .map(|slit| slit.optics(&optics))
                    .collect(),
            },
            optics,
            counts: 1.0,
            seed: of_piece,
        };
        target.counts = exposed(|distance| {
            let view = target.view(&target.optics, distance);
            Ok(MATERIALS[material].light(&view) * slit_path::density(&target.surface, &view)?)
        })?;
        Ok(target)
    }

    fn view(&self, slit: &Optics, distance: f64) -> View {
        View {
            distance: distance - slit.offset,
            baseline: slit.baseline,
            lateral: [WANDER * (distance - TABLE.0), 0.0],
        }
    }

    /// The light of all slits on the row, in counts.
    fn light(&self, distance: f64) -> anyhow::Result<Vec<f32>> {
        let mut row = vec![0.0; sensor_heads::tcd1304dg().light.len()];
        let height = Sensor::Tcd1304dg.pixel_height();
        let part = |i| ((i as f64 + 0.5) / PARTS as f64 - 0.5) * height;
        let parts: Vec<f64> = (0..PARTS).map(part).collect();
        for slit in &self.slits {
            let centre = slit.centre(distance);
            let first = centre.round() as usize - COLUMNS / 2;
            let place = |column| (column as f64 - centre) * slit.pitch;
            let columns: Vec<f64> = (first..first + COLUMNS).map(place).collect();
            let view = self.view(slit, distance);
            let image: Image = slit_image(&self.surface, &view, &SLIT, &columns, &parts)?;
            let brightness = MATERIALS[self.material].light(&view);
            let counts = self.counts * brightness * image.density / PARTS as f64;
            for part in 0..PARTS {
                for (place, light) in row[first..].iter_mut().zip(image.row(part)) {
                    *place += (counts * f64::from(*light)) as f32;
                }
            }
        }
        Ok(row)
    }

    /// The words of a frame at a position.
    fn frame(&self, distance: f64, position: usize) -> anyhow::Result<Vec<Vec<u16>>> {
        let light = self.light(distance)?;
        let geometry = sensor_heads::tcd1304dg();
        let mut random = ChaCha8Rng::seed_from_u64(!self.seed);
        random.set_stream(position as u64);
        let mut row = || {
            let mut noisy = vec![BLACK as f32; geometry.words];
            for (pixel, light) in noisy[geometry.light.clone()].iter_mut().zip(&light) {
                *pixel += light;
            }
            for pixel in &mut noisy {
                let variance = READ_NOISE * READ_NOISE + (f64::from(*pixel) - BLACK) / ELECTRONS;
                let normal: f64 = StandardNormal.sample(&mut random);
                *pixel += (normal * variance.sqrt()) as f32;
            }
            frames::words(&noisy, &geometry)
        };
        Ok((0..CAPTURES).map(|_| row()).collect())
    }
}

/// Where the rows come from.
enum Source<'a> {
    Camera(data_set::Target<'a>),
    Line(Target),
}

/// The words of every [`ROW_STEP`]-th row of the camera's capture, and the column at which they begin.
fn capture(
    target: &data_set::Target<'_>,
    position: usize,
) -> anyhow::Result<(Vec<Vec<u16>>, usize)> {
    let (exposure, first) = target.expose(position)?;
    let mut counts = vec![];
    target.capture(&exposure, position, 0, &mut counts);
    let rows = counts.chunks(slit_path::COLUMNS).step_by(ROW_STEP);
    Ok((rows.map(<[u16]>::to_vec).collect(), first))
}

/// The centre of a frame in pixels: not a number where the frame has a fault.
fn centre(rows: &[Vec<u16>], geometry: &Geometry, head: Head, fit: Fit) -> f64 {
    let mut geometry = geometry.clone();
    let estimator = match fit {
        Fit::Plain => {
            geometry.shot_variance_per_count_q16 = 0;
            Estimator::GaussNewton
        }
        Fit::Firmware(estimator) => estimator,
    };
    let (mean, slits) = match head {
        Head::Camera => (Mean::Plain, Slits::One),
        Head::Line(slits) => (Mean::default(), slits),
    };
    let options = Options {
        mean,
        estimator,
        slits,
        ..Options::default()
    };
    let measured = frames::measure_rows(rows, &geometry, options, None);
    measured.map_or(f64::NAN, |it| it.frame.centre.to_f64())
}

/// Moves a material past a head, at every `stride`-th of the paper's positions, and fits eq. (1) to the data
/// set of each fit itself, as the paper does. `done` is called after each position.
pub fn judge(
    head: Head,
    fits: &[Fit],
    material: usize,
    seed: u64,
    stride: usize,
    done: &(dyn Fn() + Sync),
) -> anyhow::Result<Vec<Judged>> {
    let set = DataSet {
        material,
        aperture: Aperture::Slit,
        seed,
        distances: positions(stride),
    };
    let (source, geometry) = match head {
        Head::Camera => {
            let mut geometry = Sensor::Row(slit_path::COLUMNS).geometry();
            geometry.shot_variance_per_count_q16 = SHOT_VARIANCE_PER_COUNT_Q16;
            (Source::Camera(data_set::Target::new(&set)?), geometry)
        }
        Head::Line(slits) => {
            let target = Target::new(material, seed, slits)?;
            (Source::Line(target), sensor_heads::tcd1304dg())
        }
    };
    let found: Vec<Vec<f64>> = (set.distances.par_iter().enumerate())
        .map(|(position, &distance)| {
            let (rows, first) = match &source {
                Source::Line(target) => (target.frame(distance, position)?, 0),
                Source::Camera(target) => capture(target, position)?,
            };
            let centre = |&fit| first as f64 + centre(&rows, &geometry, head, fit);
            let centres = fits.iter().map(centre).collect();
            done();
            Ok(centres)
        })
        .collect::<anyhow::Result<_>>()?;
    let of_fit = |fit: usize| found.iter().map(move |centres| centres[fit]);
    (0..fits.len())
        .map(|fit| errors::judge(&set.distances, &of_fit(fit).collect::<Vec<_>>()))
        .collect()
}
