//! The whole of the core for the chip, in a program that links only if no panic is reachable: the panic
//! handler calls a function that nobody defines. What the optimiser proves unreachable, it leaves out, and
//! the call with it.
//!
//! It is not for running. `cargo test links::` builds it, as the firmware is built and with
//! checks for overflow on.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod chip;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!("This is linked for the chip, and never run: cargo test links::");
    std::process::ExitCode::FAILURE
}
