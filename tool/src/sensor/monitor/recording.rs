//! The file of `monitor --csv`: a line for each reading and each fault, written as it comes.

use std::fs::File;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use crate::sensor::stream::{FrameResult, Reading};

/// What a line of the file is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A distance from the laser.
    #[default]
    Reading,
    /// A distance relative to `zero`.
    Difference,
    /// A fault, and the distance of an earlier reading in its place.
    Held,
    /// No distance.
    Fault,
    /// From here on the sensor was away.
    Gap,
}

/// A line of the file. An empty column is one that the sensor did not send.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Recorded {
    /// Seconds since `monitor` began, by the PC's clock.
    pub time_s: f64,
    /// What the line is.
    pub kind: Kind,
    /// The sensor's number of the result.
    pub number: Option<u32>,
    /// The sensor's time of the result, in microseconds.
    pub sensor_us: Option<u64>,
    /// In millimetres.
    pub distance_mm: Option<f64>,
    /// Combined standard uncertainty in millimetres.
    pub u_mm: Option<f64>,
    /// Repeatability in millimetres.
    pub r_mm: Option<f64>,
    /// In pixels.
    pub centre_px: Option<f64>,
    /// In counts.
    pub height_counts: Option<f64>,
    /// In pixels.
    pub width_px: Option<f64>,
    /// Rows used.
    pub rows_used: Option<u16>,
    /// Rows in the frame.
    pub rows: Option<u16>,
    /// In microseconds. Empty: the longest.
    pub exposure_us: Option<u16>,
    /// Slits used of a comb.
    pub slits: Option<u8>,
    /// As the sensor sends them: `m 3 g`.
    pub flags: String,
    /// The fault in the sensor's words, or why it was away.
    pub fault: String,
}

/// A file that grows.
pub struct Recording {
    file: csv::Writer<File>,
    name: String,
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
        let file = File::create_new(path).with_context(|| {
            format!("{name} cannot be made: if it exists, delete it or take another name")
        })?;
        Ok(Self {
            file: csv::Writer::from_writer(file),
            name,
            lines: 0,
        })
    }

    /// The file's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Writes what a frame gave.
    pub fn add(&mut self, at: Duration, result: &FrameResult) -> Result<()> {
        let (reading, kind, fault) = match &result.what {
            Ok(reading) if reading.is_held() => (reading, Kind::Held, ""),
            Ok(reading) if reading.is_difference => (reading, Kind::Difference, ""),
            Ok(reading) => (reading, Kind::Reading, ""),
            Err(fault) => (&Reading::default(), Kind::Fault, fault.as_str()),
        };
        self.write(&Recorded {
            time_s: seconds(at),
            kind,
            number: result.number,
            sensor_us: result.time_us,
            distance_mm: result.what.is_ok().then_some(reading.distance_mm),
            u_mm: reading.u_mm,
            r_mm: reading.r_mm,
            centre_px: reading.centre_px,
            height_counts: reading.height_counts,
            width_px: reading.width_px,
            rows_used: reading.rows.map(|(used, _)| used),
            rows: reading.rows.map(|(_, all)| all),
            exposure_us: reading.exposure_us,
            slits: reading.slits,
            flags: reading.flags.clone(),
            fault: fault.to_owned(),
        })
    }

    /// Writes that the sensor is away.
    pub fn add_gap(&mut self, at: Duration, why: &str) -> Result<()> {
        self.write(&Recorded {
            time_s: seconds(at),
            kind: Kind::Gap,
            fault: why.to_owned(),
            ..Recorded::default()
        })
    }

    /// A line is in the file when this returns.
    fn write(&mut self, line: &Recorded) -> Result<()> {
        self.file
            .serialize(line)
            .map_err(anyhow::Error::from)
            .and_then(|()| Ok(self.file.flush()?))
            .with_context(|| format!("{} cannot be written", self.name))?;
        self.lines += 1;
        Ok(())
    }
}

/// Seconds to the millisecond.
fn seconds(at: Duration) -> f64 {
    at.as_millis() as f64 / 1e3
}
