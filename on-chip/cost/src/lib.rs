//! What the program on the chip computes with, apart from the counting: the same methods, rows and
//! calibrations on the chip and on a PC, so that both can be asked for the same centres and distances.
#![no_std]
#![forbid(unsafe_code)]

pub mod calibrations;
pub mod float_functions;
pub mod inputs;
pub mod methods;
pub mod rows;
pub mod whole_rows;
