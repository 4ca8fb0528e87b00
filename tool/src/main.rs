//! `slitrange`: see `slitrange --help`.
#![forbid(unsafe_code)]

use std::io;
use std::process::ExitCode;

use slitrange_tool::Command;
use slitrange_tool::keyboard::Keyboard;
use slitrange_tool::pc::RealPc;

/// The exit code of whatever went wrong: 1 says that two records differ, as with `cmp`.
const FAILED: u8 = 2;

fn main() -> ExitCode {
    let (pc, mut keyboard) = (RealPc::default(), Keyboard::default());
    let command = Command::read(std::env::args_os()).unwrap_or_else(|error| error.exit());
    let outcome = command.run(&pc, &mut keyboard, &mut io::stdout());
    outcome.unwrap_or_else(|error| {
        eprintln!("slitrange: {error:#}");
        ExitCode::from(FAILED)
    })
}
