//! `cargo timing`: the pulses of a row, drawn from a row on the virtual board.

use clap::Parser;
use lab::{docs, timing};

/// Runs the firmware on the virtual board and draws the pulses of a row.
#[derive(Parser)]
#[command(name = "cargo timing", bin_name = "cargo timing")]
struct Options {
    /// Rewrite docs/hardware/timing.svg, and the table in docs/hardware.md
    #[arg(long)]
    write: bool,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
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
