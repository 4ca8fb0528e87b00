//! `cargo serial-line`: the reference of commands, settings and faults.

use clap::Args;

use crate::{docs, serial_line};

/// Prints the reference of commands, settings, estimators and faults, and a session.
#[derive(Args)]
pub struct Options {
    /// Rewrite the reference in docs/serial-line.md, and the session there and in README.md
    #[arg(long)]
    write: bool,
}

pub fn main(options: &Options) -> anyhow::Result<()> {
    if options.write {
        return serial_line::write();
    }
    print!("{}", serial_line::reference());
    docs::print_hint("cargo serial-line", serial_line::FILES);
    Ok(())
}
