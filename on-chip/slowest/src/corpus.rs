//! The slowest rows that `cargo slowest` found: `cargo slowest --write` writes `corpus.in`.

use crate::description::WORDS;
use crate::mailbox::ESTIMATORS;

/// A slow row: instructions on the chip, and the description's words.
pub type Slow = (u32, [u32; WORDS]);

/// The slowest first row of each estimator, and the slowest following row of each.
pub const SLOWEST: [[Slow; ESTIMATORS]; 2] = include!("corpus.in");
