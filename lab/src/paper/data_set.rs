//! A data set: one material, one aperture, all positions of the table, and the centres that every method
//! finds.

use rayon::prelude::*;

use crate::paper::apparatus::{
    Aperture, BASELINE, CAPTURES, LASER, POSITIONS, STEP, TABLE, WANDER,
};
use crate::paper::camera::{self, Exposure, PEAK};
use crate::paper::materials::MATERIALS;
use crate::paper::{lens_path, slit_path};
use simulator::field::{Surface, View};

#[derive(Clone, Debug, PartialEq)]
pub struct DataSet {
    pub material: usize,
    pub aperture: Aperture,
    pub seed: u64,
    /// Distances of the positions in metres.
    pub distances: Vec<f64>,
}

/// What every method found: for each capture its distance in metres, and for each method and capture the
/// centre in pixels, which is not a number where there is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Centres {
    pub distances: Vec<f64>,
    /// For each of [`Method::of`](crate::paper::methods::Method::of) all captures.
    pub of_methods: Vec<Vec<f64>>,
}

/// A data set with its surface and its exposure time: ready to be captured.
pub struct Target<'a> {
    set: &'a DataSet,
    /// The same surface for the lens and the slit.
    surface: Surface,
    /// Counts for an image's light times its density times the material's light.
    counts: f64,
}

/// Chooses an exposure time: the counts for a unit of light with which the mean of `light` along the table,
/// at so many distances, becomes [`PEAK`].
pub fn exposed(light: impl Fn(f64) -> anyhow::Result<f64>) -> anyhow::Result<f64> {
    const EXPOSED_AT: usize = 16;
    let mut sum = 0.0;
    for i in 0..EXPOSED_AT {
        let share = (i as f64 + 0.5) / EXPOSED_AT as f64;
        sum += light(TABLE.0 + (TABLE.1 - TABLE.0) * share)?;
    }
    Ok(PEAK * EXPOSED_AT as f64 / sum)
}

impl<'a> Target<'a> {
    /// Prepares a data set: the mean peak of its images along the table becomes [`PEAK`].
    pub fn new(set: &'a DataSet) -> anyhow::Result<Self> {
        let seed = set.seed ^ (set.material as u64) << 48;
        let material = &MATERIALS[set.material];
        let mut target = Self {
            set,
            surface: material.surface(&LASER, seed)?,
            counts: 1.0,
        };
        target.counts = exposed(|distance| {
            let view = target.view(distance);
            let density = match set.aperture {
                Aperture::Slit => slit_path::density(&target.surface, &view)?,
                Aperture::Lens => lens_path::density(&target.surface, &view)?,
            };
            Ok(material.light(&view) * density)
        })?;
        Ok(target)
    }

    fn view(&self, distance: f64) -> View {
        View {
            distance,
            baseline: BASELINE,
            lateral: [WANDER * (distance - TABLE.0), 0.0],
        }
    }

    /// The light at a position, and the sensor's column at which it begins.
    pub fn expose(&self, position: usize) -> anyhow::Result<(Exposure, usize)> {
        let view = self.view(self.set.distances[position]);
        let (image, first) = match self.set.aperture {
            Aperture::Slit => slit_path::image(&self.surface, &view)?,
            Aperture::Lens => lens_path::image(&self.surface, &view)?,
        };
        let brightness = MATERIALS[self.set.material].light(&view);
        let counts = (self.counts * brightness * image.density) as f32;
        let light = image.light.iter().map(|light| counts * light);
        Ok((Exposure::new(light), first))
    }

    /// A capture of that light, with noise of its own.
    pub fn capture(&self, exposure: &Exposure, position: usize, capture: usize, to: &mut Vec<u16>) {
        let aperture = match self.set.aperture {
            Aperture::Slit => 1,
            Aperture::Lens => 2,
        };
        let set = (self.set.material as u64) << 48 ^ aperture << 60;
        // Not the surface's seed: its streams are numbered otherwise.
        let mut random = camera::noise(!self.set.seed ^ set, position as u64, capture as u64);
        exposure.capture(&mut random, to);
    }

    /// The centres of the captures at a position, by every method.
    fn centres(&self, position: usize) -> anyhow::Result<Vec<Vec<f64>>> {
        let (exposure, first) = self.expose(position)?;
        let mut counts = vec![];
        let mut of_capture = |capture| {
            self.capture(&exposure, position, capture, &mut counts);
            let mut centres = match self.set.aperture {
                Aperture::Slit => slit_path::centres(&counts),
                Aperture::Lens => lens_path::centres(&counts),
            };
            for centre in &mut centres {
                *centre += first as f64;
            }
            centres
        };
        Ok((0..CAPTURES).map(&mut of_capture).collect())
    }
}

impl DataSet {
    /// Acquires and measures, on all cores. `done` is called after each position.
    pub fn measure(&self, done: &(dyn Fn() + Sync)) -> anyhow::Result<Centres> {
        let target = Target::new(self)?;
        // In the order of the positions, whichever thread does them.
        let of_positions: Vec<Vec<Vec<f64>>> = (0..self.distances.len())
            .into_par_iter()
            .map(|position| {
                let centres = target.centres(position);
                done();
                centres
            })
            .collect::<anyhow::Result<_>>()?;
        let captures = || of_positions.iter().flatten();
        let methods = captures().next().map_or(0, Vec::len);
        let distances = self.distances.iter().flat_map(|&it| [it; CAPTURES]);
        Ok(Centres {
            distances: distances.collect(),
            of_methods: (0..methods)
                .map(|method| captures().map(|centres| centres[method]).collect())
                .collect(),
        })
    }
}

/// The distances of positions in metres: every `stride`-th of the paper's.
pub fn positions(stride: usize) -> Vec<f64> {
    (0..POSITIONS)
        .step_by(stride)
        .map(|i| TABLE.0 + STEP * i as f64)
        .collect()
}
