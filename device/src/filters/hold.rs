//! The setting `hold`: after a fault, the last reading for some results.

use slitrange::{Fault, Reading};

/// What a line gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Held {
    /// The reading.
    pub reading: Reading,
    /// For how many results it has been held; 0 for the reading of this frame. The line has the flag `h` with
    /// this number.
    pub results: u16,
}

/// Remembers the last reading.
#[derive(Clone, Debug, Default)]
pub struct Hold {
    last: Option<Held>,
}

impl Hold {
    /// Forgets the last reading.
    pub fn clear(&mut self) {
        self.last = None;
    }

    /// Takes a result. Instead of a fault it returns the last reading, for at most so many results in
    /// succession.
    pub fn take(&mut self, most: u16, result: Result<Reading, Fault>) -> Result<Held, Fault> {
        let held = match (result, self.last) {
            (Ok(reading), _) => Ok(Held {
                reading,
                results: 0,
            }),
            (Err(_), Some(held)) if held.results < most => Ok(Held {
                results: held.results.saturating_add(1),
                ..held
            }),
            (Err(fault), _) => Err(fault),
        };
        self.last = held.ok();
        held
    }
}
