//! The core cannot panic on the chip.

mod links;
mod shifts;
