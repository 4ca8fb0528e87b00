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

/// Runs the program.
///
/// # Errors
/// A measurement fails, or a file cannot be read or written.
pub fn main(options: &Options) -> anyhow::Result<()> {
    let pulses = timing::Pulses::of_a_row()?;
    print!("{}", pulses.markdown());
    if options.write {
        docs::write_block(timing::PAGE, timing::TOOL, &pulses.markdown())?;
        std::fs::write(docs::path(timing::FIGURE), pulses.svg())?;
    } else {
        docs::print_hint("cargo timing", "docs/hardware.md and its figure timing.svg");
    }
    Ok(())
}
