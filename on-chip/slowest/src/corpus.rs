//! The slowest rows that `cargo slowest` found. `cargo slowest --write` writes this file.

use crate::description::WORDS;

/// A slow row: instructions on the chip, and the description's words.
pub type Slow = (u32, [u32; WORDS]);

/// The slowest first row of each estimator.
pub const FIRST: [Slow; 0] = [];

/// The slowest following row of each estimator.
pub const FOLLOWING: [Slow; 0] = [];
