//! The store gives only configurations that were saved, whole, whatever happens to the power or to the flash.

mod configuration;
mod flash;
mod flipped_bits;
mod other_firmware;
mod power_cuts;
mod samples;
mod wear;
