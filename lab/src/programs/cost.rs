//! `cargo cost`: what accuracy costs in time.
//!
//! Every estimator, and the check's repair, on the same seeded rows against the Cramér-Rao bound; its instructions on the emulated chip; its time on this computer; and on demand the
//! programs that one would use instead. Prints tables. With `--write` it also rewrites the tables and figures
//! of README.md and docs/.

mod accuracy;
mod chip;
mod distances;
mod figures;
mod float_functions;
mod host_time;
mod pareto;
mod peers;
mod reading_time;
mod report;
#[cfg(test)]
mod sample_measurements;

use anyhow::Context as _;
use clap::Args;
use cost_on_chip::methods::Method;
use slitrange::centre::Estimator;

use self::report::Measured;
use crate::docs;

/// Rows in a cell that give a ratio to 0.5 %.
const FULL: u64 = 20_000;

/// Measures what each step of accuracy costs in time.
#[derive(Args)]
pub struct Options {
    /// Print one JSON object and no tables
    #[arg(long)]
    json: bool,
    /// Also run the programs that one would use instead, on the same rows
    #[arg(long)]
    peers: bool,
    /// Measure on a NUCLEO-F429ZI that is connected, and nothing else
    #[arg(long)]
    board: bool,
    /// Rows in a cell. Fewer are faster, and the ratios are less exact
    #[arg(long, value_name = "N", default_value_t = FULL, value_parser = clap::value_parser!(u64).range(1..))]
    rows: u64,
    /// Only what a distance costs by every form of a calibration
    #[arg(long)]
    distances: bool,
    /// Only this estimator, or `repair`
    #[arg(long = "estimator", value_name = "NAME", value_parser = method)]
    method: Option<Method>,
    /// Also rewrite the tables and figures that show these results. With --distances: only the table of
    /// distances
    #[arg(long, conflicts_with_all = ["method", "json", "board"])]
    write: bool,
}

fn method(name: &str) -> Result<Method, String> {
    Method::ALL
        .into_iter()
        .find(|method| method.name() == name)
        .ok_or_else(|| format!("there are {}", Method::ALL.map(Method::name).join(", ")))
}

/// Runs the program.
///
/// # Errors
/// A measurement fails, or a file cannot be read or written.
pub fn main(options: &Options) -> anyhow::Result<()> {
    if options.board {
        return chip::on_board();
    }
    if options.distances {
        let chip = chip::measure().context("on the emulated chip")?;
        let distances = distances::measure(&chip)?;
        print!("{}", report::distances_markdown(&distances));
        if options.write {
            return write_distances(&distances);
        }
        docs::print_hint("cargo cost --distances", ACCURACY);
        return Ok(());
    }
    let measured = measure(options)?;
    if options.json {
        println!("{}", serde_json::to_string_pretty(&measured.json())?);
        return Ok(());
    }
    print!("{}", measured.text());
    if options.write {
        return write(&measured);
    }
    docs::print_hint(
        "cargo cost",
        "README.md, docs/accuracy.md, docs/cost/ and five figures",
    );
    Ok(())
}

fn measure(options: &Options) -> anyhow::Result<Measured> {
    let methods: Vec<Method> = match options.method {
        Some(method) => vec![method],
        None => Method::ALL.to_vec(),
    };
    let chip = chip::measure().context("on the emulated chip")?;
    // Times are taken while nothing else runs.
    let host_ns = methods
        .iter()
        .map(|&method| host_time::nanoseconds(method))
        .collect();
    let peers = match options.peers {
        true => Some(peers_beside(&chip)?),
        false => None,
    };
    Ok(Measured {
        accuracy: accuracy::measure(&methods, options.rows),
        readings: reading_time::measure((options.rows / 100).max(8), &chip.whole_rows)?,
        methods,
        distances: distances::measure(&chip)?,
        floats: float_functions::measure(&chip)?,
        chip,
        host_ns,
        peers,
    })
}

/// The peers over the default estimator on the same rows: the fit alone, and whole rows.
fn peers_beside(chip: &chip::Chip) -> anyhow::Result<peers::Peers> {
    let mut peers = peers::run().context("the peers")?;
    let default = report::on_chip(chip, Method::default(), report::PEERS_WIDTH)
        .context("the default estimator finds no centre on the chip")?;
    let row = (chip.whole_rows)
        .at_width(Estimator::default(), report::PEERS_WIDTH)
        .context("the chip measured no whole row")?;
    let row = row.following.total() as f64;
    for peer in &chip.peers {
        let own = peer.instructions as f64;
        // Some ran on the chip only: with other starting values.
        peers.set_chip_instructions(&peer.name, own, default.instructions as f64, row);
    }
    let rest = host_time::row_nanoseconds(Estimator::default())
        .zip(host_time::nanoseconds(Method::default()))
        .map(|(row, alone)| row - alone);
    peers.set_rest_of_a_row(rest.context("the default estimator finds no centre on this PC")?);
    Ok(peers)
}

/// The page of the tables.
const ACCURACY: &str = "docs/accuracy.md";

/// The marks of the blocks that this program writes.
const ALL: &str = "cargo cost";
const DISTANCES: &str = "cargo cost --distances";
const FLOATS: &str = "cargo cost, float functions";
const ROWS: &str = "cargo cost, whole rows";
const PEERS: &str = "cargo cost --peers --write";

/// Rewrites the tables and figures of README.md and docs/.
fn write(measured: &Measured) -> anyhow::Result<()> {
    measured.write_csv(&docs::path("docs/cost"))?;
    figures::draw(measured, &docs::path("docs/figures"))?;
    docs::write_block(ACCURACY, ALL, &measured.markdown())?;
    docs::write_block(ACCURACY, FLOATS, &measured.floats.markdown())?;
    docs::write_block("README.md", ALL, &measured.short_markdown())?;
    docs::write_block("README.md", ROWS, &measured.readme_rows())?;
    if let Some(peers) = &measured.peers {
        docs::write_block(ACCURACY, PEERS, &report::peers_markdown(peers))?;
    }
    write_distances(&measured.distances)
}

fn write_distances(distances: &[distances::Distance]) -> anyhow::Result<()> {
    docs::write_block(ACCURACY, DISTANCES, &report::distances_markdown(distances))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run with few rows tests everything except the chip. 64 rows give a ratio to 9 %.
    #[test]
    fn a_quick_run_comes_near_the_bound() {
        let accuracy = accuracy::measure(&[Method::default()], 64);
        let worst = accuracy.worst(Method::default());
        println!("{worst:?}");
        assert_eq!(
            accuracy.cells.len(),
            accuracy::WIDTHS.len() * accuracy::NOISES.len()
        );
        assert!(worst.white > 0.9 && worst.white < 1.5 && worst.shot < 1.5);
        assert!(worst.bias.is_some_and(|bias| bias < 1e-3));
        assert!(host_time::nanoseconds(Method::default()).is_some_and(|ns| ns > 1.0));
    }

    #[test]
    fn methods_are_known_by_their_names() {
        for it in Method::ALL {
            assert_eq!(method(it.name()), Ok(it));
        }
        assert!(method("none").is_err());
    }
}
