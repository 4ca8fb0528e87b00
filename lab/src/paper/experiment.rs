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
    /// Pieces of each material to train on, two at least: [`training::PIECES`].
    pub pieces: u64,
}

/// What came of a material and an aperture.
#[derive(Clone, Debug, PartialEq)]
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
    /// Every method's MAE in metres on the pieces of material that were trained on: by these, and not by the
    /// piece that they are judged on, the best is chosen.
    pub trained: Vec<(Method, f64)>,
    /// The core beside the paper's fits in f64, for the slit.
    pub reference: Option<Difference>,
}

/// Positions for the comparison with fits in f64, which take 30 times as long.
const REFERENCES: usize = 16;

impl Experiment {
    /// Positions that one [`run`](Self::run) goes through.
    pub fn positions(&self) -> usize {
        let training = training::data_sets(0, Aperture::Slit, self.seed, self.pieces);
        let training: usize = training.iter().map(|set| set.distances.len()).sum();
        data_set::positions(self.stride).len() + training
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
        let training_sets = training::data_sets(material, aperture, self.seed, self.pieces);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A small experiment gives the same bits on one thread and on two. Its errors come from speckle, so
    /// their mean is between a tenth and the whole of the distance that a pixel stands for (176 to 442 um).
    /// Fits in f64 find the same centres.
    #[test]
    fn a_small_experiment_is_plausible_and_does_not_depend_on_threads() {
        let experiment = Experiment {
            stride: 840,
            seed: 7,
            pieces: 2,
        };
        for aperture in Aperture::ALL {
            let [one, two] = [1, 2].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let run = || experiment.run(0, aperture, &|| {});
                pool.expect("threads").install(run).expect("an outcome")
            });
            assert!(one == two, "{}", aperture.name());
            assert_eq!(one.distances.len(), 20 * CAPTURES);
            for judged in &one.judged {
                println!(
                    "{} {}: MAE {:.1} um, MAX {:.1} um",
                    aperture.name(),
                    judged.method.name(),
                    judged.mae * 1e6,
                    judged.max * 1e6
                );
                assert_eq!(judged.without_centre, 0);
                assert!((30e-6..300e-6).contains(&judged.mae) && judged.max > judged.mae);
                // D and K of the apparatus: -b/t, and b f (1 + t^2)/t^2 in pixels.
                assert!((judged.fit.curve.d + 0.3 / 2.6).abs() < 0.03);
            }
            if let Some(difference) = one.reference {
                println!("{difference:?}");
                assert!(difference.gaussian < 0.1 && difference.fraunhofer < 0.3);
            }
        }
    }
}
