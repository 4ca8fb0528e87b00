//! The paper's six materials. Every number here is chosen: the paper names the materials and gives none of their properties. Each is a
//! property of the surface alone, the same for the lens and the slit.
//!
//! How much light a material reflects does not matter: each data set is exposed so that its mean peak is a quarter of full scale.

use crate::field::Scattering;

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
    /// What the surface's field is made of.
    pub fn scattering(&self) -> Scattering {
        Scattering {
            polarisations: self.polarisations,
            path_spread: self.path_spread,
            ..Scattering::surface()
        }
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
    },
    Material {
        name: "Light Wood Plank",
        polarisations: 2,
        path_spread: 300e-6,
        lobe: Lobe {
            diffuse: 0.9,
            width: 0.4,
        },
    },
    Material {
        name: "Printer Paper",
        polarisations: 2,
        path_spread: 150e-6,
        lobe: Lobe::LAMBERT,
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
    },
    Material {
        name: "Microfiber Fabric",
        polarisations: 2,
        path_spread: 100e-6,
        lobe: Lobe::LAMBERT,
    },
];

#[cfg(test)]
mod tests {
    use super::*;

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
