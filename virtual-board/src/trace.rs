//! Which instructions a function executes, each time it is called: what an estimate of its time on silicon is made from.
//!
//! While a traced function and what it calls are being executed, the core runs an instruction at a time, which is many times
//! slower than otherwise and changes nothing that the firmware can see.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// One call of a traced function, from its first instruction to the one that returns.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Call {
    /// The function's address.
    pub function: u64,
    /// How often the instruction at the first address was executed with that at the second one next. Of what the
    /// function calls too, and of interrupts meanwhile.
    pub steps: BTreeMap<(u64, u64), u64>,
}

impl Call {
    /// The instructions that were executed.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.steps.values().sum()
    }
}

/// What is traced, and what came of it.
#[derive(Debug, Default)]
pub(crate) struct Traces {
    /// The functions' first instructions.
    pub(crate) functions: BTreeSet<u64>,
    /// Their calls, in the order in which they returned.
    pub(crate) calls: Vec<Call>,
}

/// A panic elsewhere leaves nothing half done here.
pub(crate) fn lock(traces: &Arc<Mutex<Traces>>) -> MutexGuard<'_, Traces> {
    traces.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The calls that are under way, the outermost first.
#[derive(Debug, Default)]
pub(crate) struct Recorder {
    /// Each with the address that it returns to.
    open: Vec<(u64, Call)>,
}

impl Recorder {
    pub(crate) fn is_recording(&self) -> bool {
        !self.open.is_empty()
    }

    /// The function at `function` is called, and will return to `returns_to`.
    pub(crate) fn enter(&mut self, function: u64, returns_to: u64) {
        let call = Call {
            function,
            ..Call::default()
        };
        self.open.push((returns_to, call));
    }

    /// The instruction at `from` was executed, and that at `to` is next. Gives the calls that this ended.
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
    fn calls_within_calls() {
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
