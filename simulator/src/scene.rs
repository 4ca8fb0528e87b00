//! What the sensor is shown: a target at a distance, the spot's light on the rows, and the effects that matter.
//!
//! A scene is a value that lists its effects. An effect that is not listed is not computed: it costs no time and no memory,
//! draws no random number, and changes no other (see [`random`]). The same scene gives the same rows in any order and on any
//! number of threads, and on any machine: angles and exponentials are libm's, not the machine's. [`texture`] alone draws normal numbers
//! whose rare far tails are made with the standard library's exp and ln.
//!
//! Light is in counts of the converter, before noise and rounding; lengths are in metres unless they are said to be in pixels.

pub mod ambient;
pub mod black_level;
pub mod diffraction;
pub mod file;
pub mod fixed_pattern;
pub mod flare;
pub mod hot_pixels;
mod laser_light;
pub mod laser_spot;
pub mod lens;
pub mod motion;
pub mod obliquity;
pub mod pattern;
pub mod quantisation;
pub mod random;
pub mod read_noise;
pub mod response;
pub mod saturation;
pub mod second_reflection;
pub mod sensor;
mod shape;
pub mod shot_noise;
pub mod simulation;
pub mod speckle;
pub mod specular_lobe;
pub mod spot;
pub mod temperature;
pub mod texture;

use serde::{Deserialize, Serialize};
use slitrange::row::Geometry;

use crate::optics::Optics;
pub use ambient::Ambient;
pub use black_level::BlackLevel;
pub use diffraction::Diffraction;
pub use fixed_pattern::FixedPattern;
pub use flare::Flare;
pub use hot_pixels::HotPixels;
pub use laser_spot::LaserSpot;
pub use lens::{Coma, Defocus, Distortion};
pub use motion::Motion;
pub use obliquity::Obliquity;
pub use quantisation::{Quantisation, quantise};
pub use read_noise::ReadNoise;
pub use response::Response;
pub use saturation::Saturation;
pub use second_reflection::SecondReflection;
pub use sensor::{Sensor, sensor_outputs};
pub use shot_noise::ShotNoise;
pub use simulation::Simulation;
pub use speckle::Speckle;
pub use specular_lobe::SpecularLobe;
pub use spot::Spot;
pub use temperature::Temperature;
pub use texture::Texture;

/// What rows are made of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// What it shows, in a sentence.
    #[serde(default)]
    pub about: String,
    /// Seed of every random stream.
    pub seed: u64,
    /// Distance of the target in metres, where nobody moves it.
    pub distance: f64,
    /// Time between the pulses that start and end an exposure, in seconds.
    pub exposure: f64,
    /// The sensor whose rows these are.
    pub sensor: Sensor,
    /// Where light falls for a distance, and through what.
    pub optics: Optics,

    /// The laser's light on the sensor, where the laser is on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spot: Option<Spot>,
    /// The pattern of the slit or the lens, in place of a gaussian.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffraction: Option<Diffraction>,
    /// The laser's spot on the target is no point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub laser_spot: Option<LaserSpot>,
    /// Light that comes in at an angle makes an asymmetric pattern.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub obliquity: Option<Obliquity>,
    /// A rough target lit by coherent light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speckle: Option<Speckle>,
    /// The target is not equally bright everywhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texture: Option<Texture>,
    /// The target shines towards its mirror direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub specular_lobe: Option<SpecularLobe>,
    /// The lens is not focused on the target.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub defocus: Option<Defocus>,
    /// The lens draws points off its axis with a tail.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coma: Option<Coma>,
    /// The lens's scale changes towards the edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
    /// Light that bounces between sensor and lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flare: Option<Flare>,
    /// A second spot, by way of another surface.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second_reflection: Option<SecondReflection>,
    /// Light that is not the laser's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ambient: Option<Ambient>,
    /// The target moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<Motion>,
    /// The sensor warms up, and its geometry with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature: Option<Temperature>,
    /// Pixels differ in what they make of light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub response: Option<Response>,
    /// Noise of the light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shot_noise: Option<ShotNoise>,
    /// A pixel holds so much and no more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saturation: Option<Saturation>,
    /// Counts of an unlit pixel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub black_level: Option<BlackLevel>,
    /// Unlit pixels differ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fixed_pattern: Option<FixedPattern>,
    /// A few pixels leak.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hot_pixels: Option<HotPixels>,
    /// Noise of the sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub read_noise: Option<ReadNoise>,
    /// The converter has coarse steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quantisation: Option<Quantisation>,
}

