//! What the sensor is shown: a target at a distance, the spot's light on the row, and the noises that matter.
//!
//! An effect that a scene does not list is not computed and draws no random number. Each effect draws from a stream of
//! its own for each row, so that adding one changes no other, and a row is the same on any machine and in any order.

use phase_tables::gaussian;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Poisson, StandardNormal};
use slitrange::row::Geometry;
use slitrange::sensor_heads;

use crate::optics::Optics;

/// The laser's spot as the slit lets it through: a gaussian (eq. (5)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Sigma in pixels.
    pub width: f64,
    /// Height in counts a second of exposure.
    pub counts_per_second: f64,
}

/// Noise of the light's quanta: a pixel of n electrons scatters by sqrt(n).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotNoise {
    /// Electrons that make a count.
    pub electrons_per_count: f64,
}

/// Noise of the sensor's output and the converter, white and normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadNoise {
    /// Standard deviation in counts.
    pub counts: f64,
}

/// What a row is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Where light falls for a distance.
    pub optics: Optics,
    /// What the words of a row are.
    pub geometry: Geometry,
    /// Seed of every random stream.
    pub seed: u64,
    /// Counts of an unlit pixel.
    pub black_level: f64,
    /// The spot, where the laser is on.
    pub spot: Option<Spot>,
    /// Noise of the light.
    pub shot_noise: Option<ShotNoise>,
    /// Noise of the sensor.
    pub read_noise: Option<ReadNoise>,
}

/// Streams of random numbers, one an effect and row.
#[derive(Clone, Copy)]
enum Stream {
    ShotNoise,
    ReadNoise,
    Count,
}

impl Scene {
    /// White paper in a dim room, on the TCD1304DG: no ambient light, no speckle.
    ///
    /// The spot is that of a 1 mm laser spot through a 200 um slit 50 mm from the sensor: sigma 69 um, 8.6 pixels of 8 um. Ten
    /// electrons a count and four counts of noise are a TCD1304DG's 40 ke- full well and 0.6 mV noise of 0.6 V on 12 bits.
    pub fn white_paper() -> Self {
        Self {
            optics: Optics::nominal(),
            geometry: sensor_outputs(),
            seed: 1,
            black_level: 300.0,
            spot: Some(Spot {
                width: 8.6,
                counts_per_second: 350_000.0,
            }),
            shot_noise: Some(ShotNoise {
                electrons_per_count: 10.0,
            }),
            read_noise: Some(ReadNoise { counts: 4.0 }),
        }
    }

    fn random(&self, stream: Stream, row: u64) -> ChaCha8Rng {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(row * Stream::Count as u64 + stream as u64);
        random
    }

    /// The spot's height in counts after an exposure in seconds.
    pub fn amplitude(&self, exposure: f64) -> f64 {
        self.spot
            .map_or(0.0, |spot| spot.counts_per_second * exposure)
    }

    /// The pixels' outputs, light positive, in counts before rounding, for a target at `distance` metres, after
    /// `exposure` seconds: `geometry.words` values, in the order in which the words of `geometry` are read. `row`
    /// counts the rows and selects the random numbers.
    pub fn row(&self, row: u64, distance: f64, exposure: f64) -> Vec<f32> {
        self.row_with_centre(row, self.optics.centre(distance), exposure)
    }

    /// The same for a spot whose centre is given, in pixels of the light range.
    pub fn row_with_centre(&self, row: u64, centre: f64, exposure: f64) -> Vec<f32> {
        let mut counts = vec![self.black_level as f32; self.geometry.words];
        if let Some(spot) = self.spot {
            let light = &mut counts[self.geometry.light.clone()];
            let amplitude = self.amplitude(exposure);
            // Beyond seven sigma a full-scale spot is a millionth of a count.
            let from = (centre - 7.0 * spot.width - 1.0)
                .floor()
                .clamp(0.0, light.len() as f64) as usize;
            let to = (centre + 7.0 * spot.width + 2.0)
                .ceil()
                .clamp(0.0, light.len() as f64) as usize;
            let mut random = self
                .shot_noise
                .map(|shot| (shot, self.random(Stream::ShotNoise, row)));
            for (i, count) in light.iter_mut().enumerate().take(to).skip(from) {
                let signal = amplitude * gaussian(i as f64 - centre, spot.width);
                *count += match &mut random {
                    Some((shot, random)) => {
                        with_shot_noise(signal, shot.electrons_per_count, random)
                    }
                    None => signal,
                } as f32;
            }
        }
        if let Some(ReadNoise { counts: deviation }) = self.read_noise {
            let mut random = self.random(Stream::ReadNoise, row);
            for count in &mut counts {
                let normal: f32 = StandardNormal.sample(&mut random);
                *count += deviation as f32 * normal;
            }
        }
        counts
    }
}

/// Counts of light with the scatter of its electrons.
pub(crate) fn with_shot_noise(
    counts: f64,
    electrons_per_count: f64,
    random: &mut ChaCha8Rng,
) -> f64 {
    // `Poisson::new` refuses a mean of zero, which needs no random number.
    Poisson::new(counts * electrons_per_count).map_or(0.0, |electrons| electrons.sample(random))
        / electrons_per_count
}

/// The TCD1304DG's outputs as it numbers them: the driver's words without their lead-in.
pub fn sensor_outputs() -> Geometry {
    let words = sensor_heads::tcd1304dg();
    let without_lead_in = |range: std::ops::Range<usize>| {
        range.start - sensor_heads::TCD1304DG_LEAD_IN..range.end - sensor_heads::TCD1304DG_LEAD_IN
    };
    Geometry {
        shielded: without_lead_in(words.shielded.clone()),
        light: without_lead_in(words.light.clone()),
        ..words
    }
}

/// Rounds to whole counts of the converter.
pub fn quantise(counts: &[f32], full_scale: u16) -> Vec<u16> {
    counts
        .iter()
        .map(|count| count.round().clamp(0.0, f32::from(full_scale)) as u16)
        .collect()
}
