//! What happens to a reading before it becomes a line, as the settings say.
//!
//! ```text
//! frame's reading -> spike-filter -> average -> hold -> zero -> rate -> columns, units -> line
//! or fault                                                    -> limits -> switching output
//! ```
//!
//! `spike-filter` makes a fault of a reading that jumps. A fault passes all steps, and stays a fault. Only
//! `hold` gives a flagged reading in its place, and not in packets.

pub mod average;
pub mod hold;
pub mod limits;
pub mod rate;
pub mod spike;
pub mod zero;

/// What the steps remember of the readings before.
#[derive(Clone, Debug, Default)]
pub struct Filters {
    /// The latest good readings.
    pub spikes: spike::Spikes,
    /// The latest results of the average.
    pub average: average::Filter,
    /// The reading that may be held.
    pub hold: hold::Hold,
    /// When the next line is due.
    pub rate: rate::Rate,
    /// Whether the latest result switched the output of `limits` on.
    pub is_within: bool,
}

impl Filters {
    /// Forgets all readings. The switching output is off until the next one.
    pub fn clear(&mut self) {
        self.spikes.clear();
        self.average.clear();
        self.hold.clear();
        self.is_within = false;
    }
}
