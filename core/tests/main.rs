//! What the core promises of all its files, and its examples.

mod black_level;
mod examples;
mod memory;
