//! Scenes as TOML files.

use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};

use crate::optics::{Aperture, Optics};
use crate::scene::{Effect, Scene, Sensor, speckle};

/// Pixels of a row: no sensor has more, and each scene's row takes memory and time for all of them.
const LONGEST_ROW: usize = 65_536;

/// Metres across the aperture for which the lattice of the surface's scatterers is made
/// ([`crate::field::Scattering::pitch`]).
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
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
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
        let path = if name.ends_with(".toml") {
            PathBuf::from(name)
        } else {
            folder().join(format!("{name}.toml"))
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
    ///
    /// # Errors
    /// None that are known.
    pub fn to_toml(&self) -> Result<String> {
        Ok(toml::to_string(self)?)
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
        self.check_laser_light()?;
        self.check_lens()?;
        self.check_sensor()
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

    /// Spot, and what acts on its light.
    fn check_laser_light(&self) -> Result<()> {
        let acting_on_the_spot =
            (Effect::ALL.into_iter()).take_while(|effect| *effect != Effect::Ambient);
        for effect in acting_on_the_spot {
            ensure!(
                self.spot.is_some() || !self.lists(effect),
                "[{}] acts on the laser's light, and there is none: add [spot]",
                effect.name()
            );
        }
        if let Some(spot) = &self.spot {
            above_zero("spot.width", spot.width, "pixels")?;
            not_negative("spot.counts_per_second", spot.counts_per_second, "counts/s")?;
        }
        if let Some(spot) = &self.laser_spot {
            at_least("laser_spot.waist", spot.waist, 10e-6, "m")?;
            finite("laser_spot.waist_distance", spot.waist_distance, "m")?;
            finite("laser_spot.wander", spot.wander, "m/m")?;
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
            not_negative("speckle.linewidth", speckle.linewidth, "m")?;
            not_negative("speckle.path_spread", speckle.path_spread, "m")?;
        }
        if let Some(texture) = &self.texture {
            not_negative("texture.contrast", texture.contrast, "of the mean")?;
            at_least("texture.length", texture.length, 1e-6, "m")?;
        }
        if let Some(lobe) = &self.specular_lobe {
            not_negative("specular_lobe.strength", lobe.strength, "of the surface's")?;
            above_zero("specular_lobe.width", lobe.width, "radians")?;
            finite("specular_lobe.tilt", lobe.tilt, "radians")?;
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
            above_zero("reflectivity.seconds", reflectivity.seconds, "s")?;
        }
        if let Some(reflection) = &self.second_reflection {
            finite("second_reflection.offset", reflection.offset, "pixels")?;
            above_zero("second_reflection.width", reflection.width, "pixels")?;
            not_negative(
                "second_reflection.strength",
                reflection.strength,
                "of the spot's",
            )?;
        }
        if let Some(motion) = &self.motion {
            finite("motion.speed", motion.speed, "m/s")?;
        }
        if let Some(temperature) = &self.temperature {
            finite(
                "temperature.kelvin_per_second",
                temperature.kelvin_per_second,
                "K/s",
            )?;
            finite("temperature.expansion", temperature.expansion, "/K")?;
        }
        Ok(())
    }

    fn check_lens(&self) -> Result<()> {
        let of_a_lens = [
            Effect::Defocus,
            Effect::Coma,
            Effect::Distortion,
            Effect::Flare,
        ];
        for effect in of_a_lens {
            ensure!(
                matches!(self.optics.aperture, Aperture::Lens { .. }) || !self.lists(effect),
                "[{}] is a lens's, and there is a slit: make optics.aperture a lens, or leave the effect out",
                effect.name()
            );
        }
        if let Some(defocus) = &self.defocus {
            above_zero("defocus.focus_distance", defocus.focus_distance, "m")?;
        }
        if let Some(coma) = &self.coma {
            finite("coma.waves", coma.waves, "waves")?;
            above_zero("coma.field", coma.field, "m")?;
        }
        if let Some(distortion) = &self.distortion {
            finite("distortion.share", distortion.share, "of the distance")?;
            above_zero("distortion.field", distortion.field, "m")?;
        }
        if let Some(flare) = &self.flare {
            finite("flare.magnification", flare.magnification, "times")?;
            above_zero("flare.width", flare.width, "pixels")?;
            not_negative("flare.strength", flare.strength, "of the spot's")?;
            not_negative("flare.veil", flare.veil, "of the spot's")?;
        }
        Ok(())
    }

    /// Light that is not the laser's, and what the sensor makes of it all.
    fn check_sensor(&self) -> Result<()> {
        if let Some(ambient) = &self.ambient {
            not_negative(
                "ambient.counts_per_second",
                ambient.counts_per_second,
                "counts/s",
            )?;
            finite("ambient.slope", ambient.slope, "counts/s a pixel")?;
        }
        if let Some(lamps) = &self.mains_light {
            not_negative(
                "mains_light.counts_per_second",
                lamps.counts_per_second,
                "counts/s",
            )?;
            finite("mains_light.slope", lamps.slope, "counts/s a pixel")?;
            share("mains_light.modulation", lamps.modulation)?;
            above_zero("mains_light.frequency", lamps.frequency, "Hz")?;
            finite("mains_light.phase", lamps.phase.unwrap_or(0.0), "radians")?;
        }
        if let Some(response) = &self.response {
            not_negative("response.deviation", response.deviation, "of the mean")?;
        }
        if let Some(lag) = &self.lag {
            above_zero("lag.counts", lag.counts, "counts")?;
            share("lag.share", lag.share)?;
        }
        if let Some(hot) = &self.hot_pixels {
            share("hot_pixels.share", hot.share)?;
            not_negative(
                "hot_pixels.counts_per_second",
                hot.counts_per_second,
                "counts/s",
            )?;
        }
        if let Some(noise) = &self.shot_noise {
            ensure!(
                noise.electrons_per_count > 1.0 && noise.electrons_per_count.is_finite(),
                "shot_noise.electrons_per_count is {}: a converter that counts single electrons is beyond \
                 what the core can be told of; more than 1 are needed",
                noise.electrons_per_count
            );
        }
        if let Some(saturation) = &self.saturation {
            above_zero("saturation.full_well", saturation.full_well, "counts")?;
            share("saturation.blooming", saturation.blooming)?;
        }
        if let Some(black) = &self.black_level {
            finite("black_level.counts", black.counts, "counts")?;
            finite("black_level.drift", black.drift, "counts/s")?;
        }
        if let Some(pattern) = &self.fixed_pattern {
            not_negative("fixed_pattern.counts", pattern.counts, "counts")?;
        }
        if let Some(settling) = &self.settling {
            above_zero("settling.time_constant", settling.time_constant, "s")?;
        }
        if let Some(front_end) = &self.front_end {
            above_zero("front_end.gain", front_end.gain, "times")?;
            finite("front_end.offset", front_end.offset, "counts")?;
            let saturation = front_end.saturation.unwrap_or(1.0);
            above_zero("front_end.saturation", saturation, "counts")?;
        }
        if let Some(noise) = &self.read_noise {
            not_negative("read_noise.counts", noise.counts, "counts")?;
        }
        if let Some(quantisation) = &self.quantisation {
            at_least("quantisation.step", quantisation.step, 0.01, "counts")?;
        }
        Ok(())
    }
}

fn check_optics(optics: &Optics, sensor: Sensor) -> Result<()> {
    finite("optics.offset", optics.offset, "m")?;
    above_zero("optics.baseline", optics.baseline, "m")?;
    at_least("optics.focal_length", optics.focal_length, 1e-3, "m")?;
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

fn finite(name: &str, value: f64, unit: &str) -> Result<()> {
    ensure!(
        value.is_finite(),
        "{name} is {value} {unit}: give it a number"
    );
    Ok(())
}

fn not_negative(name: &str, value: f64, unit: &str) -> Result<()> {
    finite(name, value, unit)?;
    ensure!(
        value >= 0.0,
        "{name} is {value} {unit}: it cannot be below 0"
    );
    Ok(())
}

fn above_zero(name: &str, value: f64, unit: &str) -> Result<()> {
    finite(name, value, unit)?;
    ensure!(value > 0.0, "{name} is {value} {unit}: it must be above 0");
    Ok(())
}

fn at_least(name: &str, value: f64, least: f64, unit: &str) -> Result<()> {
    finite(name, value, unit)?;
    ensure!(
        value >= least,
        "{name} is {value} {unit}: it must be {least} {unit} or more"
    );
    Ok(())
}

fn share(name: &str, value: f64) -> Result<()> {
    ensure!(
        (0.0..=1.0).contains(&value),
        "{name} is {value}: it is a share, from 0 to 1"
    );
    Ok(())
}
