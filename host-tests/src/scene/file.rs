//! Scenes as TOML files.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};

use crate::scene::Scene;

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

    fn check(&self) -> Result<()> {
        ensure!(
            self.distance > 0.0 && self.exposure > 0.0,
            "distance {} m and exposure {} s must be above zero",
            self.distance,
            self.exposure
        );
        Ok(())
    }
}
