//! What the program on the chip computes with, apart from the counting: the same methods, rows and
//! calibrations on the chip and on a PC, so that both can be asked for the same centres and distances.
#![no_std]
#![forbid(unsafe_code)]

// A module uses those before it (host-tests/tests/floors.rs). rustfmt sorts each group.
pub mod calibrations;
pub mod float_functions;
pub mod methods;
pub mod whole_rows;

pub mod inputs;
pub mod rows;