/// The effects that a scene can list, in the order in which they are computed. The number is that of the random stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Effect {
    /// [`Diffraction`].
    Diffraction = 1,
    /// [`LaserSpot`].
    LaserSpot = 2,
    /// [`Obliquity`].
    Obliquity = 3,
    /// [`Speckle`].
    Speckle = 4,
    /// [`Texture`].
    Texture = 5,
    /// [`SpecularLobe`].
    SpecularLobe = 6,
    /// [`Defocus`].
    Defocus = 7,
    /// [`Coma`].
    Coma = 8,
    /// [`Distortion`].
    Distortion = 9,
    /// [`Flare`].
    Flare = 10,
    /// [`SecondReflection`].
    SecondReflection = 11,
    /// [`Ambient`].
    Ambient = 12,
    /// [`Motion`].
    Motion = 13,
    /// [`Temperature`].
    Temperature = 14,
    /// [`Response`].
    Response = 15,
    /// [`ShotNoise`].
    ShotNoise = 16,
    /// [`Saturation`].
    Saturation = 17,
    /// [`BlackLevel`].
    BlackLevel = 18,
    /// [`FixedPattern`].
    FixedPattern = 19,
    /// [`HotPixels`].
    HotPixels = 20,
    /// [`ReadNoise`].
    ReadNoise = 21,
    /// [`Quantisation`].
    Quantisation = 22,
}

impl Effect {
    /// All of them.
    pub const ALL: [Self; 22] = [
        Self::Diffraction,
        Self::LaserSpot,
        Self::Obliquity,
        Self::Speckle,
        Self::Texture,
        Self::SpecularLobe,
        Self::Defocus,
        Self::Coma,
        Self::Distortion,
        Self::Flare,
        Self::SecondReflection,
        Self::Ambient,
        Self::Motion,
        Self::Temperature,
        Self::Response,
        Self::ShotNoise,
        Self::Saturation,
        Self::BlackLevel,
        Self::FixedPattern,
        Self::HotPixels,
        Self::ReadNoise,
        Self::Quantisation,
    ];

    /// The name that it has in a scene's file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Diffraction => "diffraction",
            Self::LaserSpot => "laser_spot",
            Self::Obliquity => "obliquity",
            Self::Speckle => "speckle",
            Self::Texture => "texture",
            Self::SpecularLobe => "specular_lobe",
            Self::Defocus => "defocus",
            Self::Coma => "coma",
            Self::Distortion => "distortion",
            Self::Flare => "flare",
            Self::SecondReflection => "second_reflection",
            Self::Ambient => "ambient",
            Self::Motion => "motion",
            Self::Temperature => "temperature",
            Self::Response => "response",
            Self::ShotNoise => "shot_noise",
            Self::Saturation => "saturation",
            Self::BlackLevel => "black_level",
            Self::FixedPattern => "fixed_pattern",
            Self::HotPixels => "hot_pixels",
            Self::ReadNoise => "read_noise",
            Self::Quantisation => "quantisation",
        }
    }
}

impl Scene {
    /// Time from row to row, or from frame to frame of a camera, in seconds: the sensor's, or the exposure where that is longer.
    pub fn period(&self) -> f64 {
        self.sensor.period().max(self.exposure)
    }

    /// A sensor in the dark: no laser, no effect.
    pub fn dark(sensor: Sensor) -> Self {
        Self {
            about: String::new(),
            seed: 1,
            distance: 0.8,
            exposure: 0.005,
            sensor,
            optics: Optics::nominal_on(sensor),
            spot: None,
            diffraction: None,
            laser_spot: None,
            obliquity: None,
            speckle: None,
            texture: None,
            specular_lobe: None,
            defocus: None,
            coma: None,
            distortion: None,
            flare: None,
            second_reflection: None,
            ambient: None,
            motion: None,
            temperature: None,
            response: None,
            shot_noise: None,
            saturation: None,
            black_level: None,
            fixed_pattern: None,
            hot_pixels: None,
            read_noise: None,
            quantisation: None,
        }
    }

