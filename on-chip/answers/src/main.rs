//! Answers the rows that a test puts into its memory, on the emulated board: see
//! `virtual-board/tests/answers.rs`.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod chip;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!("This waits on the chip for a test's rows: `cargo test answers::`.");
    std::process::ExitCode::FAILURE
}
