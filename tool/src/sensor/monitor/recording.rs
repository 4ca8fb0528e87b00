//! The file of `monitor --csv`: a line for each reading and each fault, written as it comes.

use std::fs::File;
use std::path::Path;

use anyhow::{Context, Result};

use crate::sensor::stream::FrameResult;
use crate::whole_file::cannot_be_made;

/// A file that grows.
pub struct Recording {
    file: csv::Writer<File>,
    /// The file's name.
    pub name: String,
    /// Lines in it.
    pub lines: u64,
}

impl Recording {
    /// Makes the file.
    ///
    /// # Errors
    /// It exists, or cannot be made: a recording is never overwritten.
    pub fn create(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let file = File::create_new(path).map_err(|error| cannot_be_made(path, error))?;
        Ok(Self {
            file: csv::Writer::from_writer(file),
            name,
            lines: 0,
        })
    }

    /// Adds a line. It is in the file when this returns.
    pub fn add(&mut self, line: &FrameResult) -> Result<()> {
        let written = self.file.serialize(line).map_err(anyhow::Error::from);
        let flushed = written.and_then(|()| Ok(self.file.flush()?));
        flushed.with_context(|| format!("{} cannot be written", self.name))?;
        self.lines += 1;
        Ok(())
    }
}
