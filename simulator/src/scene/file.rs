//! Scenes as TOML files.

use std::f64::consts::FRAC_PI_2;
use std::ops::Bound::{self, Excluded, Included};
use std::ops::RangeBounds as _;
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

    /// The scene with the effects of a text, written as in a scene's file: an effect a line.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn listing(self, effects: &str) -> Result<Self> {
        let is_listed = |effect: &Effect| {
            let mut names = (effects.lines()).map(|line| line.trim().split([' ', '.']).next());
            names.any(|name| name == Some(effect.name()))
        };
        let others = (Effect::ALL.into_iter().filter(is_listed)).fold(self, Self::without);
        Self::from_toml(&format!("{effects}\n{}", others.to_toml()?))
    }

    /// That the scene can be simulated.
    ///
    /// # Errors
    /// A value that means nothing, or an effect that has nothing to act on, and what to do about it.
    pub fn check(&self) -> Result<()> {
        check("distance", self.distance, "m", above(0.0))?;
        check("exposure", self.exposure, "s", above(0.0))?;
        if let Sensor::Row(pixels) = self.sensor {
            ensure!(
                (1..=LONGEST_ROW).contains(&pixels),
                "sensor.row is {pixels} pixels: it must be 1 to {LONGEST_ROW}, or name a sensor"
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
                check(&name, value, it.unit, it.range)?;
            }
        }
        Ok(())
    }

    /// That a target at a distance in metres can be simulated, where it is not the scene's own.
    ///
    /// # Errors
    /// It is behind the laser, or speckle's surface is not made for it.
    pub fn check_distance(&self, distance: f64) -> Result<()> {
        check("the target's distance", distance, "m", above(0.0))?;
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

/// The values that a number of a scene may have. Infinity and NaN are in no range.
pub type Range = (Bound<f64>, Bound<f64>);

const ANY: Range = (Excluded(f64::NEG_INFINITY), Excluded(f64::INFINITY));
const SHARE: Range = (Included(0.0), Included(1.0));

const fn at_least(least: f64) -> Range {
    (Included(least), Excluded(f64::INFINITY))
}

const fn above(least: f64) -> Range {
    (Excluded(least), Excluded(f64::INFINITY))
}

/// A range in words.
pub fn in_words(range: Range) -> String {
    match range {
        (Included(least), Included(most)) => format!("{least} to {most}"),
        (Excluded(least), Included(most)) => format!("above {least}, at most {most}"),
        (Included(least), _) => format!("{least} or more"),
        (Excluded(least), _) if least.is_finite() => format!("above {least}"),
        _ => "a number".to_owned(),
    }
}

fn check(name: &str, value: f64, unit: &str, range: Range) -> Result<()> {
    let must = in_words(range);
    ensure!(
        range.contains(&value),
        "{name} is {value} {unit}: it must be {must}"
    );
    Ok(())
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
    spot.width: above(0.0), "pixels";
    spot.counts_per_second: at_least(0.0), "counts/s";
    laser_spot.waist: at_least(10e-6), "m";
    laser_spot.waist_distance: ANY, "m";
    laser_spot.wander: ANY, "m/m";
    speckle.polarisations as f64: (Included(1.0), Included(2.0)), "(1: metal, gloss; 2: paper, wood)";
    speckle.linewidth: at_least(0.0), "m";
    speckle.path_spread: at_least(0.0), "m";
    texture.contrast: at_least(0.0), "of the mean";
    texture.length: at_least(1e-6), "m";
    specular_lobe.strength: at_least(0.0), "of the surface's";
    specular_lobe.width: above(0.0), "radians";
    specular_lobe.tilt: ANY, "radians";
    reflectivity.darkest: (Excluded(0.0), Included(1.0)), "of the brightest";
    reflectivity.steps as f64: at_least(1.0), "steps";
    reflectivity.seconds: above(0.0), "s";
    second_reflection.offset: ANY, "pixels";
    second_reflection.width: above(0.0), "pixels";
    second_reflection.strength: at_least(0.0), "of the spot's";
    motion.speed: ANY, "m/s";
    temperature.kelvin_per_second: ANY, "K/s";
    temperature.expansion: ANY, "/K";
    defocus.focus_distance: above(0.0), "m";
    coma.waves: ANY, "waves";
    coma.field: above(0.0), "m";
    distortion.share: ANY, "of the distance";
    distortion.field: above(0.0), "m";
    flare.magnification: ANY, "times";
    flare.width: above(0.0), "pixels";
    flare.strength: at_least(0.0), "of the spot's";
    flare.veil: at_least(0.0), "of the spot's";
    ambient.counts_per_second: at_least(0.0), "counts/s";
    ambient.slope: ANY, "counts/s a pixel";
    mains_light.counts_per_second: at_least(0.0), "counts/s";
    mains_light.slope: ANY, "counts/s a pixel";
    mains_light.modulation: SHARE, "of the mean";
    mains_light.frequency: above(0.0), "Hz";
    mains_light.phase: ANY, "radians";
    response.deviation: at_least(0.0), "of the mean";
    lag.counts: above(0.0), "counts";
    lag.share: SHARE, "of the charge";
    hot_pixels.share: SHARE, "of the pixels";
    hot_pixels.counts_per_second: at_least(0.0), "counts/s";
    // The core cannot be told of a converter that counts single electrons.
    shot_noise.electrons_per_count: above(1.0), "electrons";
    saturation.full_well: above(0.0), "counts";
    saturation.blooming: SHARE, "of the charge";
    black_level.counts: ANY, "counts";
    black_level.drift: ANY, "counts/s";
    fixed_pattern.counts: at_least(0.0), "counts";
    settling.time_constant: above(0.0), "s";
    front_end.gain: above(0.0), "times";
    front_end.offset: ANY, "counts";
    front_end.saturation: above(0.0), "counts";
    read_noise.counts: at_least(0.0), "counts";
    quantisation.step: at_least(0.01), "counts";
}

fn check_optics(optics: &Optics, sensor: Sensor) -> Result<()> {
    check("optics.offset", optics.offset, "m", ANY)?;
    check("optics.baseline", optics.baseline, "m", above(0.0))?;
    let focal_length = optics.focal_length;
    check("optics.focal_length", focal_length, "m", at_least(1e-3))?;
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
    check("optics.axis", optics.axis, "pixels", ANY)?;
    check("optics.wavelength", optics.wavelength, "m", above(0.0))?;
    match optics.aperture {
        Aperture::Slit { width, height } => {
            check("optics.aperture.slit.width", width, "m", above(0.0))?;
            check("optics.aperture.slit.height", height, "m", above(0.0))
        }
        Aperture::Lens { diameter } => {
            check("optics.aperture.lens.diameter", diameter, "m", above(0.0))
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
            let effect = effect.as_table_mut().context("a table")?;
            let value = match value(it) {
                whole if whole.fract() == 0.0 => toml::Value::Integer(whole as i64),
                other => toml::Value::Float(other),
            };
            effect.insert(it.name.to_owned(), value);
        }
        Scene::from_toml(&table.to_string())
    }

    /// A time constant of 0.25 s is among the values.
    #[test]
    fn each_parameter_is_listed_and_accepts_the_values_of_its_range() {
        let plain = |it: &Parameter| if it.range.contains(&0.25) { 0.25 } else { 2.0 };
        let table = toml::Table::try_from(scene_with(plain).expect("a scene")).expect("a table");
        for effect in Effect::ALL.map(Effect::name).into_iter().chain(["spot"]) {
            let parameters = table.get(effect).and_then(toml::Value::as_table);
            let listed = PARAMETERS.iter().filter(|it| it.effect == effect).count();
            assert_eq!(parameters.map_or(0, toml::Table::len), listed, "{effect}");
        }
        for tried in PARAMETERS {
            let (effect, name) = (tried.effect, tried.name);
            for value in [-1.0, 0.0, 9e-6, 0.25, 1.0, 2.0, 3.0, 1e9, f64::NAN] {
                let is_tried = |it: &Parameter| (it.effect, it.name) == (effect, name);
                let found = scene_with(|it| if is_tried(it) { value } else { plain(it) });
                println!("{effect}.{name} = {value}: {:?}", found.as_ref().err());
                let is_within = tried.range.contains(&value);
                assert_eq!(found.is_ok(), is_within, "{effect}.{name} = {value}");
            }
        }
    }
}
