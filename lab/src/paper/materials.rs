//! The paper's six materials. Every number here is chosen: the paper names the materials and gives none of
//! their properties. Each is a property of the surface alone, the same for the lens and the slit.
//!
//! How much light a material reflects does not matter: each data set is exposed so that its mean peak is a
//! quarter of full scale.

use simulator::field::{Laser, Scattering, Surface};
use simulator::scene::{SpecularLobe, Texture};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    pub name: &'static str,
    /// How many independent speckle patterns its light is made of, 1 or 2: a metal or a gloss keeps the
    /// laser's polarisation, light that was in paper, wood or fabric has lost it (J. W. Goodman, Speckle
    /// Phenomena in Optics (2007), section 4.4).
    pub polarisations: usize,
    /// Mean extra path of light in the material, in metres: volume scattering.
    pub path_spread: f64,
    /// How its brightness depends on the angle of view, beside Lambert's law.
    pub lobe: Option<SpecularLobe>,
    pub texture: Texture,
}

impl Material {
    pub fn surface(&self, laser: &Laser, seed: u64) -> anyhow::Result<Surface> {
        let scattering = Scattering {
            polarisations: self.polarisations,
            path_spread: self.path_spread,
            ..Scattering::surface()
        };
        let texture = self.texture.surface(seed);
        let surface = Surface::new(laser, &scattering, seed)?;
        Ok(surface.with_reflectance_along(|x| texture.reflectance(x)))
    }

    /// Brightness at an angle between laser and camera, in radians: Lambert's law, and the lobe.
    pub fn brightness(&self, angle: f64) -> f64 {
        angle.cos() * self.lobe.map_or(1.0, |lobe| lobe.factor(angle))
    }

    pub fn description(&self) -> String {
        let lobe = self.lobe.map_or("no glossy lobe".into(), |lobe| {
            format!(
                "glossy lobe {} times as bright, {} rad wide",
                lobe.strength, lobe.width
            )
        });
        let plural = if self.polarisations == 1 { "" } else { "s" };
        format!(
            "{}: {} polarisation{plural}; paths in the material {:.0} um; {lobe}; \
             texture of contrast {} over {:.0} um",
            self.name,
            self.polarisations,
            self.path_spread * 1e6,
            self.texture.contrast,
            self.texture.length * 1e6
        )
    }
}

const fn lobe(strength: f64, width: f64) -> Option<SpecularLobe> {
    Some(SpecularLobe {
        strength,
        width,
        tilt: 0.0,
    })
}

const fn texture(contrast: f64, length: f64) -> Texture {
    Texture { contrast, length }
}

/// All six, in the order of the paper's Table 1.
pub const MATERIALS: [Material; 6] = [
    // Scratches finer than the spot, and a lobe some ten degrees wide across them.
    Material {
        name: "Brushed Metal",
        polarisations: 1,
        path_spread: 0.0,
        lobe: lobe(9.0, 0.3),
        texture: texture(0.3, 50e-6),
    },
    // A porous layer of grains.
    Material {
        name: "Rusty Metal",
        polarisations: 1,
        path_spread: 20e-6,
        lobe: lobe(0.25, 0.4),
        texture: texture(0.5, 100e-6),
    },
    // Light goes some cells deep; early wood and late wood differ.
    Material {
        name: "Light Wood Plank",
        polarisations: 2,
        path_spread: 150e-6,
        lobe: lobe(0.1, 0.4),
        texture: texture(0.2, 300e-6),
    },
    // A sheet is 0.1 mm thick, and even.
    Material {
        name: "Printer Paper",
        polarisations: 2,
        path_spread: 100e-6,
        lobe: None,
        texture: texture(0.05, 200e-6),
    },
    // Glossy: what is seen at 16 to 27 degrees is the foot of the lobe. The surface is embossed a little.
    Material {
        name: "Black Electric Tape",
        polarisations: 1,
        path_spread: 0.0,
        lobe: lobe(9.0, 0.15),
        texture: texture(0.1, 200e-6),
    },
    // Fibres of some micrometres in bundles, with shadows between them.
    Material {
        name: "Microfiber Fabric",
        polarisations: 2,
        path_spread: 20e-6,
        lobe: None,
        texture: texture(0.8, 100e-6),
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_falls_with_the_angle() {
        for material in &MATERIALS {
            let at = |degrees: f64| material.brightness(degrees.to_radians());
            println!("{}: {:.2} {:.2}", material.name, at(16.4), at(26.6));
            assert!(at(16.4) < at(0.0) && at(26.6) < at(16.4) && at(26.6) > 0.0);
        }
    }
}
