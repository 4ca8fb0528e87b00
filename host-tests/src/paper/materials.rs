//! The paper's six materials. Every number here is chosen: the paper names the materials and gives none of their properties. Each is a
//! property of the surface alone, the same for the lens and the slit.
//!
//! How much light a material reflects does not matter: each data set is exposed so that its mean peak is a quarter of full scale.

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use crate::field::{Laser, Scattering, Surface};

/// A material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// The paper's name for it.
    pub name: &'static str,
    /// How many independent speckle patterns its light is made of, 1 or 2: a metal or a gloss keeps the laser's polarisation,
    /// light that was in paper, wood or fabric has lost it (J. W. Goodman, Speckle Phenomena in Optics (2007), section 4.4).
    pub polarisations: usize,
    /// Mean extra path of light in the material, in metres: volume scattering.
    pub path_spread: f64,
    /// How its brightness depends on the angle between the laser and the camera.
    pub lobe: Lobe,
    /// Its pattern, where it has one.
    pub texture: Option<Texture>,
    /// Standard deviation of its height in metres, as the mean over the spot, from place to place ([`RELIEF_LENGTH`]). The paper's true
    /// position is that of the table: what the surface is higher or lower by counts as an error of every method.
    pub relief: f64,
}

/// The distance along the surface at which the correlation of its height has fallen to exp(-1/2), in metres: about a spot, because the
/// spot's mean smooths what is shorter.
pub const RELIEF_LENGTH: f64 = 0.4e-3;

/// Bright and dark places: the logarithm of the reflectance is a normal random field, whose correlation is gaussian.
///
/// The beam wanders over them while the table moves. Those that are smaller than the spot make little difference; larger ones move
/// its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texture {
    /// Standard deviation of the logarithm.
    pub contrast: f64,
    /// Distance at which the correlation has fallen to exp(-1/2), along the baseline and across, in metres.
    pub length: [f64; 2],
}

/// Brightness over the angle of view, seen along the laser's beam, which is also the direction of the mirror image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// The share of the light that leaves by Lambert's law, at an angle of zero.
    pub diffuse: f64,
    /// Standard deviation of the gaussian that holds the rest, in radians.
    pub width: f64,
}

impl Lobe {
    /// Lambert's law.
    pub const LAMBERT: Self = Self {
        diffuse: 1.0,
        width: 1.0,
    };

    /// Brightness at an angle in radians, over that at zero.
    pub fn brightness(&self, angle: f64) -> f64 {
        let gloss = (-0.5 * (angle / self.width).powi(2)).exp();
        self.diffuse * angle.cos() + (1.0 - self.diffuse) * gloss
    }
}

impl Material {
    /// A piece of it.
    ///
    /// # Errors
    /// The numbers make no surface.
    pub fn surface(&self, laser: &Laser, seed: u64) -> anyhow::Result<Surface> {
        let scattering = Scattering {
            polarisations: self.polarisations,
            path_spread: self.path_spread,
            ..Scattering::surface()
        };
        let surface = Surface::new(laser, &scattering, seed)?;
        Ok(match self.texture {
            Some(texture) => surface.with_reflectance(texture.reflectance(seed)),
            None => surface,
        })
    }

    /// Its height in metres at a place along the baseline.
    pub fn height(&self, seed: u64, place: f64) -> f64 {
        let field = Field::new(seed, RELIEF_STREAM, [RELIEF_LENGTH; 2]);
        self.relief * field.at(place, 0.0)
    }

    /// Its numbers in words.
    pub fn description(&self) -> String {
        let texture = self.texture.map_or("no texture".into(), |texture| {
            let [x, y] = texture.length.map(|length| length * 1e3);
            format!("texture {:.2}, {x:.2} x {y:.2} mm", texture.contrast)
        });
        format!(
            "{}: {} polarisation{}, paths of {:.0} um, lobe {:.0} % diffuse and {:.2} rad wide, {texture}, relief {:.0} um",
            self.name,
            self.polarisations,
            if self.polarisations == 1 { "" } else { "s" },
            self.path_spread * 1e6,
            100.0 * self.lobe.diffuse,
            self.lobe.width,
            self.relief * 1e6
        )
    }
}

impl Texture {
    /// The reflectance at a place (x, y) in metres, with a mean of 1.
    fn reflectance(&self, seed: u64) -> impl Fn(f64, f64) -> f64 + use<> {
        let field = Field::new(seed, TEXTURE_STREAM, self.length);
        let contrast = self.contrast;
        move |x, y| libm::exp(contrast * field.at(x, y) - 0.5 * contrast * contrast)
    }
}

/// A smooth normal random field of variance 1, with a gaussian correlation: waves of random direction, length and phase, whose wave
/// numbers are normal with a standard deviation of one over the correlation's length.
struct Field {
    waves: Vec<[f64; 3]>,
}

/// Waves that make a field: their sum is normal to some per cent.
const WAVES: usize = 48;

/// Streams of random numbers. Those from 0 on are the scatterers'.
const TEXTURE_STREAM: u64 = u64::MAX;
const RELIEF_STREAM: u64 = u64::MAX - 1;

