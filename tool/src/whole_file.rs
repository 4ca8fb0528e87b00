//! Files that are written whole: whatever happens, there is the old one or the new one.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};

/// The name of a file to write, as a person types it.
///
/// # Errors
/// It is `-`: other programs take that for standard output, and this one would make a file with that name.
pub fn output(name: &str) -> Result<PathBuf, String> {
    match name {
        "-" => Err("name a file: this command does not write to standard output".into()),
        _ => Ok(name.into()),
    }
}

/// Why a file cannot be made, and what to do.
pub fn cannot_be_made(path: &Path, error: io::Error) -> anyhow::Error {
    let file = path.display();
    match (error.kind(), path.parent()) {
        (io::ErrorKind::NotFound, Some(folder)) => {
            let folder = folder.display();
            anyhow!("{file} cannot be made: there is no folder {folder}; make it, or name another")
        }
        (io::ErrorKind::AlreadyExists, _) => {
            anyhow!("{file} cannot be made: it exists; delete it, or take another name")
        }
        _ => anyhow::Error::new(error).context(format!("{file} cannot be written")),
    }
}

/// A file that has another name, in the same directory, until it is whole. Unless it is finished, it is
/// removed.
#[derive(Debug)]
pub struct NewFile {
    path: PathBuf,
    other: PathBuf,
    file: BufWriter<File>,
}

impl NewFile {
    /// Begins a file.
    ///
    /// # Errors
    /// The system's; the file of this name is as it was.
    pub fn create(path: &Path) -> Result<Self> {
        let no_file = || format!("{} is no file's name", path.display());
        let name = path.file_name().with_context(no_file)?;
        let mut other = name.to_owned();
        other.push(".new");
        let other = path.with_file_name(other);
        let file = File::create(&other).map_err(|error| cannot_be_made(path, error))?;
        Ok(Self {
            path: path.to_owned(),
            other,
            file: BufWriter::new(file),
        })
    }

    /// Puts the bytes on the disk, and then gives the file its name.
    ///
    /// # Errors
    /// The system's; the file of this name is as it was.
    pub fn finish(mut self) -> Result<()> {
        let written = (self.file.flush())
            .and_then(|()| self.file.get_ref().sync_all())
            .and_then(|()| std::fs::rename(&self.other, &self.path))
            .and_then(|()| sync_directory(&self.path));
        written.with_context(|| format!("{} cannot be written", self.path.display()))
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        // A finished file has another name. If this fails, nobody can help.
        let _ = std::fs::remove_file(&self.other);
    }
}

/// Writes a file's bytes to the disk under another name, in the same directory, and then gives it the file's.
///
/// # Errors
/// The system's; the file is as it was.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = NewFile::create(path)?;
    (file.write_all(bytes)).with_context(|| format!("{} cannot be written", path.display()))?;
    file.finish()
}

/// A new name is on the disk when its directory is.
#[cfg(unix)]
fn sync_directory(path: &Path) -> std::io::Result<()> {
    let named = |parent: &&Path| !parent.as_os_str().is_empty();
    let directory = path.parent().filter(named);
    File::open(directory.unwrap_or(Path::new(".")))?.sync_all()
}

#[cfg(not(unix))]
fn sync_directory(_: &Path) -> std::io::Result<()> {
    Ok(())
}
