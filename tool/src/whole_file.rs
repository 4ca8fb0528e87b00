//! Files that are written whole: whatever happens, there is the old one or the new one.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

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

/// Writes a file's bytes to the disk under another name, in the same directory, and then gives it the file's.
///
/// # Errors
/// The system's; the file is as it was.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let name = path
        .file_name()
        .with_context(|| format!("{} is no file's name", path.display()))?;
    let mut other = name.to_owned();
    other.push(".new");
    let other = path.with_file_name(other);
    let written = File::create(&other)
        .and_then(|mut file| {
            file.write_all(bytes)?;
            file.sync_all()
        })
        .and_then(|()| std::fs::rename(&other, path))
        .and_then(|()| sync_directory(path));
    written.with_context(|| format!("{} cannot be written", path.display()))
}

/// A new name is on the disk when its directory is.
#[cfg(unix)]
fn sync_directory(path: &Path) -> std::io::Result<()> {
    let directory = path
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty());
    File::open(directory.unwrap_or(Path::new(".")))?.sync_all()
}

#[cfg(not(unix))]
fn sync_directory(_: &Path) -> std::io::Result<()> {
    Ok(())
}
