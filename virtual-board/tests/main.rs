//! Programs for the chip on the virtual board: the firmware, and those that answer about rows and check silicon.
//! One test program, so that the firmware is built and loaded only once.

mod answers;
mod firmware;
mod silicon_check;
