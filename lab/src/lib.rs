//! The programs that write the docs' figures, and what they share: the paper's experiment, a scene's error budget, tables, progress
//! bars, the blocks of Markdown pages that programs write, the reference of the serial line, the search for
//! the slowest row, and the pulses of a row.

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
mod tests;
