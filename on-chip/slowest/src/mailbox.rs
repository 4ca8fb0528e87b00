//! The memory through which descriptions and counts of instructions go: the PC writes and reads it while the
//! program waits.

use slitrange::centre::Estimator;

use crate::description::{self, Description};

/// Number of estimators.
pub const ESTIMATORS: usize = Estimator::ALL.len();

/// Words of a question: the estimator and whether the row follows another, and the row's description.
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
    /// Which estimator takes it.
    pub estimator: Estimator,
    /// Whether the row before comes first, in the same frame.
    pub follows: bool,
}

impl Question {
    /// As words.
    pub fn to_words(&self) -> [u32; QUESTION] {
        let how = [self.estimator as u8, u8::from(self.follows), 0, 0];
        let mut words = [u32::from_le_bytes(how); QUESTION];
        words[1..].copy_from_slice(&self.description.to_words());
        words
    }

    /// From words.
    pub fn from_words(words: &[u32; QUESTION]) -> Self {
        let [how, rest @ ..] = words;
        let [estimator, follows, ..] = how.to_le_bytes();
        let estimator = Estimator::ALL.get(usize::from(estimator)).copied();
        Self {
            description: Description::from_words(rest),
            estimator: estimator.unwrap_or_default(),
            follows: follows != 0,
        }
    }
}
