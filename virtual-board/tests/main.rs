//! Tests of programs for the chip on the virtual board: the firmware, `answers-on-chip` and `silicon-check`.
//! They are one test program, so the firmware is built and loaded only once.

mod answers;
mod firmware;
mod silicon_check;
