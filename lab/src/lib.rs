//! The programs that write the figures of the docs ([`programs`]). The other modules are what several
//! programs share: the paper's experiment, a scene's error budget, tables, progress bars, and the blocks of
//! Markdown pages that programs write.
#![forbid(unsafe_code)]

// A module uses those before it (host-tests/tests/floors.rs). The blank lines keep rustfmt from sorting them.
pub mod docs;

pub mod progress;

pub mod table;

pub mod timing;

pub mod serial_line;

pub mod budget;

pub mod surfaces;

pub mod comb;

pub mod paper;

pub mod slowest;

pub mod programs;

#[cfg(test)]
mod pages;
#[cfg(test)]
mod tests;
