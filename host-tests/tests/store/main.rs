//! The store gives only configurations that were saved, whole, whatever happens to the power or to the flash.

mod configuration;
mod flash;
mod flipped_bits;
mod other_firmware;
mod power_cuts;
#[path = "../records/mod.rs"]
mod records;
mod samples;
mod wear;
