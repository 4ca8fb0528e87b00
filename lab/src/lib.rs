//! What the programs of this package share: the paper's experiment, a scene's error budget, and how pages in
//! docs/ are rewritten, and the reference of the serial line.

pub mod budget;
pub mod docs;
pub mod paper;
pub mod serial_line;
