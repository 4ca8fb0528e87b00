//! A calibration record as a file: the bytes that the sensor keeps in its flash ([`slitrange::calibration::record`]).

use std::path::Path;

use anyhow::Context as _;
use slitrange::calibration::record::{MAX_ENCODED, Record, decode, encode};

/// Writes a record to a file. What was there stays until the new one is whole.
///
/// # Errors
/// The record is none that could be read, or the file cannot be written.
pub fn write(path: &Path, record: &Record) -> anyhow::Result<usize> {
    let mut buffer = [0; MAX_ENCODED];
    let bytes = encode(record, &mut buffer)?;
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".new");
    let new = path.with_file_name(name);
    std::fs::write(&new, bytes)
        .and_then(|()| std::fs::rename(&new, path))
        .with_context(|| format!("{} cannot be written", path.display()))?;
    Ok(bytes.len())
}

/// Reads a record from a file.
///
/// # Errors
/// The file cannot be read, or is no record.
pub fn read(path: &Path) -> anyhow::Result<Record> {
    let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
    decode(&bytes).with_context(|| path.display().to_string())
}
