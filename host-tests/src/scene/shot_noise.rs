//! Noise of the light's quanta.

use rand::Rng;
use rand_distr::{Distribution as _, Poisson};
use serde::{Deserialize, Serialize};

/// A pixel of n electrons scatters by sqrt(n) (Poisson).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShotNoise {
    /// Electrons that make a count.
    pub electrons_per_count: f64,
}

impl ShotNoise {
    /// Scatters the light of a row, in counts. Unlit pixels draw no number.
    pub fn apply(&self, light: &mut [f32], random: &mut impl Rng) {
        for light in light {
            // `Poisson::new` refuses a mean of zero.
            if let Ok(electrons) = Poisson::new(f64::from(*light) * self.electrons_per_count) {
                *light = (electrons.sample(random) / self.electrons_per_count) as f32;
            }
        }
    }
}
