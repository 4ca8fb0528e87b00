//! What the sensor is shown: a target at a distance, the spot's light on the rows, and the effects that
//! matter.
//!
//! A scene is a value that lists its effects. An effect that is not listed is not computed: it costs no time
//! and no memory, draws no random number, and changes no other (see [`random`]). The same scene gives the
//! same rows in any order and on any number of threads, and on any machine: angles and exponentials are
//! libm's, not the machine's. [`texture`] alone draws normal numbers whose rare far tails are made with the
//! standard library's exp and ln.
//!
//! Light is in counts of the converter, before noise and rounding; lengths are in metres unless they are said
//! to be in pixels.

pub mod ambient;
pub mod black_level;
pub mod comb;
pub mod diffraction;
pub mod exposure;
pub mod file;
pub mod fixed_pattern;
pub mod flare;
pub mod front_end;
pub mod hot_pixels;
pub mod lag;
mod laser_light;
pub mod laser_spot;
pub mod lens;
pub mod mains_light;
pub mod motion;
pub mod obliquity;
pub mod pattern;
pub mod quantisation;
pub mod random;
pub mod read_noise;
pub mod reflectivity;
pub mod response;
pub mod saturation;
pub mod second_reflection;
pub mod settling;
pub(crate) mod shape;
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
pub use crate::sensor::{Sensor, sensor_outputs};
pub use comb::Comb;
pub use exposure::Exposure;
pub use quantisation::quantise;
pub use simulation::Simulation;
pub use spot::Spot;

