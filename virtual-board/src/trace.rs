//! Records which instructions each call of a function executes.
//!
//! During a traced call the core runs one instruction at a time. This is many times slower, but the firmware
//! cannot see a difference.

use std::collections::{BTreeMap, BTreeSet};

/// A call that is under way: the address of the instruction that called, and that of the function.
pub type CallSite = (u64, u64);

/// One call of a traced function, from its first instruction to the one that returns.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Call {
    /// The function's address.
    pub function: u64,
    /// For two addresses: how often the instruction at the second was executed directly after the instruction
    /// at the first. Includes the functions that this function calls, and interrupts.
    pub steps: BTreeMap<(u64, u64), u64>,
    /// The same instructions by the calls that were under way within this one, the outermost first: how often
    /// the instruction at each address was executed. A function that is jumped to and not called (a tail
    /// call) counts as a part of the function that jumps.
    pub stacks: BTreeMap<Vec<CallSite>, BTreeMap<u64, u64>>,
}

impl Call {
    /// The number of instructions that were executed.
    pub fn instructions(&self) -> u64 {
        self.steps.values().sum()
    }
}

#[derive(Debug, Default)]
pub(crate) struct Traces {
    /// The functions' first instructions.
    pub(crate) functions: BTreeSet<u64>,
    /// Their calls, in the order in which they returned.
    pub(crate) calls: Vec<Call>,
}

/// The traced calls that are under way, the outermost first.
#[derive(Debug, Default)]
pub(crate) struct Recorder {
    open: Vec<Open>,
}

#[derive(Debug)]
struct Open {
    returns_to: u64,
    call: Call,
    /// The calls within it, and where each returns to.
    stack: Vec<(CallSite, u64)>,
    /// What was executed since the stack last changed.
    executed: BTreeMap<u64, u64>,
}

impl Open {
    fn step(&mut self, from: u64, to: u64, link: u64) {
        *self.call.steps.entry((from, to)).or_default() += 1;
        *self.executed.entry(from).or_default() += 1;
        let is_jump = to != from + 2 && to != from + 4;
        if is_jump && (link == from + 2 || link == from + 4) {
            self.file_away();
            self.stack.push(((from, to), link));
        } else if self.stack.last().is_some_and(|(_, end)| *end == to) {
            self.file_away();
            self.stack.pop();
        }
    }

    fn file_away(&mut self) {
        let sites = self.stack.iter().map(|(site, _)| *site).collect();
        let filed = self.call.stacks.entry(sites).or_default();
        for (address, times) in std::mem::take(&mut self.executed) {
            *filed.entry(address).or_default() += times;
        }
    }
}

impl Recorder {
    pub(crate) fn is_recording(&self) -> bool {
        !self.open.is_empty()
    }

    /// Begins a call of the function at `function`, which returns to `returns_to`.
    pub(crate) fn enter(&mut self, function: u64, returns_to: u64) {
        self.open.push(Open {
            returns_to,
            call: Call {
                function,
                ..Call::default()
            },
            stack: vec![],
            executed: BTreeMap::new(),
        });
    }

    /// Records that the instruction at `from` was executed and the one at `to` is next. `link` is what the
    /// link register holds then: a call leaves the address behind itself there. Gives the calls that end with
    /// this.
    pub(crate) fn step(&mut self, from: u64, to: u64, link: u64) -> Vec<Call> {
        for open in &mut self.open {
            open.step(from, to, link);
        }
        let mut done = Vec::new();
        while let Some(mut open) = self.open.pop_if(|open| open.returns_to == to) {
            open.file_away();
            done.push(open.call);
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
        assert_eq!(recorder.step(0x100, 0x200, 0x104), []);
        recorder.enter(0x200, 0x104);
        assert_eq!(recorder.step(0x200, 0x200, 0x104), []);
        assert_eq!(recorder.step(0x200, 0x202, 0x104), []);
        let inner = recorder.step(0x202, 0x104, 0x104);
        assert_eq!(inner.len(), 1);
        assert_eq!((inner[0].function, inner[0].instructions()), (0x200, 3));
        assert_eq!(inner[0].steps[&(0x200, 0x200)], 1);
        let outer = recorder.step(0x104, 0x40, 0x104);
        assert_eq!((outer[0].function, outer[0].instructions()), (0x100, 5));
        assert!(!recorder.is_recording());
    }

    /// A function at 0x100 calls one at 0x200 from two places, which jumps to one at 0x300.
    #[test]
    fn instructions_are_counted_by_the_calls_under_way() {
        let mut recorder = Recorder::default();
        recorder.enter(0x100, 0x40);
        let steps = [
            (0x100, 0x200, 0x104),
            (0x200, 0x300, 0x104),
            (0x300, 0x302, 0x104),
            (0x302, 0x104, 0x104),
            (0x104, 0x108, 0x104),
            (0x108, 0x200, 0x10a),
            (0x200, 0x202, 0x10a),
            (0x202, 0x10a, 0x10a),
        ];
        for (from, to, link) in steps {
            assert_eq!(recorder.step(from, to, link), []);
        }
        let done = recorder.step(0x10a, 0x40, 0x10a);
        let times = |addresses: &[u64]| addresses.iter().map(|&address| (address, 1)).collect();
        let stacks = BTreeMap::from([
            (vec![], times(&[0x100, 0x104, 0x108, 0x10a])),
            (vec![(0x100, 0x200)], times(&[0x200, 0x300, 0x302])),
            (vec![(0x108, 0x200)], times(&[0x200, 0x202])),
        ]);
        assert_eq!(done[0].stacks, stacks);
        let filed = done[0].stacks.values().flat_map(BTreeMap::values);
        assert_eq!(filed.sum::<u64>(), done[0].instructions());
    }
}
