//! All that exists only on the chip.

pub mod board;
pub mod counter;
pub mod distances;
pub mod float_functions;
pub mod kernels;
pub mod methods;
pub mod peers;
pub mod steps;
pub mod whole_rows;

// Linked for what they define: where the log goes, and what a panic does.
use {defmt_rtt as _, panic_probe as _};
