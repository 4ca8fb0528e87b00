//! What a hard row is made of: a spot, its noise, and what is wrong with them.

use crate::hard_cases::flaw::{Flaw, Stage};
use crate::hard_cases::shape::Shape;
use crate::hard_cases::truth::Truth;
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use simulator::scene::{Effect, ReadNoise, Sensor, ShotNoise, quantise, random};
use simulator::with;
use slitrange::row::Geometry;

/// A row, and what a perfect reader would say of it.
#[derive(Clone, Debug)]
pub struct HardRow {
    /// Counts, light positive.
    pub light: Vec<u16>,
    /// The sensor's.
    pub geometry: Geometry,
    /// Where the spot is.
    pub truth: Truth,
}

/// A spot, its noise, and its flaws: rows by number.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Pixels of the row.
    pub pixels: usize,
    /// The laser's spot; where there is none, no centre is right.
    pub spot: Option<Spot>,
    /// Counts of an unlit pixel.
    pub black_level: f64,
    /// Standard deviation of the read noise in counts.
    pub read_noise: f64,
    /// Electrons a count, where light has shot noise.
    pub electrons_per_count: Option<f64>,
    /// The count from which the sensor's geometry says that a pixel is saturated.
    pub saturation: u16,
    /// What is wrong. Each is done at its [`Stage`], and within a stage in this order.
    pub flaws: Vec<Flaw>,
}

/// The laser's spot on a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Its profile.
    pub shape: Shape,
    /// Sigma in pixels, of the gaussian that fits the profile best.
    pub width: f64,
    /// Height in counts.
    pub amplitude: f64,
    /// Where on the row.
    pub place: Place,
}

/// Where a spot is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// Within 32 pixels of the row's middle, each row elsewhere.
    Middle,
    /// So many widths from the row's first pixel, to half a pixel.
    FromStart(f64),
    /// So many widths from the row's last pixel, to half a pixel.
    FromEnd(f64),
    /// At this place in pixels in all rows.
    At(f64),
}

/// The golden section less one: its multiples fill an interval evenly, however many there are.
const GOLDEN: f64 = 0.618_033_988_749_895;

impl Recipe {
    /// The spot that most cases start from: what the core is tuned for, and what its accuracy is quoted for.
    pub fn clean(width: f64) -> Self {
        Self {
            pixels: 512,
            spot: Some(Spot {
                shape: Shape::Gaussian,
                width,
                amplitude: 2000.0,
                place: Place::Middle,
            }),
            black_level: 300.0,
            read_noise: 2.0,
            electrons_per_count: Some(5.0),
            saturation: slitrange::row::LARGEST_COUNT,
            flaws: vec![],
        }
    }

    /// Noise on a black level.
    pub fn dark() -> Self {
        with(Self::clean(1.0), |it| it.spot = None)
    }

    /// With one flaw more.
    pub fn with(mut self, flaw: Flaw) -> Self {
        self.flaws.push(flaw);
        self
    }

    /// With unlit pixels of so many counts.
    pub fn on_level(self, black_level: f64) -> Self {
        with(self, |it| it.black_level = black_level)
    }

    /// With pixels that are full at this count of a row, black level included. `is_known` says whether the
    /// geometry states it. It then states four sigma of the read noise less, which comes after the well.
    pub fn with_well(self, count: u16, is_known: bool) -> Self {
        let noise = (4.0 * self.read_noise).ceil() as u16;
        let well = Flaw::FullWell(f64::from(count) - self.black_level, 0.0);
        Self {
            saturation: if is_known {
                count.saturating_sub(noise)
            } else {
                self.saturation
            },
            ..self.with(well)
        }
    }

    /// With the spot changed.
    ///
    /// # Panics
    /// There is none.
    pub fn spot(mut self, change: impl FnOnce(&mut Spot)) -> Self {
        change(self.spot.as_mut().expect("a recipe with a spot"));
        self
    }

    /// The sensor's geometry.
    pub fn geometry(&self) -> Geometry {
        Geometry {
            // A count of n electrons has the variance of 1/n.
            shot_variance_per_count_q16: self
                .electrons_per_count
                .map_or(0, |electrons| (65536.0 / electrons).round() as u16),
            saturation: self.saturation,
            ..Sensor::Row(self.pixels).geometry()
        }
    }

