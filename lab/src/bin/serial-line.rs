//! `cargo serial-line`: the reference of commands, settings and faults.

use clap::Parser;
use lab::{docs, serial_line};

/// Prints the reference of commands, settings, estimators and faults, and a session.
#[derive(Parser)]
#[command(name = "cargo serial-line", bin_name = "cargo serial-line")]
struct Options {
    /// Rewrite the reference in docs/serial-line.md, and the session there and in README.md
    #[arg(long)]
    write: bool,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    if options.write {
        return serial_line::write();
    }
    print!("{}", serial_line::reference());
    docs::print_hint("cargo serial-line", serial_line::FILES);
    Ok(())
}
