//! The memory through which descriptions and counts of instructions go: the PC writes and reads it while the
//! program waits.

use slitrange::centre::Estimator;

use crate::description::{self, Description};

/// Estimators that take each row.
pub const ESTIMATORS: usize = Estimator::ALL.len();

/// Words of a question: whether the row follows another, and its description.
pub const QUESTION: usize = 1 + description::WORDS;

/// The most questions at once.
pub const QUESTIONS: usize = 256;

/// What the program says in place of a number of questions when it waits for them.
pub const READY: u32 = u32::MAX;

/// A row to count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Question {
    /// The row.
    pub description: Description,
    /// Whether the row before comes first, in the same frame.
    pub follows: bool,
}

impl Question {
    /// As words.
    pub fn to_words(&self) -> [u32; QUESTION] {
        let mut words = [u32::from(self.follows); QUESTION];
        words[1..].copy_from_slice(&self.description.to_words());
        words
    }

    /// From words.
    pub fn from_words(words: &[u32; QUESTION]) -> Self {
        let [follows, rest @ ..] = words;
        Self {
            description: Description::from_words(rest),
            follows: *follows != 0,
        }
    }
}