/// Declares a scene and its effects: what each does, its type, its random stream's number, and its field.
macro_rules! effects {
    ($($(#[$what:meta])+ $module:ident::$effect:ident = $number:literal in $field:ident,)+) => {
        $(pub use $module::$effect;)+

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
            /// The mask of several slits in place of the one slit of `optics`.
            #[serde(default)]
            pub comb: Option<Comb>,

            /// The laser's light on the sensor, where the laser is on.
            pub spot: Option<Spot>,
            $($(#[$what])+ pub $field: Option<$effect>,)+
        }

        /// The effects that a scene can list, in the order in which they are computed. The number is that of
        /// the random stream.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Effect {
            $(#[doc = concat!("[`", stringify!($effect), "`].")] $effect = $number,)+
        }

        impl Effect {
            /// All of them.
            pub const ALL: [Self; [$($number),+].len()] = [$(Self::$effect),+];

            /// The name that it has in a scene's file.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$effect => stringify!($field),)+ }
            }
        }

        impl Scene {
            /// A sensor in the dark: no laser, no effect.
            pub fn dark(sensor: Sensor) -> Self {
                Self {
                    about: String::new(),
                    seed: 1,
                    distance: 0.8,
                    exposure: 0.005,
                    sensor,
                    optics: Optics::nominal_on(sensor),
                    comb: None,
                    spot: None,
                    $($field: None,)+
                }
            }

            /// Whether the scene lists an effect.
            pub fn lists(&self, effect: Effect) -> bool {
                match effect { $(Effect::$effect => self.$field.is_some(),)+ }
            }

            /// The scene without an effect.
            pub fn without(self, effect: Effect) -> Self {
                let dark = Self::dark(self.sensor);
                self.with(effect, &dark)
            }

            /// The scene with an effect as another scene has it.
            pub fn with(mut self, effect: Effect, other: &Self) -> Self {
                match effect { $(Effect::$effect => self.$field = other.$field,)+ }
                self
            }
        }
    };
}

effects! {
    /// The pattern of the slit or the lens, in place of a gaussian.
    diffraction::Diffraction = 1 in diffraction,
    /// The laser's spot on the target is no point.
    laser_spot::LaserSpot = 2 in laser_spot,
    /// Light that comes in at an angle makes an asymmetric pattern.
    obliquity::Obliquity = 3 in obliquity,
    /// A rough target lit by coherent light.
    speckle::Speckle = 4 in speckle,
    /// The target is not equally bright everywhere.
    texture::Texture = 5 in texture,
    /// The target shines towards its mirror direction.
    specular_lobe::SpecularLobe = 6 in specular_lobe,
    /// Targets of different reflectivity, one after the other.
    reflectivity::Reflectivity = 27 in reflectivity,
    /// The lens is not focused on the target.
    lens::Defocus = 7 in defocus,
    /// The lens draws points off its axis with a tail.
    lens::Coma = 8 in coma,
    /// The lens's scale changes towards the edge.
    lens::Distortion = 9 in distortion,
    /// Light that bounces between sensor and lens.
    flare::Flare = 10 in flare,
    /// A second spot, by way of another surface.
    second_reflection::SecondReflection = 11 in second_reflection,
    /// Light that is not the laser's.
    ambient::Ambient = 12 in ambient,
    /// Lamps that flicker with the mains.
    mains_light::MainsLight = 26 in mains_light,
    /// The target moves.
    motion::Motion = 13 in motion,
    /// The sensor warms up, and its geometry with it.
    temperature::Temperature = 14 in temperature,
    /// Pixels differ in what they make of light.
    response::Response = 15 in response,
    /// Charge stays in a pixel for the next row.
    lag::Lag = 25 in lag,
    /// Noise of the light.
    shot_noise::ShotNoise = 16 in shot_noise,
    /// A pixel holds so much and no more.
    saturation::Saturation = 17 in saturation,
    /// Counts of an unlit pixel.
    black_level::BlackLevel = 18 in black_level,
    /// Unlit pixels differ.
    fixed_pattern::FixedPattern = 19 in fixed_pattern,
    /// A few pixels leak.
    hot_pixels::HotPixels = 20 in hot_pixels,
    /// The output has not settled when the converter samples it.
    settling::Settling = 24 in settling,
    /// The amplifier's gain and offset are not the nominal ones, and it clips.
    front_end::FrontEnd = 23 in front_end,
    /// Noise of the sensor.
    read_noise::ReadNoise = 21 in read_noise,
    /// The converter has coarse steps.
    quantisation::Quantisation = 22 in quantisation,
}

impl Scene {
    /// Time from row to row, or from frame to frame of a camera, in seconds: the sensor's, or the exposure
    /// where that is longer.
    pub fn period(&self) -> f64 {
        self.sensor.period().max(self.exposure)
    }

    /// The scene with a spot of another height, in counts a second.
    pub fn with_height(mut self, counts_per_second: f64) -> Self {
        if let Some(spot) = &mut self.spot {
            spot.counts_per_second = counts_per_second;
        }
        self
    }

    /// The scene with a cover on the sensor: no light reaches the sensor, whose own effects stay.
    pub fn covered(&self) -> Self {
        Self {
            spot: None,
            ambient: None,
            mains_light: None,
            ..self.clone()
        }
    }

    /// White paper in a dim room, on the TCD1304DG: no ambient light, no speckle.
    ///
    /// The spot is that of a 2 mm laser spot through a 200 um slit 50 mm from the sensor: sigma 69 um, 8.6
    /// pixels of 8 um. Ten electrons a count and four counts of noise are a TCD1304DG's 40 ke- full well and
    /// 0.6 mV noise of 0.6 V on 12 bits.
    pub fn white_paper() -> Self {
        Self {
            black_level: Some(BlackLevel::steady(300.0)),
            spot: Some(Spot::new(8.6, 350_000.0)),
            shot_noise: Some(ShotNoise::of(10.0)),
            read_noise: Some(ReadNoise { counts: 4.0 }),
            ..Self::dark(Sensor::Tcd1304dg)
        }
    }

    /// What the words of a row are, as the core wants to know it. The core does not know the gain of
    /// [`Scene::front_end`].
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

    /// The pixels' outputs, light positive, in counts before rounding, for a target at `distance` metres,
    /// after an exposure: `geometry().words` values, in the order in which the words of the geometry are
    /// read. `row` counts the rows and selects the random numbers. The exposure is in seconds, or an
    /// [`Exposure`] for a laser that is not always on.
    ///
    /// A scene of which many rows are wanted is prepared once: [`Simulation`].
    pub fn row(&self, row: u64, distance: f64, exposure: impl Into<Exposure>) -> Vec<f32> {
        Simulation::new(self.clone()).row(row, distance, exposure)
    }

    /// The same for a spot whose centre is given, in pixels of the light range.
    pub fn row_with_centre(
        &self,
        row: u64,
        centre: f64,
        exposure: impl Into<Exposure>,
    ) -> Vec<f32> {
        self.row(row, self.optics.distance(centre), exposure)
    }
}
