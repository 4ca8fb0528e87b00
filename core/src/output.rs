//! What happens to a reading before it becomes a line, as the settings say.
//!
//! ```text
//! frame's reading -> average -> zero -> columns -> line
//! or fault
//! ```
//!
//! A fault passes all steps, and stays a fault.

pub mod average;
pub mod columns;

use crate::ambient::AmbientMode;
use crate::fault::Fault;
use crate::reading::Reading;
use crate::settings::Settings;

/// What the steps remember of the readings before.
#[derive(Clone, Debug, Default)]
pub struct Output {
    average: average::Filter,
}

impl Output {
    /// Takes a frame's result, and returns the reading or the fault to put out.
    pub fn take(
        &mut self,
        settings: &Settings,
        result: Result<Reading, Fault>,
    ) -> Result<Reading, Fault> {
        let is_ambient_subtracted = settings.ambient == AmbientMode::Subtract;
        (self.average).take(settings.average, is_ambient_subtracted, result)
    }

    /// Forgets all readings.
    pub fn clear(&mut self) {
        self.average.clear();
    }
}
