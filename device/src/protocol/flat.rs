//! The command `flat`, which takes and uses the map of the pixels, and its answer.

use core::fmt;

use crate::protocol::command::Command;
use crate::store::encoded_map::VERSION;
use crate::store::pixel_map::StoredMap;
use slitrange::row::pixels::PixelErrors;
use slitrange::row::pixels::flat_field::Kind;
use slitrange::row::pixels::map::MapSummary;

/// The forms of `flat`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flat {
    /// Show the map.
    Show,
    /// Take dark or lit rows.
    Take(Kind),
    /// Write the map to flash.
    Save,
    /// Use the map, or do not.
    Use(bool),
    /// Erase the map, in flash too.
    Erase,
}

impl fmt::Display for Flat {
    /// The line that is read as this command.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Command::Flat(*self).fmt(f)
    }
}

/// The answer to `flat`, lines parted by CR LF. The first is `flat on`, `flat off` or, without a map,
/// `flat none`. The last is `flat stored`.
#[derive(Clone, Copy, Debug)]
pub struct FlatAnswer<'a> {
    /// The map, if there is one.
    pub map: Option<&'a MapSummary>,
    /// Whether rows are corrected with the map.
    pub is_on: bool,
    /// Whether the next step is `flat lit`.
    pub has_dark_rows: bool,
    /// What flash holds.
    pub stored: StoredMap,
    /// Whether the map is the one in flash.
    pub is_stored: bool,
}

impl fmt::Display for FlatAnswer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.map {
            None => f.write_str("flat none")?,
            Some(map) => {
                write!(f, "{}", Flat::Use(self.is_on))?;
                write!(f, "\r\nflat remaining {}", Remaining(map.errors))?;
                write!(f, "\r\nflat outside {} pixels", map.outside)?;
            }
        }
        if self.has_dark_rows {
            f.write_str("\r\nflat taking: light the sensor evenly, then flat lit")?;
        }
        match self.stored {
            StoredMap::Nothing | StoredMap::Newest => {}
            StoredMap::Later(version) => write!(
                f,
                "\r\nflat fault the saved map has version {version}, this firmware reads {VERSION}: update \
                 the firmware, or take a map and flat save"
            )?,
            StoredMap::Older => f.write_str(
                "\r\nflat fault the last save is unusable, flash holds an earlier map: take a map again, or \
                 flat save",
            )?,
            StoredMap::Unusable => f.write_str(
                "\r\nflat fault the saved map cannot be used: take a map again and flat save, or flat none",
            )?,
        }
        let stored = match self.stored {
            StoredMap::Nothing => "none",
            StoredMap::Later(_) | StoredMap::Unusable => "unusable",
            StoredMap::Newest | StoredMap::Older if self.is_stored => "same",
            StoredMap::Newest | StoredMap::Older => "other",
        };
        write!(f, "\r\nflat stored {stored}")
    }
}

/// How far pixels differ, with a map or without one: `response 0.058 % offset 0.26 counts`.
#[derive(Clone, Copy, Debug)]
pub struct Remaining(pub PixelErrors);

impl fmt::Display for Remaining {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Thousandths of a per cent, rounded: below 2^16 * 10^5 < 2^33.
        let response = (u64::from(self.0.response_q16) * 100_000 + 0x8000) >> 16;
        let (whole, decimals) = (response / 1000, response % 1000);
        let offset = self.0.offset;
        write!(f, "response {whole}.{decimals:03} % ")?;
        write!(f, "offset {offset:.2} counts")
    }
}
