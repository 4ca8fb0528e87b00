//! The paper's six materials, which files of `scenes/` describe. The paper names the materials and gives no
//! numbers, so we chose all numbers. They describe the surface alone, and hold for the lens and for the slit.
//!
//! How much light a material reflects does not matter: each data set is exposed so that its mean peak is a
//! quarter of full scale.

use std::sync::LazyLock;

use simulator::field::{Laser, Scattering, Surface, View};
use simulator::scene::{Scene, Speckle, SpecularLobe, Texture};

pub struct Material {
    pub name: &'static str,
    speckle: Speckle,
    /// How its brightness depends on the angle of view, beside Lambert's law.
    lobe: Option<SpecularLobe>,
    texture: Texture,
}

impl Material {
    pub fn surface(&self, laser: &Laser, seed: u64) -> anyhow::Result<Surface> {
        let scattering = Scattering {
            polarisations: self.speckle.polarisations.into(),
            path_spread: self.speckle.path_spread,
            ..Scattering::surface()
        };
        let texture = self.texture.surface(seed);
        let surface = Surface::new(laser, &scattering, seed)?;
        Ok(surface.with_reflectance_along(|x| texture.reflectance(x)))
    }

    /// Light that reaches an aperture, in any unit: the brightness, and the square of the way.
    pub fn light(&self, view: &View) -> f64 {
        let angle = (view.baseline / view.distance).atan();
        self.brightness(angle) / view.range().powi(2)
    }

    /// Brightness at an angle between laser and camera, in radians: Lambert's law, and the lobe.
    fn brightness(&self, angle: f64) -> f64 {
        angle.cos() * self.lobe.map_or(1.0, |lobe| lobe.factor(angle))
    }

    pub fn description(&self) -> String {
        let lobe = self.lobe.map_or("no glossy lobe".into(), |lobe| {
            format!(
                "glossy lobe {} times as bright, {} rad wide",
                lobe.strength, lobe.width
            )
        });
        let polarisations = self.speckle.polarisations;
        let plural = if polarisations == 1 { "" } else { "s" };
        format!(
            "{}: {polarisations} polarisation{plural}; paths in the material {:.0} um; {lobe}; \
             texture of contrast {} over {:.0} um",
            self.name,
            self.speckle.path_spread * 1e6,
            self.texture.contrast,
            self.texture.length * 1e6
        )
    }
}

/// The paper's names in the order of its Table 1, and the scenes.
pub const SCENES: [(&str, &str); 6] = [
    ("Brushed Metal", "brushed-metal"),
    ("Rusty Metal", "rusty-metal"),
    ("Light Wood Plank", "light-wood"),
    ("Printer Paper", "paper-on-camera"),
    ("Black Electric Tape", "black-tape"),
    ("Microfiber Fabric", "microfiber"),
];

/// All six, in the order of [`SCENES`].
pub static MATERIALS: LazyLock<[Material; 6]> = LazyLock::new(|| {
    SCENES.map(|(name, scene)| {
        let scene = Scene::load(scene).expect("a scene of the project");
        Material {
            name,
            speckle: scene.speckle.expect("a surface with speckle"),
            lobe: scene.specular_lobe,
            texture: scene.texture.expect("a surface with texture"),
        }
    })
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_falls_with_the_angle() {
        for material in MATERIALS.iter() {
            let at = |degrees: f64| material.brightness(degrees.to_radians());
            println!("{}: {:.2} {:.2}", material.name, at(16.4), at(26.6));
            assert!(at(16.4) < at(0.0) && at(26.6) < at(16.4) && at(26.6) > 0.0);
        }
    }
}
