//! `cargo cost`: what accuracy costs in time.
//!
//! Every estimator on the same seeded rows against the Cramér-Rao bound; its instructions on the emulated chip; its time on this
//! computer; and on demand the programs that one would use instead. Prints tables, and writes them with their figures
//! under `docs/`.

mod accuracy;
mod chip;
mod distances;
mod figures;
mod figures_for_help;
mod host_time;
#[cfg(test)]
mod made_up;
mod pareto;
mod peers;
mod reading_time;
mod report;

use std::path::Path;

use anyhow::Context as _;
use clap::Parser;
use lab::docs;
use slitrange::centre::Estimator;

use crate::report::Measured;

/// Rows in a cell that give a ratio to 0.5 %.
const FULL: u64 = 20_000;

/// Measures what each step of accuracy costs in time.
#[derive(Parser)]
#[command(name = "cargo cost")]
struct Options {
    /// Print one JSON object and no tables; docs/ stays as it is
    #[arg(long)]
    json: bool,
    /// Also run the programs that one would use instead, on the same rows
    #[arg(long)]
    peers: bool,
    /// Measure on a NUCLEO-F429ZI that is connected, and nothing else
    #[arg(long)]
    board: bool,
    /// Rows in a cell. docs/ is rewritten only where it is the full number, or with --write
    #[arg(long, value_name = "N", default_value_t = FULL, value_parser = clap::value_parser!(u64).range(1..))]
    rows: u64,
    /// Only what a distance costs by every form of a calibration, and its table in docs/
    #[arg(long)]
    distances: bool,
    /// Only this estimator
    #[arg(long, value_name = "NAME", value_parser = estimator)]
    estimator: Option<Estimator>,
    /// Rewrite docs/ whatever the number of rows
    #[arg(long, conflicts_with_all = ["estimator", "json"])]
    write: bool,
}

fn estimator(name: &str) -> Result<Estimator, String> {
    Estimator::ALL
        .into_iter()
        .find(|estimator| estimator.name() == name)
        .ok_or_else(|| {
            format!(
                "there are {}",
                Estimator::ALL.map(Estimator::name).join(", ")
            )
        })
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    if options.board {
        return chip::on_board();
    }
    if options.distances {
        let chip = chip::measure().context("on the emulated chip")?;
        let distances = distances::measure(&chip)?;
        print!("{}", report::distances(&distances));
        return write_block(
            "docs/accuracy.md",
            DISTANCES,
            &report::distances_markdown(&distances),
        );
    }
    let measured = measure(&options)?;
    if options.json {
        println!("{}", serde_json::to_string_pretty(&measured.json())?);
    } else {
        print!("{}", measured.tables());
    }
    let complete = options.rows >= FULL && options.estimator.is_none() && !options.json;
    if options.write || complete {
        write(&measured)?;
    }
    Ok(())
}

fn measure(options: &Options) -> anyhow::Result<Measured> {
    let estimators: Vec<Estimator> = match options.estimator {
        Some(estimator) => vec![estimator],
        None => Estimator::ALL.to_vec(),
    };
    let chip = chip::measure().context("on the emulated chip")?;
    // Times are taken while nothing else runs.
    let host_ns = estimators
        .iter()
        .map(|&estimator| host_time::nanoseconds(estimator))
        .collect();
    let peers = match options.peers {
        true => Some(peers_beside(&chip)?),
        false => None,
    };
    Ok(Measured {
        accuracy: accuracy::measure(&estimators, options.rows),
        readings: reading_time::measure((options.rows / 100).max(8))?,
        estimators,
        distances: distances::measure(&chip)?,
        chip,
        host_ns,
        peers,
    })
}

/// The peers, with their instructions on the chip over the default rung's on the same rows.
fn peers_beside(chip: &chip::Chip) -> anyhow::Result<peers::Peers> {
    let mut peers = peers::run(&peers::Options::default()).context("the peers")?;
    let default = report::on_chip(chip, Estimator::default(), report::PEERS_WIDTH)
        .context("the default rung finds no centre on the chip")?;
    for peer in &chip.peers {
        let ratio = peer.instructions as f64 / default.instructions as f64;
        // Some ran on the chip only: with other starting values.
        peers.set_chip_instruction_ratio(&peer.name, ratio);
    }
    Ok(peers)
}

/// Rewrites the tables and figures under `docs/`, and the firmware's own copy of the figures.
fn write(measured: &Measured) -> anyhow::Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .context("the workspace")?;
    measured.write_csv(&root.join("docs/cost"))?;
    figures::draw(measured, &root.join("docs/figures"))?;
    write_block("docs/accuracy.md", ALL, &measured.markdown())?;
    write_block("README.md", ALL, &measured.short_markdown())?;
    let distances = report::distances_markdown(&measured.distances);
    write_block("docs/accuracy.md", DISTANCES, &distances)?;
    std::fs::write(
        root.join("src/estimator/figures/measured.rs"),
        figures_for_help::source(measured),
    )?;
    Ok(())
}

/// The blocks that this writes.
const ALL: &str = "cargo cost";
const DISTANCES: &str = "cargo cost --distances";

/// Rewrites a block of a page, which is named from the workspace's root.
fn write_block(page: &str, name: &str, block: &str) -> anyhow::Result<()> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(page);
    let text = std::fs::read_to_string(&page).with_context(|| page.display().to_string())?;
    Ok(std::fs::write(
        &page,
        docs::with_block(&text, name, block)?,
    )?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A look with few rows goes through all of it but the chip: 64 rows give a ratio to 9 %.
    #[test]
    fn a_quick_look_comes_near_the_bound() {
        let accuracy = accuracy::measure(&[Estimator::default()], 64);
        let worst = accuracy.worst(Estimator::default());
        println!("{worst:?}");
        assert_eq!(
            accuracy.cells.len(),
            accuracy::WIDTHS.len() * accuracy::NOISES.len()
        );
        assert!(worst.white > 0.9 && worst.white < 1.5 && worst.shot < 1.5);
        assert!(worst.bias.is_some_and(|bias| bias < 1e-3));
        assert!(host_time::nanoseconds(Estimator::default()).is_some_and(|ns| ns > 1.0));
    }

    #[test]
    fn estimators_are_known_by_their_names() {
        assert_eq!(estimator("gauss-newton"), Ok(Estimator::GaussNewton));
        assert!(estimator("none").is_err());
    }
}
