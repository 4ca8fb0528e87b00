//! What every estimator answers to a row, in words of 32 bits: the same code on the chip and on a PC, so that
//! the words can be compared.
#![no_std]
#![forbid(unsafe_code)]

pub mod answers;
pub mod mailbox;
