//! Noise of the light's quanta.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::scene::random;

/// A pixel collects a whole number of electrons, which is Poisson distributed: of n on average with a
/// variance of n (EMVA standard 1288, section 2; J. R. Janesick, "Photon Transfer", SPIE 2007).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShotNoise {
    /// Electrons that make a count.
    pub electrons_per_count: f64,
}

impl ShotNoise {
    /// That of so many electrons a count.
    pub const fn of(electrons_per_count: f64) -> Self {
        Self {
            electrons_per_count,
        }
    }

    /// Scatters the light of a row, in counts.
    ///
    /// A pixel has random numbers of its own, whatever the light of the others: more light in one changes no
    /// other. Where [`random::BLOCK`] pixels side by side are unlit, none are drawn.
    pub fn apply(&self, light: &mut [f32], random: &mut ChaCha8Rng) {
        let electrons_per_count = self.electrons_per_count as f32;
        let counts_per_electron = (1.0 / self.electrons_per_count) as f32;
        for (block, light) in light.chunks_mut(random::BLOCK).enumerate() {
            if light.iter().all(|&light| light <= 0.0) {
                continue;
            }
            let words_before = 2 * block * random::BLOCK;
            random.set_word_pos(words_before as u128);
            let normals = random::normals(random);
            // As if all were bright, several at a time; then those that are not.
            let mut bright = [0.0; random::BLOCK];
            let mut all_are = true;
            for (bright, (light, normal)) in bright.iter_mut().zip(light.iter().zip(&normals)) {
                let mean = *light * electrons_per_count;
                *bright = many_electrons(mean, *normal) * counts_per_electron;
                all_are &= mean >= FEW;
            }
            if all_are {
                light.copy_from_slice(&bright[..light.len()]);
                continue;
            }
            let words = random::words(random);
            for (light, (bright, word)) in light.iter_mut().zip(bright.iter().zip(&words)) {
                let mean = *light * electrons_per_count;
                *light = if mean >= FEW {
                    *bright
                } else {
                    few_electrons(mean, *word) * counts_per_electron
                };
            }
        }
    }
}

/// Mean number of electrons from which the quantile comes from a normal number.
const FEW: f32 = 10.0;

/// The Poisson distribution's quantile where the normal distribution's is `normal`: its Cornish-Fisher
/// expansion to 1 / sqrt(mean) (M. B. Giles, "Algorithm 955: approximation of the inverse Poisson cumulative
/// distribution function", ACM Transactions on Mathematical Software 42, 2016, the normal approximation
/// Q_N2).
///
/// For a mean of 10, where it is worst, one number in 400 is one electron off, to either side; mean, variance
/// and skewness are right to 2e-6, 6e-5 and 2 % of their value, and better above. A plain normal number of
/// the same mean and variance would lack the skewness of 1 / sqrt(mean), 0.3 at a mean of 10 and 0.03 at
/// 1000. A centre would hardly tell: it weighs the flanks with opposite signs, and their third moments
/// cancel; a height adds them up.
fn many_electrons(mean: f32, normal: f32) -> f32 {
    let root = mean.sqrt();
    let squared = normal * normal;
    let third = normal * (-1.0 / 36.0 - squared * (1.0 / 72.0)) / root;
    let quantile = mean + root * normal + (1.0 / 3.0 + squared * (1.0 / 6.0)) + third;
    // Up to 2^24 electrons a whole number.
    quantile.max(0.0) as i32 as f32
}

/// The Poisson distribution's quantile at (word + 1/2) / 2^32, by its sum: exact.
fn few_electrons(mean: f32, word: u32) -> f32 {
    let share = (f64::from(word) + 0.5) / 4_294_967_296.0;
    let mean = f64::from(mean.max(0.0));
    // exp(-mean) is not less, and costs more.
    if share <= 1.0 - mean {
        return 0.0;
    }
    let mut probability = libm::exp(-mean);
    let mut sum = probability;
    let mut electrons = 0;
    while sum < share && electrons < MOST_OF_FEW {
        probability *= mean * RECIPROCALS[electrons];
        sum += probability;
        electrons += 1;
    }
    electrons as f32
}

/// Of a mean of 10, more have a chance of 1e-12, a hundredth of what is left above the largest word.
const MOST_OF_FEW: usize = 40;
/// 1, 1/2, 1/3 ...: a division takes longer than all else of a step.
const RECIPROCALS: [f64; MOST_OF_FEW] = {
    let mut reciprocals = [1.0; MOST_OF_FEW];
    let mut n = 1;
    while n < MOST_OF_FEW {
        reciprocals[n] = 1.0 / (n as f64 + 1.0);
        n += 1;
    }
    reciprocals
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::laser::normal_quantile;

    /// At each of many evenly spaced quantiles, against the sum.
    #[test]
    fn many_electrons_are_nearly_as_many_as_they_should_be() {
        const STEPS: u32 = 1 << 18;
        let (mut wrong, mut sum, mut squares) = (0, 0.0, 0.0);
        for step in 0..STEPS {
            let word = (step << 14) + (1 << 13);
            let share = (f64::from(word) + 0.5) / 4_294_967_296.0;
            let electrons = many_electrons(FEW, normal_quantile(share) as f32);
            let off = f64::from(electrons - few_electrons(FEW, word));
            assert!(off.abs() <= 1.0);
            wrong += u32::from(off != 0.0);
            sum += off;
            let from_mean = f64::from(electrons - FEW);
            squares += from_mean * from_mean - (from_mean - off).powi(2);
        }
        let steps = f64::from(STEPS);
        let (one_in, mean, variance) = (steps / f64::from(wrong), sum / steps, squares / steps);
        println!("one in {one_in:.0} is off; mean by {mean:.1e}, variance by {variance:.1e}");
        assert!(wrong * 400 <= STEPS);
        assert!(mean.abs() < 1e-4 && variance.abs() < 2e-3);
    }
}