    /// Where the spot of a row is, in pixels.
    pub fn centre(&self, number: u64) -> Option<f64> {
        let spot = self.spot?;
        let last = self.pixels as f64 - 1.0;
        let phase = ((number as f64 + 0.5) * GOLDEN).fract() - 0.5;
        Some(match spot.place {
            Place::Middle => {
                let steps = (((number as f64 + 0.5) * 7.0 * GOLDEN).fract() * 64.0).floor() - 32.0;
                (0.5 * last).round() + steps + phase
            }
            Place::FromStart(widths) => widths * spot.width + phase,
            Place::FromEnd(widths) => last - widths * spot.width + phase,
            Place::At(centre) => centre,
        })
    }

    /// A row.
    pub fn row(&self, seed: u64, number: u64) -> HardRow {
        let centre = self.centre(number);
        let scene = Site {
            centre,
            spot: self.spot,
            pixels: self.pixels,
        };
        // The flaws' random numbers: a stream that noise does not use.
        let mut random = random::of_row(seed, Effect::HotPixels, number);
        let mut counts = vec![0.0f32; self.pixels];
        if let (Some(spot), Some(centre)) = (&self.spot, centre) {
            for (i, count) in counts.iter_mut().enumerate() {
                *count = (spot.amplitude * spot.shape.at(i as f64 - centre, spot.width)) as f32;
            }
        }
        self.apply(Stage::Light, &mut counts, &scene, &mut random);
        if let Some(electrons_per_count) = self.electrons_per_count {
            let mut noise = random::of_row(seed, Effect::ShotNoise, number);
            ShotNoise::of(electrons_per_count).apply(&mut counts, &mut noise);
        }
        self.apply(Stage::Charge, &mut counts, &scene, &mut random);
        let level = self.black_level as f32;
        counts.iter_mut().for_each(|count| *count += level);
        let mut noise = random::of_row(seed, Effect::ReadNoise, number);
        ReadNoise {
            counts: self.read_noise,
        }
        .apply(&mut counts, &mut noise);
        self.apply(Stage::Volts, &mut counts, &scene, &mut random);
        let mut light = quantise(&counts, slitrange::row::LARGEST_COUNT);
        for flaw in &self.flaws {
            flaw.to_words(&mut light);
        }
        HardRow {
            light,
            geometry: self.geometry(),
            truth: self.truth(number),
        }
    }

    fn apply(&self, stage: Stage, counts: &mut [f32], site: &Site, random: &mut ChaCha8Rng) {
        for flaw in self.flaws.iter().filter(|flaw| flaw.stage() == stage) {
            flaw.apply(counts, site, random);
        }
    }

    /// The share of the spot's height that is not cut off by a full well or at full scale.
    fn seen(&self, spot: &Spot) -> f64 {
        let full_scale = f64::from(slitrange::row::LARGEST_COUNT) - self.black_level;
        let full = (self.flaws.iter()).fold(full_scale, |full, flaw| full.min(flaw.full_well()));
        (full / spot.amplitude).clamp(0.01, 1.0)
    }

    /// Where a perfect reader would say that the spot of a row is.
    pub fn truth(&self, number: u64) -> Truth {
        let (Some(spot), Some(centre)) = (self.spot, self.centre(number)) else {
            return Truth::None;
        };
        let of_shape = Truth::Centre(centre)
            .reaching(centre + spot.shape.centroid() * spot.width)
            .reaching(centre + spot.shape.middle_at(0.5 * self.seen(&spot)) * spot.width);
        self.flaws.iter().fold(of_shape, |truth, flaw| match flaw {
            Flaw::Second(second) => second.truth(truth, centre, spot.width, self.pixels),
            _ => truth,
        })
    }
}

/// What a flaw wants to know of the row that it is done to.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// The spot's centre in pixels.
    pub centre: Option<f64>,
    /// The spot.
    pub spot: Option<Spot>,
    /// Pixels of the row.
    pub pixels: usize,
}

impl Site {
    /// The spot's centre, or the row's middle.
    pub fn middle(&self) -> f64 {
        self.centre.unwrap_or(0.5 * self.pixels as f64)
    }

    /// The spot's width in pixels; 10 where there is none.
    pub fn width(&self) -> f64 {
        self.spot.map_or(10.0, |spot| spot.width)
    }

    /// The spot's height in counts; 1000 where there is none.
    pub fn amplitude(&self) -> f64 {
        self.spot.map_or(1000.0, |spot| spot.amplitude)
    }

    /// A pixel between so many widths from the spot, on either side; off the row, the row's nearest.
    pub fn pixel(&self, widths: (f64, f64), random: &mut ChaCha8Rng) -> usize {
        let off = self.width() * random.random_range(widths.0..=widths.1);
        let side = if random.random::<bool>() { 1.0 } else { -1.0 };
        (self.middle() + side * off)
            .round()
            .clamp(0.0, self.pixels as f64 - 1.0) as usize
    }
}
