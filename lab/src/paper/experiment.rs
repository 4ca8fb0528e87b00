//! One material through one aperture: acquisition, judgement.

use anyhow::Context as _;

use crate::paper::apparatus::Aperture;
use crate::paper::data_set::{self, DataSet};
use crate::paper::errors::{self, Judged};
use crate::paper::methods::Method;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Experiment {
    /// Of the paper's positions, every so many.
    pub stride: usize,
    pub seed: u64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Index of the material in [`MATERIALS`](crate::paper::materials::MATERIALS).
    pub material: usize,
    pub aperture: Aperture,
    /// The captures' true distances in metres.
    pub distances: Vec<f64>,
    /// For each capture, the centre by the paper's method, in pixels.
    pub centres: Vec<f64>,
    /// For each of [`Method::of`] the aperture.
    pub judged: Vec<Judged>,
}

impl Outcome {
    pub fn of(&self, method: Method) -> &Judged {
        let mut judged = Method::of(self.aperture).iter().zip(&self.judged);
        let judged = judged.find(|(judged, _)| **judged == method);
        judged.expect("every method is judged").1
    }
}

impl Experiment {
    fn data_set(&self, material: usize, aperture: Aperture) -> DataSet {
        DataSet {
            material,
            aperture,
            seed: self.seed,
            distances: data_set::positions(self.stride),
        }
    }

    /// Runs a material and an aperture on all cores. `done` is called after each position.
    pub fn run(
        &self,
        material: usize,
        aperture: Aperture,
        done: &(dyn Fn() + Sync),
    ) -> anyhow::Result<Outcome> {
        let centres = self.data_set(material, aperture).measure(done)?;
        Ok(Outcome {
            material,
            aperture,
            judged: (Method::of(aperture).iter().zip(&centres.of_methods))
                .map(|(method, found)| {
                    let judged = errors::judge(&centres.distances, found);
                    judged.with_context(|| format!("{method:?}"))
                })
                .collect::<anyhow::Result<_>>()?,
            centres: centres.of_methods[0].clone(),
            distances: centres.distances,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::apparatus::CAPTURES;
    use crate::paper::reference;

    /// A small experiment gives the same bits on one thread and on two. Its errors come from speckle, so
    /// their mean is between a tenth and the whole of the distance that a pixel stands for (176 to 442 um).
    /// Fits in f64 find the same centres.
    #[test]
    fn a_small_experiment_is_plausible_and_does_not_depend_on_threads() {
        let experiment = Experiment {
            stride: 840,
            seed: 7,
        };
        for aperture in Aperture::ALL {
            let [one, two] = [1, 2].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let run = || experiment.run(0, aperture, &|| {});
                pool.expect("threads").install(run).expect("an outcome")
            });
            assert!(one == two, "{}", aperture.name());
            assert_eq!(one.distances.len(), 20 * CAPTURES);
            for (method, judged) in Method::of(aperture).iter().zip(&one.judged) {
                let [mae, max] = [judged.mae, judged.max].map(|metres| metres * 1e6);
                println!("{method:?}: MAE {mae:.1} um, MAX {max:.1} um");
                assert_eq!(judged.without_centre, 0);
                assert!((30e-6..300e-6).contains(&judged.mae) && judged.max > judged.mae);
                // D and K of the apparatus: -b/t, and b f (1 + t^2)/t^2 in pixels.
                assert!((judged.fit.curve.d + 0.3 / 2.6).abs() < 0.03);
            }
        }
        let set = experiment.data_set(0, Aperture::Slit);
        let [gaussian, fraunhofer] = reference::compare(&set).expect("centres");
        println!("core less reference: gaussian {gaussian}, Fraunhofer {fraunhofer}");
        assert!(gaussian < 0.1 && fraunhofer < 0.3);
    }
}
