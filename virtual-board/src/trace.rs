//! Records which instructions each call of a function executes, or all that the core executes. From this, the
//! time on silicon can be estimated.
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
    /// The same instructions in their order.
    pub path: Vec<Executed>,
}

/// An instruction that was executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Executed {
    /// Its address.
    pub address: u32,
    /// The first address that it loads from; 0 if it loads nothing, or relative to the stack pointer.
    pub loads: u32,
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
    /// All that the core executes, if it is recorded.
    pub(crate) everything: Option<Vec<Executed>>,
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

    /// Adds an instruction to the paths. Call before [`Recorder::step`].
    pub(crate) fn add_to_paths(&mut self, executed: Executed) {
        for (_, call) in &mut self.open {
            call.path.push(executed);
        }
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

    #[test]
    fn a_path_has_the_instructions_of_the_calls_within() {
        let at = |address| Executed { address, loads: 0 };
        let mut recorder = Recorder::default();
        recorder.enter(0x100, 0x40);
        recorder.add_to_paths(at(0x100));
        recorder.step(0x100, 0x200);
        recorder.enter(0x200, 0x104);
        recorder.add_to_paths(at(0x200));
        let inner = recorder.step(0x200, 0x104);
        assert_eq!(inner[0].path, [at(0x200)]);
        recorder.add_to_paths(at(0x104));
        let outer = recorder.step(0x104, 0x40);
        assert_eq!(outer[0].path, [at(0x100), at(0x200), at(0x104)]);
    }
}
