//! The store: whatever happens to the power or to the flash, what it gives is something that was saved, whole.

mod flash;
mod flipped_bits;
mod later_firmware;
mod power_cuts;
#[path = "../records/mod.rs"]
mod records;
mod samples;
mod saved;
mod wear;
