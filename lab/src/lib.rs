//! The programs that write the figures of the docs ([`programs`]). The other modules are what several
//! programs share: the paper's experiment, a scene's error budget, tables, progress bars, and the blocks of
//! Markdown pages that programs write.

pub mod budget;
pub mod comb;
pub mod docs;
pub mod paper;
pub mod programs;
pub mod progress;
pub mod serial_line;
pub mod slowest;
pub mod surfaces;
pub mod table;
pub mod timing;

#[cfg(test)]
mod pages;
#[cfg(test)]
mod tests;
