//! One material through one aperture: training, acquisition, judgement.

use crate::paper::apparatus::{Aperture, CAPTURES};
use crate::paper::data_set::{self, DataSet, JUDGED};
use crate::paper::errors::{self, Judged};
use crate::paper::methods::Method;
use crate::paper::reference::{self, Difference};
use crate::paper::training;

/// What is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Experiment {
    /// Of the paper's positions, every so many.
    pub stride: usize,
    /// Seed of everything.
    pub seed: u64,
}

/// What came of a material and an aperture.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Index of the material in [`MATERIALS`](crate::paper::materials::MATERIALS).
    pub material: usize,
    /// Lens or slit.
    pub aperture: Aperture,
    /// The captures' true distances in metres.
    pub distances: Vec<f64>,
    /// For each capture, the centre by the paper's method, in pixels.
    pub centres: Vec<f64>,
    /// What the methods make of them.
    pub judged: Vec<Judged>,
    /// Every method's MAE in metres on the pieces of material that were trained on: by these, and not by the piece that they are
    /// judged on, the best is chosen.
    pub trained: Vec<(Method, f64)>,
    /// The core beside the paper's fits in f64, for the slit.
    pub reference: Option<Difference>,
}

/// Positions for the comparison with fits in f64, which take 30 times as long.
const REFERENCES: usize = 16;

impl Experiment {
    /// Positions that one [`run`](Self::run) goes through.
    pub fn positions(&self) -> usize {
        data_set::positions(self.stride).len() + training::positions()
    }

    /// Runs a material and an aperture on all cores. `done` is called after each position.
    ///
    /// # Errors
    /// Centres that eq. (1) does not fit.
    pub fn run(
        &self,
        material: usize,
        aperture: Aperture,
        done: &(dyn Fn() + Sync),
    ) -> anyhow::Result<Outcome> {
        let training_sets = training::data_sets(material, aperture, self.seed);
        let measured = match aperture {
            Aperture::Slit => Some(training::measured_tables(&training_sets[0])?),
            Aperture::Lens => None,
        };
        let set = DataSet {
            material,
            aperture,
            seed: self.seed,
            piece: JUDGED,
            distances: data_set::positions(self.stride),
            captures: CAPTURES,
        };
        training::with_tables(measured.as_deref(), |tables| {
            let trained = training::train(&training_sets, tables, done)?;
            let centres = set.measure(tables, done)?;
            let reference = (aperture == Aperture::Slit)
                .then(|| reference::compare(&set, tables, set.distances.len().div_ceil(REFERENCES)))
                .transpose()?;
            Ok(Outcome {
                material,
                aperture,
                judged: errors::judge(aperture, &centres, &trained.residuals)?,
                trained: trained.mae,
                centres: centres.of_methods[0].clone(),
                distances: centres.distances,
                reference,
            })
        })
    }
}
