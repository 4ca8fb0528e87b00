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

use slitrange::base::fault::Fault;
use slitrange::light::ambient::AmbientMode;
use slitrange::reading::Reading;

/// What the steps remember of the readings before.
#[derive(Clone, Debug, Default)]
pub struct Filters {
    /// The latest good readings.
    pub spikes: spike::Spikes,
    average: average::Filter,
    hold: hold::Hold,
    /// When the next line is due.
    pub rate: rate::Rate,
    /// Whether the latest result switched the output of `limits` on.
    pub is_within: bool,
}

impl Filters {
    /// Takes a frame's result, and returns the reading or the fault to put out.
    pub fn take(
        &mut self,
        average: average::Average,
        ambient: AmbientMode,
        result: Result<Reading, Fault>,
    ) -> Result<Reading, Fault> {
        self.average
            .take(average, ambient == AmbientMode::Subtract, result)
    }

    /// Takes what [`Filters::take`] returned. Returns what the stream gives. `results` is how long a reading
    /// is held.
    pub fn hold(
        &mut self,
        results: u16,
        result: Result<Reading, Fault>,
    ) -> Result<hold::Held, Fault> {
        self.hold.take(results, result)
    }

    /// Forgets all readings. The switching output is off until the next one.
    pub fn clear(&mut self) {
        self.spikes.clear();
        self.average.clear();
        self.hold.clear();
        self.is_within = false;
    }
}
