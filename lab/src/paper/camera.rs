//! The paper's camera, as far as a spot of light is concerned: a Sentech STC-MBS231U3V with Sony's sensor
//! IMX249.

use crate::prelude::*;

/// Pitch of the pixels in metres: 1920 of them on 11.3 mm.
pub const PITCH: f64 = 5.86e-6;

pub const COLUMNS: usize = 1920;

/// Rows that are read out, of the 1200 that there are: the middle ones.
pub const ROWS: usize = 600;

/// The largest count of its 12 bits.
pub const FULL_SCALE: u16 = 4095;

/// Electrons that make a count. The pixel is that of the IMX174, for which Point Grey's white paper "Sony
/// Pregius global shutter CMOS imaging performance" (2015) gives 32,691 electrons at saturation by EMVA 1288:
/// 8.0 of them a count, where 12 bits hold them all.
pub const ELECTRONS_PER_COUNT: f64 = 8.0;

/// Read noise in counts: 6.83 electrons, from the same source.
pub const READ_NOISE: f64 = 6.83 / ELECTRONS_PER_COUNT;

/// What an unlit pixel reads, in counts (the paper's black threshold). Chosen: the value that Sony's 12-bit
/// sensors come with. No method depends on it, as long as noise does not reach zero.
pub const BLACK_LEVEL: f64 = 240.0;

/// The mean peak of a data set's images in counts: a quarter of full scale, because the peaks of speckle are
/// several times its mean.
pub const PEAK: f64 = 0.25 * FULL_SCALE as f64;

/// The variance of the shot noise for each count of light, in counts squared, Q0.16, for the core.
pub const SHOT_VARIANCE_PER_COUNT_Q16: u16 = (65536.0 / ELECTRONS_PER_COUNT) as u16;

/// The light of a scene on the pixels, ready for captures.
#[derive(Clone, Debug, Default)]
pub struct Exposure {
    /// Counts of a pixel before noise, and a half, so that cutting off the fraction rounds.
    mean: Vec<f32>,
    /// Standard deviation of its noise in counts.
    deviation: Vec<f32>,
}

impl Exposure {
    /// Exposes pixels to light, in counts above the black level.
    ///
    /// A pixel of n electrons has the variance n + read noise^2 and is taken for normal. The skewness of a
    /// Poisson variable and a normal one together is n/(n + 6.83^2)^1.5, which is at most 0.06 (n = 93): no
    /// mean of 50 electrons or more, where one usually takes a Poisson variable for normal, is needed beside
    /// such a read noise.
    pub fn new(light: impl ExactSizeIterator<Item = f32>) -> Self {
        let mut exposure = Self {
            mean: Vec::with_capacity(light.len()),
            deviation: Vec::with_capacity(light.len()),
        };
        let read = (READ_NOISE * READ_NOISE) as f32;
        for light in light {
            exposure.mean.push(BLACK_LEVEL as f32 + 0.5 + light);
            let shot = light * (1.0 / ELECTRONS_PER_COUNT) as f32;
            exposure.deviation.push((read + shot).sqrt());
        }
        exposure
    }

    /// A capture: the light with noise of its own, in counts of 12 bits.
    pub fn capture(&self, random: &mut ChaCha8Rng, counts: &mut Vec<u16>) {
        counts.clear();
        let pixels = self.mean.iter().zip(&self.deviation);
        counts.extend(pixels.map(|(mean, deviation)| {
            let normal: f32 = StandardNormal.sample(random);
            // `as` cuts off the fraction, and saturates below zero.
            (mean + deviation * normal).min(f32::from(FULL_SCALE)) as u16
        }));
    }
}

/// The random numbers of a capture's noise: a stream of its own for each.
pub fn noise(seed: u64, position: u64, capture: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(position << 16 | capture);
    random
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A capture of pixels in this light.
    fn captured(light: &[f32], position: u64, capture: u64) -> Vec<u16> {
        let mut counts = vec![];
        let exposure = Exposure::new(light.iter().copied());
        exposure.capture(&mut noise(3, position, capture), &mut counts);
        counts
    }

    /// Mean and variance of a pixel come from Poisson's electrons, the read noise and the rounding.
    #[test]
    fn noise_is_that_of_the_sensor() {
        const PIXELS: usize = 200_000;
        for light in [0.0, 10.0, 1000.0] {
            let counts = captured(&[light as f32; PIXELS], 7, 1);
            let n = PIXELS as f64;
            let counts: Vec<f64> = counts.into_iter().map(f64::from).collect();
            let (mean, variance) = (statistics::mean(&counts), statistics::variance(&counts));
            let expected = light / ELECTRONS_PER_COUNT + READ_NOISE * READ_NOISE + 1.0 / 12.0;
            println!("{light}: {mean:.3}, {variance:.3} against {expected:.3}");
            // Five standard deviations of the mean and of the variance, which is normal: sqrt(2/n).
            assert!((mean - BLACK_LEVEL - light).abs() < 5.0 * (expected / n).sqrt());
            assert!((variance / expected - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        }
    }

    #[test]
    fn light_beyond_full_scale_is_cut_off() {
        assert_eq!(captured(&[9000.0; 10], 7, 1), [FULL_SCALE; 10]);
    }

    #[test]
    fn every_capture_has_noise_of_its_own() {
        let of = |position, capture| captured(&[100.0; 50], position, capture);
        assert_eq!(of(4, 1), of(4, 1));
        assert!(of(4, 1) != of(4, 2) && of(4, 1) != of(5, 1));
    }
}
