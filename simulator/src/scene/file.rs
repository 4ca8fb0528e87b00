//! Scenes as TOML files.

use std::f64::consts::FRAC_PI_2;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};

use crate::optics::{Aperture, Optics};
use crate::scene::{Effect, Scene, Sensor, speckle};

/// Pixels of a row: no sensor has more, and each scene's row takes memory and time for all of them.
const LONGEST_ROW: usize = 65_536;
/// Metres across the aperture that a surface's lattice is made for ([`crate::field::Scattering::pitch`]).
const SPECKLE_APERTURE: f64 = 4.2e-3;

/// The folder of the scenes that come with the project.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes")
}

/// The names of the scenes in [`folder`], in alphabetical order.
///
/// # Errors
/// The folder cannot be read.
pub fn names() -> Result<Vec<String>> {
    let folder = folder();
    let mut names = vec![];
    for entry in std::fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.extension().is_some_and(|it| it == "toml")
            && let Some(name) = path.file_stem()
        {
            names.push(name.to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

impl Scene {
    /// The scene of this name in [`folder`], or in the file of this path where the name ends in `.toml`.
    ///
    /// # Errors
    /// There is no such file, or it is no scene.
    pub fn load(name: &str) -> Result<Self> {
        let path = match name.ends_with(".toml") {
            true => PathBuf::from(name),
            false => folder().join(format!("{name}.toml")),
        };
        let text = std::fs::read_to_string(&path).with_context(|| {
            let names = names().unwrap_or_default().join(", ");
            format!("no scene {}; there are {names}", path.display())
        })?;
        Self::from_toml(&text).with_context(|| format!("in the scene {}", path.display()))
    }

    /// Reads a scene.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn from_toml(text: &str) -> Result<Self> {
        let scene: Self = toml::from_str(text)?;
        scene.check()?;
        Ok(scene)
    }

    /// The scene as [`Scene::from_toml`] reads it.
    pub fn to_toml(&self) -> Result<String> {
        Ok(toml::to_string(self)?)
    }

    /// That the scene can be simulated.
    ///
    /// # Errors
    /// A value that means nothing, or an effect that has nothing to act on, and what to do about it.
    pub fn check(&self) -> Result<()> {
        Above(0.0).check("distance", self.distance, "m")?;
        Above(0.0).check("exposure", self.exposure, "s")?;
        if let Sensor::Row(pixels) = self.sensor {
            ensure!(
                pixels > 0,
                "sensor.row is 0 pixels: give the row a length, or name a sensor"
            );
            ensure!(
                pixels <= LONGEST_ROW,
                "sensor.row is {pixels} pixels: it must be {LONGEST_ROW} or fewer"
            );
        }
        check_optics(&self.optics, self.sensor)?;
        if let Some(comb) = &self.comb {
            comb.check(&self.optics)?;
        }
        self.check_effects()?;
        self.check_lens()?;
        for it in PARAMETERS {
            if let Some(value) = (it.value)(self) {
                let name = format!("{}.{}", it.effect, it.name);
                it.range.check(&name, value, it.unit)?;
            }
        }
        Ok(())
    }

    /// That a target at a distance in metres can be simulated, where it is not the scene's own.
    ///
    /// # Errors
    /// It is behind the laser, or speckle's surface is not made for it.
    pub fn check_distance(&self, distance: f64) -> Result<()> {
        Above(0.0).check("the target's distance", distance, "m")?;
        if self.speckle.is_some() {
            let nearest = speckle::NEAREST.min(self.distance);
            let farthest = speckle::FARTHEST * self.distance;
            ensure!(
                (nearest..=farthest).contains(&distance),
                "the target's distance is {distance} m: with [speckle] this scene can be seen from {nearest} \
                 to {farthest:.3} m, 1.5 times its own distance; move that, or leave [speckle] out"
            );
        }
        Ok(())
    }

    fn check_effects(&self) -> Result<()> {
        let acting_on_the_spot =
            (Effect::ALL.into_iter()).take_while(|effect| *effect != Effect::Ambient);
        for effect in acting_on_the_spot {
            ensure!(
                self.spot.is_some() || !self.lists(effect),
                "[{}] acts on the laser's light, and there is none: add [spot]",
                effect.name()
            );
        }
        if self.speckle.is_some() {
            ensure!(
                self.laser_spot.is_some(),
                "[speckle] is the interference of light from all over the laser's spot, and that is a \
                 point: add [laser_spot]"
            );
            let (side, name) = match self.optics.aperture {
                Aperture::Slit { height, .. } => (height, "slit.height"),
                Aperture::Lens { diameter } => (diameter, "lens.diameter"),
            };
            ensure!(
                side <= SPECKLE_APERTURE,
                "optics.aperture.{name} is {side} m: with [speckle] it must be {SPECKLE_APERTURE} m or less, \
                 beyond which the field of the surface's lattice repeats"
            );
        }
        Ok(())
    }

    fn check_lens(&self) -> Result<()> {
        use Effect::{Coma, Defocus, Distortion, Flare};
        for effect in [Defocus, Coma, Distortion, Flare] {
            ensure!(
                matches!(self.optics.aperture, Aperture::Lens { .. }) || !self.lists(effect),
                "[{}] is a lens's, and there is a slit: make optics.aperture a lens, or leave the effect out",
                effect.name()
            );
        }
        Ok(())
    }
}

/// The values that a number of a scene may have. `Display` says which.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// All.
    Any,
    /// This and more.
    AtLeast(f64),
    /// More than this.
    Above(f64),
    /// From 0 to 1.
    Share,
    /// Above 0, at most 1.
    PositiveShare,
    /// Whole numbers from the first to the second.
    Whole(u32, u32),
}

use Range::{Above, Any, AtLeast, PositiveShare, Share, Whole};

impl Range {
    /// Whether a value is within. Infinity and NaN never are.
    pub fn contains(self, value: f64) -> bool {
        value.is_finite()
            && match self {
                Any => true,
                AtLeast(least) => value >= least,
                Above(least) => value > least,
                Share => (0.0..=1.0).contains(&value),
                PositiveShare => value > 0.0 && value <= 1.0,
                Whole(least, most) => (f64::from(least)..=f64::from(most)).contains(&value),
            }
    }

    fn check(self, name: &str, value: f64, unit: &str) -> Result<()> {
        let is_within = self.contains(value);
        ensure!(is_within, "{name} is {value} {unit}: it must be {self}");
        Ok(())
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Any => write!(f, "a number"),
            AtLeast(least) => write!(f, "{least} or more"),
            Above(least) => write!(f, "above {least}"),
            Share => write!(f, "0 to 1"),
            PositiveShare => write!(f, "above 0, at most 1"),
            Whole(least, most) => write!(f, "a whole number from {least} to {most}"),
        }
    }
}

