//! Limits that the firmware violated.

use std::fmt;

use crate::base::Nanos;

/// How many violations are kept. The first ones show what is wrong.
const KEPT: usize = 200;

/// A limit that the firmware violated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// When the violation was seen.
    pub at: Nanos,
    /// What happened, the limit, and where the limit comes from.
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { at, what } = self;
        write!(formatter, "at {:.6} ms: {what}", *at as f64 / 1e6)
    }
}

/// The first violations, oldest first, and the number of all.
#[derive(Clone, Debug, Default)]
pub struct Violations {
    /// At most 200.
    pub first: Vec<Violation>,
    /// All of them.
    pub count: u64,
}

impl Violations {
    pub(crate) fn add(&mut self, at: Nanos, what: impl Into<String>) {
        self.count += 1;
        if self.first.len() < KEPT {
            let what = what.into();
            self.first.push(Violation { at, what });
        }
    }
}
