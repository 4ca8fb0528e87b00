//! A data set: one material, one aperture, all positions of the table, and the centres that every method finds.

use rayon::prelude::*;

use crate::paper::apparatus::{Aperture, BASELINE, LASER, TABLE, WANDER};
use crate::paper::lens_path;
use crate::paper::materials::MATERIALS;
use crate::paper::slit_path::{self, RowTables};
use crate::paper::stub_field::{Surface, View};

/// What is acquired.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSet {
    /// Index of the material in [`MATERIALS`].
    pub material: usize,
    /// Lens or slit.
    pub aperture: Aperture,
    /// Which piece of the material is measured: its scatterers and the noise of its captures.
    pub surface: Piece,
    /// Distances of the positions in metres.
    pub distances: Vec<f64>,
    /// Captures at each.
    pub captures: usize,
}

/// A piece of material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Seed of the experiment.
    pub seed: u64,
    /// Which of the material's pieces.
    pub number: u64,
}

/// The piece that is judged; those after it are trained on.
pub const JUDGED: u64 = 0;

/// What every method found: for each capture its distance in metres, and for each method and capture the centre in pixels, which is
/// not a number where there is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Centres {
    /// The captures' true distances.
    pub distances: Vec<f64>,
    /// For each of [`CentreMethod::all`](crate::paper::methods::CentreMethod::all) all captures.
    pub of_methods: Vec<Vec<f64>>,
}

impl Centres {
    /// Adds the captures of another data set.
    pub fn append(&mut self, mut other: Self) {
        self.distances.append(&mut other.distances);
        if self.of_methods.is_empty() {
            self.of_methods = other.of_methods;
        } else {
            for (all, more) in self.of_methods.iter_mut().zip(&mut other.of_methods) {
                all.append(more);
            }
        }
    }
}

impl DataSet {
    /// The surface that is looked at: the same for the lens and the slit.
    pub fn surface(&self) -> Surface {
        let seed = self.surface.seed ^ (self.material as u64) << 48 ^ self.surface.number << 32;
        Surface::new(&LASER, &MATERIALS[self.material].scattering(), seed)
    }

    /// Seed of the noise: other for every data set.
    pub fn noise_seed(&self) -> u64 {
        let aperture = match self.aperture {
            Aperture::Slit => 1,
            Aperture::Lens => 2,
        };
        !self.surface.seed ^ (self.material as u64) << 48 ^ self.surface.number << 32 ^ aperture << 60
    }

    /// What is seen at a distance.
    pub fn view(&self, distance: f64) -> View {
        View {
            distance,
            baseline: BASELINE,
            lateral: WANDER * (distance - TABLE.0),
        }
    }

    /// Acquires and measures, on all cores. `tables` are those of the slit's rows. `done` is called after each position.
    pub fn measure(&self, tables: &RowTables<'_>, done: &(dyn Fn() + Sync)) -> Centres {
        let surface = self.surface();
        let of_position = |(position, &distance): (usize, &f64)| {
            let centres = match self.aperture {
                Aperture::Slit => slit_path::centres(self, &surface, tables, position, distance),
                Aperture::Lens => lens_path::centres(self, &surface, position, distance),
            };
            done();
            centres
        };
        // In the order of the positions, whichever thread does them.
        let of_positions: Vec<Vec<Vec<f64>>> = self
            .distances
            .par_iter()
            .enumerate()
            .map(of_position)
            .collect();
        let methods = of_positions
            .first()
            .and_then(|captures| captures.first())
            .map_or(0, Vec::len);
        let of_method = |method: usize| {
            let captures = of_positions.iter().flatten();
            captures.map(|centres| centres[method]).collect()
        };
        Centres {
            distances: self
                .distances
                .iter()
                .flat_map(|&distance| vec![distance; self.captures])
                .collect(),
            of_methods: (0..methods).map(of_method).collect(),
        }
    }
}

/// The distances of positions in metres: every `stride`-th of the paper's.
pub fn positions(stride: usize) -> Vec<f64> {
    use crate::paper::apparatus::{POSITIONS, STEP};
    (0..POSITIONS)
        .step_by(stride)
        .map(|i| TABLE.0 + STEP * i as f64)
        .collect()
}