/// A parameter of an effect: what a scene's file may say of it.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// The name of the effect.
    pub effect: &'static str,
    /// Its own name.
    pub name: &'static str,
    /// The values that [`Scene::check`] accepts.
    pub range: Range,
    /// The unit of the value, or what it is a share of.
    pub unit: &'static str,
    /// The value in a scene; `None` where the scene does not say it.
    value: fn(&Scene) -> Option<f64>,
}

macro_rules! parameters {
    ($($effect:ident.$name:ident $(as $type:ty)?: $range:expr, $unit:literal;)+) => {
        /// The parameters that are numbers, of all effects.
        pub const PARAMETERS: &[Parameter] = &[$(Parameter {
            effect: stringify!($effect),
            name: stringify!($name),
            range: $range,
            unit: $unit,
            value: |scene| scene.$effect.and_then(|it| (it.$name $(as $type)?).into()),
        },)+];
    };
}

parameters! {
    spot.width: Above(0.0), "pixels";
    spot.counts_per_second: AtLeast(0.0), "counts/s";
    laser_spot.waist: AtLeast(10e-6), "m";
    laser_spot.waist_distance: Any, "m";
    laser_spot.wander: Any, "m/m";
    speckle.polarisations as f64: Whole(1, 2), "(1: metal, gloss; 2: paper, wood)";
    speckle.linewidth: AtLeast(0.0), "m";
    speckle.path_spread: AtLeast(0.0), "m";
    texture.contrast: AtLeast(0.0), "of the mean";
    texture.length: AtLeast(1e-6), "m";
    specular_lobe.strength: AtLeast(0.0), "of the surface's";
    specular_lobe.width: Above(0.0), "radians";
    specular_lobe.tilt: Any, "radians";
    reflectivity.darkest: PositiveShare, "of the brightest";
    reflectivity.steps as f64: Whole(1, u32::MAX), "steps";
    reflectivity.seconds: Above(0.0), "s";
    second_reflection.offset: Any, "pixels";
    second_reflection.width: Above(0.0), "pixels";
    second_reflection.strength: AtLeast(0.0), "of the spot's";
    motion.speed: Any, "m/s";
    temperature.kelvin_per_second: Any, "K/s";
    temperature.expansion: Any, "/K";
    defocus.focus_distance: Above(0.0), "m";
    coma.waves: Any, "waves";
    coma.field: Above(0.0), "m";
    distortion.share: Any, "of the distance";
    distortion.field: Above(0.0), "m";
    flare.magnification: Any, "times";
    flare.width: Above(0.0), "pixels";
    flare.strength: AtLeast(0.0), "of the spot's";
    flare.veil: AtLeast(0.0), "of the spot's";
    ambient.counts_per_second: AtLeast(0.0), "counts/s";
    ambient.slope: Any, "counts/s a pixel";
    mains_light.counts_per_second: AtLeast(0.0), "counts/s";
    mains_light.slope: Any, "counts/s a pixel";
    mains_light.modulation: Share, "of the mean";
    mains_light.frequency: Above(0.0), "Hz";
    mains_light.phase: Any, "radians";
    response.deviation: AtLeast(0.0), "of the mean";
    lag.counts: Above(0.0), "counts";
    lag.share: Share, "of the charge";
    hot_pixels.share: Share, "of the pixels";
    hot_pixels.counts_per_second: AtLeast(0.0), "counts/s";
    // The core cannot be told of a converter that counts single electrons.
    shot_noise.electrons_per_count: Above(1.0), "electrons";
    saturation.full_well: Above(0.0), "counts";
    saturation.blooming: Share, "of the charge";
    black_level.counts: Any, "counts";
    black_level.drift: Any, "counts/s";
    fixed_pattern.counts: AtLeast(0.0), "counts";
    settling.time_constant: Above(0.0), "s";
    front_end.gain: Above(0.0), "times";
    front_end.offset: Any, "counts";
    front_end.saturation: Above(0.0), "counts";
    read_noise.counts: AtLeast(0.0), "counts";
    quantisation.step: AtLeast(0.01), "counts";
}

