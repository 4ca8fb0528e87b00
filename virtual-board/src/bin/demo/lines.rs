//! Parses the firmware's lines.

use std::str::FromStr;

use anyhow::{Context as _, Result};
use slitrange::base::fault::Fault;

#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Distance in millimetres.
    pub distance: f64,
    /// Its combined standard uncertainty u in millimetres.
    pub uncertainty: f64,
    /// Its repeatability r in millimetres.
    pub repeatability: f64,
    /// Centre in pixels.
    pub centre: f64,
    /// Amplitude in counts.
    pub amplitude: f64,
    pub rows: u16,
    /// For how long the laser was on in a row, in microseconds.
    pub exposure: u16,
    /// The slits used: 1 for a sensor with one slit.
    pub slits: u8,
    pub flags: String,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Report {
    Reading(Reading),
    Fault(String),
}

impl Report {
    /// Parses a result. `None` for other lines (an answer, an error).
    ///
    /// # Errors
    /// The line begins like a reading but is malformed.
    pub fn parse(line: &str) -> Result<Option<Self>> {
        if let Some(fault) = line.strip_prefix("f ") {
            let known = Fault::NAMES.iter().any(|name| fault.starts_with(name));
            return Ok(known.then(|| Self::Fault(fault.to_owned())));
        }
        if !line.starts_with("d ") {
            return Ok(None);
        }
        let words: Vec<&str> = line.split(' ').collect();
        let place = |name: &str| words.iter().position(|word| *word == name);
        // A line leaves out the longest exposure, and one slit.
        let value = |name: &str, default: &'static str| match place(name) {
            Some(place) => words.get(place + 1).copied().unwrap_or_default(),
            None => default,
        };
        let last = ["k", "t", "n"].into_iter().find_map(place);
        let last = last.unwrap_or_default();
        let used = value("n", "").split('/').next().unwrap_or_default();
        Ok(Some(Self::Reading(Reading {
            distance: number(line, value("d", ""))?,
            uncertainty: number(line, value("u", ""))?,
            repeatability: number(line, value("r", ""))?,
            centre: number(line, value("x", ""))?,
            amplitude: number(line, value("a", ""))?,
            rows: number(line, used)?,
            exposure: number(line, value("t", "5600"))?,
            slits: number(line, value("k", "1"))?,
            flags: words[(last + 2).min(words.len())..].join(" "),
        })))
    }
}

fn number<T: FromStr>(line: &str, word: &str) -> Result<T> {
    let number = word.parse().ok();
    number.with_context(|| format!("{word:?} in {line:?} is no such number"))
}
