//! A comb of slits before a line sensor on the paper's table, in place of the camera: the same pieces of
//! material in the same light, through the core.

use anyhow::Context as _;
use calibration::fit::eq1;
use judges::frames;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;
use simulator::field::{Image, Surface, View, slit_image};
use simulator::optics::Optics;
use simulator::scene::Sensor;
use simulator::scene::comb::Comb;
use slitrange::frame::comb::Slits;
use slitrange::measurement::{Measurement, Options};
use slitrange::row::sensor_heads;
use statistics::mean;

use crate::paper::apparatus::{CAPTURES, LASER, SLIT, TABLE, WANDER};
use crate::paper::data_set::{exposed, positions};
use crate::paper::materials::MATERIALS;
use crate::paper::slit_path;

#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    pub material: usize,
    /// Mean of the absolute errors in metres.
    pub mae: f64,
    /// The largest absolute error in metres.
    pub max: f64,
    pub without_centre: usize,
    /// Mean number of slits in a reading.
    pub slits: f64,
}

/// Pixels that an image of a slit is computed on: the next slit's begins there.
const COLUMNS: usize = 128;

/// Parts of a pixel's height: the slit's fringes along it are a tenth of a millimetre long.
const PARTS: usize = 8;

/// Black level, noise and electrons of a count: those of the TCD1304DG in the scenes.
const BLACK: f64 = 300.0;
const READ_NOISE: f64 = 4.0;
const ELECTRONS: f64 = 10.0;

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
    fn new(material: usize, seed: u64) -> anyhow::Result<Self> {
        let optics = Optics::nominal_on(Sensor::Tcd1304dg);
        let of_piece = seed ^ (material as u64) << 48;
        let mut target = Self {
            surface: MATERIALS[material].surface(&LASER, of_piece)?,
            material,
            slits: (Comb::nominal().slits.iter())
                .map(|slit| slit.optics(&optics))
                .collect(),
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

    /// The centre of a frame of the paper's captures, in pixels, and the slits used.
    fn centre(&self, distance: f64, position: u64) -> anyhow::Result<Option<(f64, u8)>> {
        let light = self.light(distance)?;
        let geometry = sensor_heads::tcd1304dg();
        let options = Options {
            rows: CAPTURES as u16,
            slits: Slits::Comb,
            ..Options::default()
        };
        let mut measurement = Measurement::new(geometry.clone(), options);
        let mut random = ChaCha8Rng::seed_from_u64(!self.seed);
        random.set_stream(position);
        let measured = (0..CAPTURES).find_map(|_| {
            let mut noisy = vec![BLACK as f32; geometry.words];
            for (pixel, light) in noisy[geometry.light.clone()].iter_mut().zip(&light) {
                *pixel += light;
            }
            for pixel in &mut noisy {
                let variance = READ_NOISE * READ_NOISE + (f64::from(*pixel) - BLACK) / ELECTRONS;
                let normal: f64 = StandardNormal.sample(&mut random);
                *pixel += (normal * variance.sqrt()) as f32;
            }
            measurement.row(&mut frames::words(&noisy, &geometry))
        });
        let measured = measured.context("a frame of all captures is complete")?;
        Ok(measured.ok().map(|measured| {
            let used = measured.comb.map_or(1, |comb| comb.used);
            (measured.frame.centre.to_f64(), used)
        }))
    }
}

/// Moves a material past the comb, at every `stride`-th of the paper's positions, and fits eq. (1) to the
/// data set itself as the paper does. `done` is called after each position.
pub fn judge(
    material: usize,
    seed: u64,
    stride: usize,
    done: &(dyn Fn() + Sync),
) -> anyhow::Result<Judged> {
    let target = Target::new(material, seed)?;
    let distances = positions(stride);
    let found: Vec<Option<(f64, u8)>> = (distances.par_iter().enumerate())
        .map(|(position, &distance)| {
            let centre = target.centre(distance, position as u64);
            done();
            centre
        })
        .collect::<anyhow::Result<_>>()?;
    let points: Vec<(f64, f64)> = (found.iter().zip(&distances))
        .filter_map(|(found, &distance)| found.map(|(centre, _)| (centre, distance)))
        .collect();
    let fit = eq1::fit(&points)?;
    let errors = || {
        let points = points.iter();
        points.map(|&(centre, distance)| (fit.curve.distance(centre) - distance).abs())
    };
    let slits = found.iter().flatten().map(|(_, used)| f64::from(*used));
    Ok(Judged {
        material,
        mae: mean(errors()),
        max: errors().fold(0.0, f64::max),
        without_centre: found.len() - points.len(),
        slits: mean(slits),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Through 16 slits the mean error on paper is below what the simulated camera has with one slit and 600
    /// rows (66 um at all positions).
    #[test]
    fn a_comb_beats_the_camera_on_paper() {
        let paper = MATERIALS.iter().position(|it| it.name == "Printer Paper");
        let judged = judge(paper.expect("paper"), 7, 420, &|| {}).expect("a curve");
        println!("{judged:?}");
        assert_eq!(judged.without_centre, 0);
        assert!(judged.mae < 60e-6 && judged.slits > 15.0);
    }
}
