//! `cargo timing`: the pulses of a row, drawn from a row on the virtual board.

use clap::Args;

use crate::{docs, timing};

/// Runs the firmware on the virtual board and draws the pulses of a row.
#[derive(Args)]
pub struct Options {
    /// Rewrite docs/hardware/timing.svg, and the table in docs/hardware.md
    #[arg(long)]
    write: bool,
}

pub fn main(options: &Options) -> anyhow::Result<()> {
    let pulses = timing::Pulses::of_a_row()?;
    let block = (timing::TOOL, pulses.markdown());
    docs::print_or_write("cargo timing", options.write, timing::PAGE, &[block])?;
    if options.write {
        std::fs::write(docs::path(timing::FIGURE), pulses.svg())?;
    }
    Ok(())
}