    /// White paper in a dim room, on the TCD1304DG: no ambient light, no speckle.
    ///
    /// The spot is that of a 2 mm laser spot through a 200 um slit 50 mm from the sensor: sigma 69 um, 8.6 pixels of 8 um. Ten
    /// electrons a count and four counts of noise are a TCD1304DG's 40 ke- full well and 0.6 mV noise of 0.6 V on 12 bits.
    pub fn white_paper() -> Self {
        Self {
            black_level: Some(BlackLevel::steady(300.0)),
            spot: Some(Spot {
                width: 8.6,
                counts_per_second: 350_000.0,
            }),
            shot_noise: Some(ShotNoise {
                electrons_per_count: 10.0,
            }),
            read_noise: Some(ReadNoise { counts: 4.0 }),
            ..Self::dark(Sensor::Tcd1304dg)
        }
    }

    /// What the words of a row are, as the core wants to know it.
    pub fn geometry(&self) -> Geometry {
        let geometry = self.sensor.geometry();
        match self.shot_noise {
            // A count of n electrons has the variance of 1/n.
            Some(noise) => Geometry {
                shot_variance_per_count_q16: (65536.0 / noise.electrons_per_count).round() as u16,
                ..geometry
            },
            None => geometry,
        }
    }

    /// Whether the scene lists an effect.
    pub fn lists(&self, effect: Effect) -> bool {
        match effect {
            Effect::Diffraction => self.diffraction.is_some(),
            Effect::LaserSpot => self.laser_spot.is_some(),
            Effect::Obliquity => self.obliquity.is_some(),
            Effect::Speckle => self.speckle.is_some(),
            Effect::Texture => self.texture.is_some(),
            Effect::SpecularLobe => self.specular_lobe.is_some(),
            Effect::Defocus => self.defocus.is_some(),
            Effect::Coma => self.coma.is_some(),
            Effect::Distortion => self.distortion.is_some(),
            Effect::Flare => self.flare.is_some(),
            Effect::SecondReflection => self.second_reflection.is_some(),
            Effect::Ambient => self.ambient.is_some(),
            Effect::Motion => self.motion.is_some(),
            Effect::Temperature => self.temperature.is_some(),
            Effect::Response => self.response.is_some(),
            Effect::ShotNoise => self.shot_noise.is_some(),
            Effect::Saturation => self.saturation.is_some(),
            Effect::BlackLevel => self.black_level.is_some(),
            Effect::FixedPattern => self.fixed_pattern.is_some(),
            Effect::HotPixels => self.hot_pixels.is_some(),
            Effect::ReadNoise => self.read_noise.is_some(),
            Effect::Quantisation => self.quantisation.is_some(),
        }
    }

    /// The scene without an effect.
    pub fn without(mut self, effect: Effect) -> Self {
        match effect {
            Effect::Diffraction => self.diffraction = None,
            Effect::LaserSpot => self.laser_spot = None,
            Effect::Obliquity => self.obliquity = None,
            Effect::Speckle => self.speckle = None,
            Effect::Texture => self.texture = None,
            Effect::SpecularLobe => self.specular_lobe = None,
            Effect::Defocus => self.defocus = None,
            Effect::Coma => self.coma = None,
            Effect::Distortion => self.distortion = None,
            Effect::Flare => self.flare = None,
            Effect::SecondReflection => self.second_reflection = None,
            Effect::Ambient => self.ambient = None,
            Effect::Motion => self.motion = None,
            Effect::Temperature => self.temperature = None,
            Effect::Response => self.response = None,
            Effect::ShotNoise => self.shot_noise = None,
            Effect::Saturation => self.saturation = None,
            Effect::BlackLevel => self.black_level = None,
            Effect::FixedPattern => self.fixed_pattern = None,
            Effect::HotPixels => self.hot_pixels = None,
            Effect::ReadNoise => self.read_noise = None,
            Effect::Quantisation => self.quantisation = None,
        }
        self
    }

    /// The pixels' outputs, light positive, in counts before rounding, for a target at `distance` metres, after
    /// `exposure` seconds: `geometry().words` values, in the order in which the words of the geometry are read. `row`
    /// counts the rows and selects the random numbers.
    ///
    /// A scene of which many rows are wanted is prepared once: [`Simulation`].
    pub fn row(&self, row: u64, distance: f64, exposure: f64) -> Vec<f32> {
        simulation::row(
            self,
            &simulation::Prepared::new(self),
            row,
            distance,
            exposure,
        )
    }

    /// The same for a spot whose centre is given, in pixels of the light range.
    pub fn row_with_centre(&self, row: u64, centre: f64, exposure: f64) -> Vec<f32> {
        self.row(row, self.optics.distance(centre), exposure)
    }
}