impl Field {
    fn new(seed: u64, stream: u64, length: [f64; 2]) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        let mut wave = || {
            let [x, y] = length.map(|length| {
                let normal: f64 = StandardNormal.sample(&mut random);
                normal / length
            });
            [x, y, std::f64::consts::TAU * random.random::<f64>()]
        };
        Self {
            waves: (0..WAVES).map(|_| wave()).collect(),
        }
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        let wave = |[a, b, phase]: &[f64; 3]| libm::cos(a * x + b * y + phase);
        self.waves.iter().map(wave).sum::<f64>() * (2.0 / WAVES as f64).sqrt()
    }
}

/// All six, in the order of the paper's Table 1.
pub const MATERIALS: [Material; 6] = [
    Material {
        name: "Brushed Metal",
        polarisations: 1,
        path_spread: 0.0,
        // The lobe of a brushed surface across the brushing is some ten degrees wide.
        lobe: Lobe {
            diffuse: 0.1,
            width: 0.3,
        },
        texture: None,
        relief: 3e-6,
    },
    Material {
        name: "Rusty Metal",
        polarisations: 1,
        // Rust is a porous layer.
        path_spread: 20e-6,
        lobe: Lobe {
            diffuse: 0.8,
            width: 0.4,
        },
        // "Unevenly rusted".
        texture: Some(Texture {
            contrast: 0.5,
            length: [0.3e-3, 0.3e-3],
        }),
        relief: 40e-6,
    },
    Material {
        name: "Light Wood Plank",
        polarisations: 2,
        path_spread: 200e-6,
        lobe: Lobe {
            diffuse: 0.9,
            width: 0.4,
        },
        // The grain runs across the baseline.
        texture: Some(Texture {
            contrast: 0.2,
            length: [0.3e-3, 3e-3],
        }),
        relief: 15e-6,
    },
    Material {
        name: "Printer Paper",
        polarisations: 2,
        path_spread: 150e-6,
        lobe: Lobe::LAMBERT,
        texture: None,
        relief: 8e-6,
    },
    Material {
        name: "Black Electric Tape",
        polarisations: 1,
        path_spread: 0.0,
        // Glossy: what is seen at 16 to 27 degrees is the foot of the lobe.
        lobe: Lobe {
            diffuse: 0.1,
            width: 0.15,
        },
        texture: None,
        relief: 8e-6,
    },
    Material {
        name: "Microfiber Fabric",
        polarisations: 2,
        path_spread: 30e-6,
        lobe: Lobe::LAMBERT,
        texture: Some(Texture {
            contrast: 0.5,
            length: [0.3e-3, 0.3e-3],
        }),
        relief: 70e-6,
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean, variance and correlation of the logarithm, over many textures.
    #[test]
    fn texture_has_its_contrast_and_its_length() {
        const TEXTURES: u64 = 2000;
        let texture = Texture {
            contrast: 0.4,
            length: [0.3e-3, 1e-3],
        };
        let (mut mean, mut sum, mut squares, mut products) = (0.0, 0.0, 0.0, [0.0; 2]);
        for seed in 0..TEXTURES {
            let reflectance = texture.reflectance(seed);
            let logarithm = |x, y| reflectance(x, y).ln() + 0.5 * 0.4f64.powi(2);
            let here = logarithm(1e-3, 2e-3);
            mean += reflectance(1e-3, 2e-3);
            sum += here;
            squares += here * here;
            products[0] += here * logarithm(1.3e-3, 2e-3);
            products[1] += here * logarithm(1e-3, 3e-3);
        }
        let n = TEXTURES as f64;
        let (mean, offset, deviation) = (mean / n, sum / n, (squares / n).sqrt());
        let correlation = products.map(|product| product / squares);
        println!(
            "mean {mean:.3}; logarithm {offset:.3} +- {deviation:.3}, correlation {correlation:.3?}"
        );
        // Five standard errors: 1/sqrt(n) deviations of a mean, and 1/sqrt(2 n) of a deviation. That of a log-normal variable
        // is sqrt(exp(0.16) - 1) = 0.42.
        let error = 5.0 / n.sqrt();
        assert!((mean - 1.0).abs() < 0.42 * error && offset.abs() < 0.4 * error);
        assert!((deviation / 0.4 - 1.0).abs() < 0.71 * error);
        assert!(
            correlation
                .iter()
                .all(|c| (c - (-0.5f64).exp()).abs() < error)
        );
    }

    /// The deviation of the height over many pieces, and over one.
    #[test]
    fn relief_has_its_deviation() {
        const PIECES: u64 = 2000;
        let fabric = &MATERIALS[5];
        let square = |seed| fabric.height(seed, 1e-3).powi(2);
        let deviation = ((0..PIECES).map(square).sum::<f64>() / PIECES as f64).sqrt();
        println!("{deviation:e} of {:e}", fabric.relief);
        // Five standard errors.
        assert!((deviation / fabric.relief - 1.0).abs() < 5.0 / (2.0 * PIECES as f64).sqrt());
    }

    #[test]
    fn brightness_falls_with_the_angle() {
        for material in &MATERIALS {
            let at = |degrees: f64| material.lobe.brightness(degrees.to_radians());
            println!("{}: {:.2} {:.2}", material.name, at(16.4), at(26.6));
            assert_eq!(at(0.0), 1.0);
            assert!(at(16.4) < 1.0 && at(26.6) < at(16.4) && at(26.6) > 0.0);
        }
    }
}
