//! The sensor of this judge: from light on pixels to the converter's words.

use crate::second_judge::{Rng, log_even};
use rand::Rng as _;
use rand_distr::{Distribution as _, Poisson, StandardNormal};
use slitrange::row::{Geometry, Polarity};

/// Words before the shielded pixels, and after the light.
const LEAD: usize = 18;
const TAIL: usize = 8;
/// Shielded pixels, and pixels half in the light between those and the light range, as a TCD1304DG has them.
const SHIELDED: usize = 13;
const TRANSITION: usize = 3;
/// The largest count of the 12-bit converter.
pub const FULL_SCALE: f64 = 4095.0;

/// A line sensor with its front end.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    /// Pixels that see light.
    pub pixels: usize,
    /// The count of an unlit pixel.
    pub black: f64,
    /// Standard deviation of the noise of each read-out, in counts.
    pub read_noise: f64,
    /// Electrons in a count.
    pub electrons: f64,
    /// Whether words fall with light.
    pub is_falling: bool,
}

impl Sensor {
    /// A sensor with noise as line sensors have it: 4 to 20 electrons a count, read noise of 0.8 to 4 counts.
    pub fn draw(random: &mut Rng) -> Self {
        Self {
            pixels: 640,
            black: random.random_range(60.0..240.0),
            read_noise: log_even(random, 0.8, 4.0),
            electrons: log_even(random, 4.0, 20.0),
            is_falling: random.random_bool(0.7),
        }
    }

    /// What the firmware knows of it.
    pub fn geometry(&self) -> Geometry {
        let light = LEAD + SHIELDED + TRANSITION;
        Geometry {
            words: light + self.pixels + TAIL,
            shielded: LEAD..LEAD + SHIELDED,
            light: light..light + self.pixels,
            polarity: if self.is_falling {
                Polarity::Falling
            } else {
                Polarity::Rising
            },
            bits: 12,
            shot_variance_per_count_q16: (65536.0 / self.electrons).round() as u16,
            saturation: slitrange::row::LARGEST_COUNT,
        }
    }

    /// The highest spot that stays below full scale with all its noise, above the black level.
    pub fn room(&self) -> f64 {
        let bright = FULL_SCALE / self.electrons + self.read_noise * self.read_noise;
        FULL_SCALE - self.black - 5.0 * bright.sqrt()
    }

    /// Turns light in counts to charge in counts: whole electrons, with shot noise.
    pub fn expose(&self, light: &mut [f64], random: &mut Rng) {
        for pixel in light {
            let expected = *pixel * self.electrons;
            if expected > 0.0 {
                *pixel = electrons(expected, random) / self.electrons;
            }
        }
    }

    /// Adds the black level and the read noise.
    pub fn amplify(&self, charge: &mut [f64], random: &mut Rng) {
        for pixel in charge {
            let normal: f64 = StandardNormal.sample(random);
            *pixel += self.black + self.read_noise * normal;
        }
    }

    /// The words of a read-out with these voltages, in counts, and with these counts of the unlit words.
    pub fn words(&self, light: &[u16], random: &mut Rng) -> Vec<u16> {
        let mut dark = |count: usize| -> Vec<u16> {
            let mut dark = vec![0.0; count];
            self.amplify(&mut dark, random);
            dark.into_iter().map(convert).collect()
        };
        let before = dark(LEAD + SHIELDED + TRANSITION);
        let mut words = [&before, light, &dark(TAIL)].concat();
        if self.is_falling {
            words
                .iter_mut()
                .for_each(|word| *word = FULL_SCALE as u16 - *word);
        }
        words
    }
}

/// What the converter makes of a voltage in counts.
pub fn convert(volts: f64) -> u16 {
    volts.round().clamp(0.0, FULL_SCALE) as u16
}

/// Poisson-distributed electrons. From 60 on, a normal deviate with the Poisson distribution's skewness
/// (Cornish and Fisher's first term) is as good to 0.1 electrons.
fn electrons(expected: f64, random: &mut Rng) -> f64 {
    if expected < 60.0 {
        return Poisson::new(expected).map_or(0.0, |poisson| poisson.sample(random));
    }
    let normal: f64 = StandardNormal.sample(random);
    (expected + expected.sqrt() * normal + (normal * normal - 1.0) / 6.0).round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;

    #[test]
    fn electrons_scatter_by_the_square_root_of_their_number() {
        let mut random = Rng::seed_from_u64(1);
        for expected in [3.0, 61.0, 5000.0] {
            let count = 20_000;
            let drawn = (0..count).map(|_| electrons(expected, &mut random));
            let drawn: Vec<f64> = drawn.collect();
            let (mean, variance) = (statistics::mean(&drawn), statistics::variance(&drawn));
            // Five standard deviations of the mean; of the variance, five times sqrt(2 / count) is 5 %.
            assert!((mean - expected).abs() < 5.0 * (expected / f64::from(count)).sqrt());
            assert!((variance / expected - 1.0).abs() < 0.06);
        }
    }
}
