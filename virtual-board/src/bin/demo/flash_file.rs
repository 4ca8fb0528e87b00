//! Keeps the contents of the sensor's flash in a file.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use virtual_board::SharedFlash;
use virtual_board::flash::Contents;

pub struct FlashFile {
    path: PathBuf,
    pub flash: SharedFlash,
}

impl FlashFile {
    /// Reads the contents from the file at `path`. Without a file, flash is erased.
    ///
    /// # Errors
    /// The file cannot be read, or its size is not that of the flash.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_owned();
        let contents = match fs::read(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Contents::erased()),
            read => read.map_err(Into::into).and_then(Contents::new),
        };
        let contents = contents.with_context(|| format!("reading {}", path.display()))?;
        let flash = SharedFlash::holding(contents);
        Ok(Self { path, flash })
    }

    /// Writes the file if the flash has changed. If the process ends at any moment, the file holds one whole
    /// state.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn keep(&mut self) -> Result<()> {
        if self.flash.take_history().operations.is_empty() {
            return Ok(());
        }
        let unfinished = self.path.with_added_extension("unfinished");
        fs::write(&unfinished, self.flash.contents().bytes())
            .and_then(|()| fs::rename(&unfinished, &self.path))
            .with_context(|| format!("writing {}", self.path.display()))
    }
}