fn check_optics(optics: &Optics, sensor: Sensor) -> Result<()> {
    Any.check("optics.offset", optics.offset, "m")?;
    Above(0.0).check("optics.baseline", optics.baseline, "m")?;
    AtLeast(1e-3).check("optics.focal_length", optics.focal_length, "m")?;
    ensure!(
        optics.angle > 0.0 && optics.angle < FRAC_PI_2,
        "optics.angle is {} radians: it is the optical axis's to the casing, between 0 and pi/2",
        optics.angle
    );
    let pitch = sensor.pitch();
    ensure!(
        (optics.pitch / pitch - 1.0).abs() < 0.01,
        "optics.pitch is {} m, and the pixels of the scene's sensor are {pitch} m apart: write that",
        optics.pitch
    );
    Any.check("optics.axis", optics.axis, "pixels")?;
    Above(0.0).check("optics.wavelength", optics.wavelength, "m")?;
    match optics.aperture {
        Aperture::Slit { width, height } => {
            Above(0.0).check("optics.aperture.slit.width", width, "m")?;
            Above(0.0).check("optics.aperture.slit.height", height, "m")
        }
        Aperture::Lens { diameter } => {
            Above(0.0).check("optics.aperture.lens.diameter", diameter, "m")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene behind a lens that has all parameters, each with the value that a function gives.
    fn scene_with(value: impl Fn(&Parameter) -> f64) -> Result<Scene> {
        let mut scene = Scene::white_paper();
        scene.optics.aperture = Aperture::PAPER_LENS;
        let mut table = toml::Table::try_from(&scene)?;
        for it in PARAMETERS {
            let effect = table.entry(it.effect).or_insert(toml::Table::new().into());
            let value = match it.range {
                Whole(..) => toml::Value::Integer(value(it) as i64),
                _ => toml::Value::Float(value(it)),
            };
            let effect = effect.as_table_mut().context("a table")?;
            effect.insert(it.name.to_owned(), value);
        }
        Scene::from_toml(&table.to_string())
    }

    /// A time constant of 0.25 s is among the values.
    #[test]
    fn each_parameter_is_listed_and_accepts_the_values_of_its_range() {
        let plain = |it: &Parameter| match it.range {
            Above(least) => least + 0.25,
            Whole(least, _) => f64::from(least),
            _ => 0.25,
        };
        let scene = scene_with(plain).expect("a scene");
        let table = toml::Table::try_from(&scene).expect("a table");
        for effect in Effect::ALL.map(Effect::name).into_iter().chain(["spot"]) {
            let parameters = table.get(effect).and_then(toml::Value::as_table);
            let listed = PARAMETERS.iter().filter(|it| it.effect == effect).count();
            assert_eq!(parameters.map_or(0, toml::Table::len), listed, "{effect}");
        }
        for tried in PARAMETERS {
            for value in [
                -1.0,
                0.0,
                1e-6,
                0.9e-5,
                0.25,
                1.0,
                1.5,
                2.0,
                3.0,
                1e9,
                f64::NAN,
                f64::INFINITY,
            ] {
                let is_number_of_type = match tried.range {
                    Whole(..) => value >= 0.0 && value.fract() == 0.0 && value < 256.0,
                    _ => true,
                };
                if !is_number_of_type {
                    continue;
                }
                let is_tried = |it: &Parameter| (it.effect, it.name) == (tried.effect, tried.name);
                let found = scene_with(|it| if is_tried(it) { value } else { plain(it) });
                let (effect, name, range) = (tried.effect, tried.name, tried.range);
                println!("{effect}.{name} = {value}: {:?}", found.as_ref().err());
                assert_eq!(
                    found.is_ok(),
                    range.contains(value),
                    "{effect}.{name} = {value}"
                );
                if let Err(error) = found {
                    let words = format!(
                        "{effect}.{name} is {value} {}: it must be {range}",
                        tried.unit
                    );
                    assert_eq!(format!("{error:#}"), words);
                }
            }
        }
    }
}
