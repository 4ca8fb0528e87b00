//! Records which instructions each call of a function executes. From this, the time on silicon can be
//! estimated.
//!
//! During a traced call the core runs one instruction at a time. This is many times slower, but the firmware
//! cannot see a difference.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// One call of a traced function, from its first instruction to the one that returns.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Call {
    /// The function's address.
    pub function: u64,
    /// For two addresses: how often the instruction at the second was executed directly after the instruction
    /// at the first. Includes the functions that this function calls, and interrupts.
    pub steps: BTreeMap<(u64, u64), u64>,
}

impl Call {
    /// The number of instructions that were executed.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.steps.values().sum()
    }
}

/// The traced functions, and their calls.
#[derive(Debug, Default)]
pub(crate) struct Traces {
    /// The functions' first instructions.
    pub(crate) functions: BTreeSet<u64>,
    /// Their calls, in the order in which they returned.
    pub(crate) calls: Vec<Call>,
}

/// Locks the traces. A panic in another thread leaves them whole, so a poisoned lock is no error.
pub(crate) fn lock(traces: &Arc<Mutex<Traces>>) -> MutexGuard<'_, Traces> {
    traces.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The calls that are under way, the outermost first.
#[derive(Debug, Default)]
pub(crate) struct Recorder {
    /// Each call with its return address.
    open: Vec<(u64, Call)>,
}

impl Recorder {
    pub(crate) fn is_recording(&self) -> bool {
        !self.open.is_empty()
    }

    /// Begins a call of the function at `function`, which returns to `returns_to`.
    pub(crate) fn enter(&mut self, function: u64, returns_to: u64) {
        let call = Call {
            function,
            ..Call::default()
        };
        self.open.push((returns_to, call));
    }

    /// Records that the instruction at `from` was executed and the one at `to` is next. Gives the calls that
    /// end with this.
    pub(crate) fn step(&mut self, from: u64, to: u64) -> Vec<Call> {
        for (_, call) in &mut self.open {
            *call.steps.entry((from, to)).or_default() += 1;
        }
        let mut done = Vec::new();
        while let Some((_, call)) = self.open.pop_if(|(returns_to, _)| *returns_to == to) {
            done.push(call);
        }
        done
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_calls_are_recorded_separately() {
        let mut recorder = Recorder::default();
        recorder.enter(0x100, 0x40);
        assert_eq!(recorder.step(0x100, 0x200), []);
        recorder.enter(0x200, 0x104);
        assert_eq!(recorder.step(0x200, 0x200), []);
        assert_eq!(recorder.step(0x200, 0x202), []);
        let inner = recorder.step(0x202, 0x104);
        assert_eq!(inner.len(), 1);
        assert_eq!((inner[0].function, inner[0].instructions()), (0x200, 3));
        assert_eq!(inner[0].steps[&(0x200, 0x200)], 1);
        let outer = recorder.step(0x104, 0x40);
        assert_eq!((outer[0].function, outer[0].instructions()), (0x100, 5));
        assert!(!recorder.is_recording());
    }
}
