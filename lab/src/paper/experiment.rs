//! One material through one aperture: training, acquisition, judgement.

use crate::paper::apparatus::{Aperture, CAPTURES};
use crate::paper::data_set::{self, DataSet, JUDGED};
use crate::paper::errors::{self, Judged};
use crate::paper::methods::Method;
use crate::paper::training;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Experiment {
    /// Of the paper's positions, every so many.
    pub stride: usize,
    pub seed: u64,
    /// Pieces of each material to train on, two at least: [`training::PIECES`].
    pub pieces: u64,
}

/// What came of a material and an aperture.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Index of the material in [`MATERIALS`](crate::paper::materials::MATERIALS).
    pub material: usize,
    pub aperture: Aperture,
    /// The captures' true distances in metres.
    pub distances: Vec<f64>,
    /// For each capture, the centre by the paper's method, in pixels.
    pub centres: Vec<f64>,
    pub judged: Vec<Judged>,
    /// Every method's MAE in metres on the pieces of material that were trained on: by these, and not by the
    /// piece that they are judged on, the best is chosen.
    pub trained: Vec<(Method, f64)>,
}

impl Outcome {
    /// What a method makes of the data set.
    pub fn of(&self, method: &Method) -> &Judged {
        let judged = self.judged.iter().find(|judged| judged.method == *method);
        judged.expect("every method is judged")
    }
}

impl Experiment {
    /// Positions that one [`run`](Self::run) goes through.
    pub fn positions(&self) -> usize {
        let training = training::data_sets(0, Aperture::Slit, self.seed, self.pieces);
        let training: usize = training.iter().map(|set| set.distances.len()).sum();
        data_set::positions(self.stride).len() + training
    }

    /// The data set that methods are judged on.
    fn judged(&self, material: usize, aperture: Aperture) -> DataSet {
        DataSet {
            material,
            aperture,
            seed: self.seed,
            piece: JUDGED,
            distances: data_set::positions(self.stride),
            captures: CAPTURES,
        }
    }

    /// Runs a material and an aperture on all cores. `done` is called after each position.
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
        let set = self.judged(material, aperture);
        training::with_tables(measured.as_deref(), |tables| {
            let trained = training::train(&training_sets, tables, done)?;
            let centres = set.measure(tables, done)?;
            Ok(Outcome {
                material,
                aperture,
                judged: errors::judge(aperture, &centres, &trained.residuals)?,
                trained: trained.mae,
                centres: centres.of_methods[0].clone(),
                distances: centres.distances,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::reference;
    use crate::paper::slit_path::RowTables;

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
        }
        let set = experiment.judged(0, Aperture::Slit);
        let compare = |tables: &RowTables<'_>| reference::compare(&set, tables);
        let [gaussian, fraunhofer] = training::with_tables(None, compare).expect("centres");
        println!("core less reference: gaussian {gaussian}, Fraunhofer {fraunhofer}");
        assert!(gaussian < 0.1 && fraunhofer < 0.3);
    }
}
