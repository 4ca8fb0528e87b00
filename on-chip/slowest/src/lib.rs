//! Rows from short descriptions, and the descriptions of the slowest rows that `cargo slowest` found.
//!
//! A description is a list of shapes: spots, bad pixels, slopes and the like. The chip and a PC make the same
//! words from it, to the bit: all is integers, single IEEE 754 operations or functions of `libm`.
#![no_std]
#![forbid(unsafe_code)]

// A module uses those before it (host-tests/tests/floors.rs). rustfmt sorts each group.
pub mod description;
pub mod mailbox;
pub mod words;

pub mod corpus;
