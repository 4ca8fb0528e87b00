//! The operations on flash in order. They give the contents after any operation.

use super::contents::{Contents, Operation};
use crate::base::Nanos;

/// An operation and when it began, counted from the power-on of the board that did it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Done {
    /// When it began.
    pub at: Nanos,
    /// The operation.
    pub operation: Operation,
}

/// The first contents of flash, and all operations since.
#[derive(Clone, Debug)]
pub struct History {
    first: Contents,
    /// The operations, in order.
    pub operations: Vec<Done>,
}

impl History {
    /// A history that begins with `first` and has no operations.
    pub fn since(first: Contents) -> Self {
        let operations = vec![];
        Self { first, operations }
    }

    /// How often one of the sectors 12 to 15 was erased.
    pub fn erases_of(&self, sector: usize) -> usize {
        let is_erase = |done: &&Done| done.operation == Operation::Erase { sector };
        self.operations.iter().filter(is_erase).count()
    }

    /// What flash held after the first `count` operations.
    ///
    /// # Panics
    /// The history has fewer operations.
    pub fn after(&self, count: usize) -> Contents {
        let mut contents = self.first.clone();
        for done in &self.operations[..count] {
            contents.apply(done.operation);
        }
        contents
    }

    /// The contents after the first `count` operations and a power cut during the next one. `seed` decides
    /// how much of that one was done.
    ///
    /// # Panics
    /// The history has no operation after the first `count`.
    pub fn torn_after(&self, count: usize, seed: u64) -> Contents {
        let mut contents = self.after(count);
        contents.apply_torn(self.operations[count].operation, seed);
        contents
    }
}

#[cfg(test)]
mod tests {
    use super::super::contents::{BASE, BYTES};
    use super::*;

    #[test]
    fn the_history_gives_the_contents_after_any_operation() {
        let mut history = History::since(Contents::new(vec![0x55; BYTES]).expect("four sectors"));
        let (address, word) = (BASE + 0x4000, 0x0000_00AA);
        let operations = [
            Operation::Erase { sector: 13 },
            Operation::Program { address, word },
            Operation::Erase { sector: 12 },
            Operation::Erase { sector: 13 },
        ];
        let done = operations.into_iter().zip(1..);
        history.operations = done.map(|(operation, at)| Done { at, operation }).collect();
        let words = |contents: Contents| [BASE, address].map(|at| contents.read(at, 4));
        let states = [0, 1, 2, 3, 4].map(|count| words(history.after(count)));
        let (old, erased) = (0x5555_5555, 0xFFFF_FFFF);
        assert_eq!(states[..3], [[old, old], [old, erased], [old, 0xAA]]);
        assert_eq!(states[3..], [[erased, 0xAA], [erased, erased]]);
        assert_eq!((history.erases_of(12), history.erases_of(13)), (1, 2));
        // The power cut is in the second operation, which clears 28 bits. With this seed it clears some of
        // them.
        let [whole, torn] = words(history.torn_after(1, 3));
        assert_eq!(torn & 0xAA, 0xAA);
        assert!(torn != erased && torn != 0xAA, "{torn:#x}");
        assert_eq!(whole, old);
    }
}
