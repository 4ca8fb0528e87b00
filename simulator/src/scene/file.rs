//! Scenes as TOML files.

use std::f64::consts::FRAC_PI_2;
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
        above_zero("distance", self.distance, "m")?;
        above_zero("exposure", self.exposure, "s")?;
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
        self.check_numbers()
    }

    /// That a target at a distance in metres can be simulated, where it is not the scene's own.
    ///
    /// # Errors
    /// It is behind the laser, or speckle's surface is not made for it.
    pub fn check_distance(&self, distance: f64) -> Result<()> {
        above_zero("the target's distance", distance, "m")?;
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
        if let Some(speckle) = &self.speckle {
            ensure!(
                self.laser_spot.is_some(),
                "[speckle] is the interference of light from all over the laser's spot, and that is a \
                 point: add [laser_spot]"
            );
            ensure!(
                matches!(speckle.polarisations, 1 | 2),
                "speckle.polarisations is {}: light has 1 (metal, gloss) or 2 (paper, wood)",
                speckle.polarisations
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
        if let Some(reflectivity) = &self.reflectivity {
            ensure!(
                reflectivity.darkest > 0.0 && reflectivity.darkest <= 1.0,
                "reflectivity.darkest is {}: the darkest target's light over the brightest's is above 0 and \
                 at most 1",
                reflectivity.darkest
            );
            ensure!(
                reflectivity.steps > 0,
                "reflectivity.steps is 0: from the darkest to the brightest there is at least one step"
            );
        }
        if let Some(noise) = &self.shot_noise {
            ensure!(
                noise.electrons_per_count > 1.0 && noise.electrons_per_count.is_finite(),
                "shot_noise.electrons_per_count is {}: a converter that counts single electrons is beyond \
                 what the core can be told of; more than 1 are needed",
                noise.electrons_per_count
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

/// Checks the numbers of the effects that a scene lists: each by its rule, with its unit.
macro_rules! check_numbers {
    ($scene:ident, $($effect:ident.$number:ident: $rule:expr, $unit:literal;)+) => {
        $(if let Some(effect) = &$scene.$effect
            && let Some(number) = effect.$number.into()
        {
            $rule(concat!(stringify!($effect), ".", stringify!($number)), number, $unit)?;
        })+
    };
}

impl Scene {
    fn check_numbers(&self) -> Result<()> {
        check_numbers! { self,
            spot.width: above_zero, "pixels";
            spot.counts_per_second: not_negative, "counts/s";
            laser_spot.waist: at_least(10e-6), "m";
            laser_spot.waist_distance: finite, "m";
            laser_spot.wander: finite, "m/m";
            speckle.linewidth: not_negative, "m";
            speckle.path_spread: not_negative, "m";
            texture.contrast: not_negative, "of the mean";
            texture.length: at_least(1e-6), "m";
            specular_lobe.strength: not_negative, "of the surface's";
            specular_lobe.width: above_zero, "radians";
            specular_lobe.tilt: finite, "radians";
            reflectivity.seconds: above_zero, "s";
            second_reflection.offset: finite, "pixels";
            second_reflection.width: above_zero, "pixels";
            second_reflection.strength: not_negative, "of the spot's";
            motion.speed: finite, "m/s";
            temperature.kelvin_per_second: finite, "K/s";
            temperature.expansion: finite, "/K";
            defocus.focus_distance: above_zero, "m";
            coma.waves: finite, "waves";
            coma.field: above_zero, "m";
            distortion.share: finite, "of the distance";
            distortion.field: above_zero, "m";
            flare.magnification: finite, "times";
            flare.width: above_zero, "pixels";
            flare.strength: not_negative, "of the spot's";
            flare.veil: not_negative, "of the spot's";
            ambient.counts_per_second: not_negative, "counts/s";
            ambient.slope: finite, "counts/s a pixel";
            mains_light.counts_per_second: not_negative, "counts/s";
            mains_light.slope: finite, "counts/s a pixel";
            mains_light.modulation: share, "";
            mains_light.frequency: above_zero, "Hz";
            mains_light.phase: finite, "radians";
            response.deviation: not_negative, "of the mean";
            lag.counts: above_zero, "counts";
            lag.share: share, "";
            hot_pixels.share: share, "";
            hot_pixels.counts_per_second: not_negative, "counts/s";
            saturation.full_well: above_zero, "counts";
            saturation.blooming: share, "";
            black_level.counts: finite, "counts";
            black_level.drift: finite, "counts/s";
            fixed_pattern.counts: not_negative, "counts";
            settling.time_constant: above_zero, "s";
            front_end.gain: above_zero, "times";
            front_end.offset: finite, "counts";
            front_end.saturation: above_zero, "counts";
            read_noise.counts: not_negative, "counts";
            quantisation.step: at_least(0.01), "counts";
        }
        Ok(())
    }
}

fn check_optics(optics: &Optics, sensor: Sensor) -> Result<()> {
    finite("optics.offset", optics.offset, "m")?;
    above_zero("optics.baseline", optics.baseline, "m")?;
    at_least(1e-3)("optics.focal_length", optics.focal_length, "m")?;
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
    finite("optics.axis", optics.axis, "pixels")?;
    above_zero("optics.wavelength", optics.wavelength, "m")?;
    match optics.aperture {
        Aperture::Slit { width, height } => {
            above_zero("optics.aperture.slit.width", width, "m")?;
            above_zero("optics.aperture.slit.height", height, "m")
        }
        Aperture::Lens { diameter } => above_zero("optics.aperture.lens.diameter", diameter, "m"),
    }
}

/// An error that says what a number must be, where it is not.
fn rule(holds: bool, name: &str, value: f64, unit: &str, must: &str) -> Result<()> {
    ensure!(holds, "{name} is {value} {unit}: {must}");
    Ok(())
}

fn finite(name: &str, value: f64, unit: &str) -> Result<()> {
    rule(value.is_finite(), name, value, unit, "give it a number")
}

fn not_negative(name: &str, value: f64, unit: &str) -> Result<()> {
    finite(name, value, unit)?;
    rule(value >= 0.0, name, value, unit, "it cannot be below 0")
}

fn above_zero(name: &str, value: f64, unit: &str) -> Result<()> {
    finite(name, value, unit)?;
    rule(value > 0.0, name, value, unit, "it must be above 0")
}

fn at_least(least: f64) -> impl Fn(&str, f64, &str) -> Result<()> {
    move |name, value, unit| {
        finite(name, value, unit)?;
        let must = format!("it must be {least} {unit} or more");
        rule(value >= least, name, value, unit, &must)
    }
}

fn share(name: &str, value: f64, _: &str) -> Result<()> {
    let is_share = (0.0..=1.0).contains(&value);
    ensure!(is_share, "{name} is {value}: it is a share, from 0 to 1");
    Ok(())
}
