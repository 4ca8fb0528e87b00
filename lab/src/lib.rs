//! The programs that write the figures of the docs. [`main`] runs one of them. The modules beside `programs`
//! are what several programs share: the paper's experiment, a scene's error budget, tables, progress bars,
//! and the blocks of Markdown pages that programs write.
#![forbid(unsafe_code)]

// A module uses those before it (host-tests/tests/floors.rs). The blank lines keep rustfmt from sorting them.
mod prelude;

mod docs;

mod progress;

mod svg;

mod table;

mod timing;

mod serial_line;

mod budget;

mod surfaces;

mod comb;

mod paper;

mod slowest;

mod programs;

pub use programs::main;

#[cfg(test)]
mod pages;
#[cfg(test)]
mod tests;
