//! `cargo demo`: runs the firmware on the emulated board, with a target that moves.
#![forbid(unsafe_code)]

mod command_line;
#[cfg(unix)]
mod flash_file;
mod lines;
mod moving_target;
mod photograph;
#[cfg(unix)]
mod terminal;

use anyhow::{Context as _, Result};
use clap::Parser as _;
use virtual_board::Firmware;

use crate::command_line::Options;

fn main() -> Result<()> {
    let options = Options::parse();
    eprintln!("building the firmware ...");
    let firmware = Firmware::build()?;
    let summary = match &options.pgm {
        Some(path) => serde_json::to_value(photograph::show(&firmware, path, options.json)?),
        #[cfg(unix)]
        None if options.pty => return terminal::serve(&firmware, &options),
        #[cfg(not(unix))]
        None if options.pty => anyhow::bail!("--pty needs a system with pseudo-terminals"),
        None => serde_json::to_value(moving_target::measure(&firmware, &options)?),
    };
    if options.json {
        println!("{}", summary.context("writing the summary as JSON")?);
    }
    Ok(())
}
