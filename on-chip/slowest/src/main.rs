//! Makes rows from descriptions that a PC puts into its memory, and counts the instructions that the
//! measurement takes for each, on the emulated board: see `cargo slowest`.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod chip;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!("This waits on the chip for descriptions of rows: `cargo slowest`.");
    std::process::ExitCode::FAILURE
}
