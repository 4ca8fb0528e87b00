//! `cargo cost`: what accuracy costs in time.
//!
//! Every estimator, and the check's repair, on the same seeded rows against the Cramér-Rao bound; its
//! instructions on the emulated chip; its time on this computer; and on demand the programs that one would
//! use instead. Prints the tables of README.md and docs/accuracy.md. With `--write` it also rewrites these
//! and the figures.

mod accuracy;
pub(crate) mod chip;
mod distances;
mod figures;
mod float_functions;
mod host_time;
mod peers;
mod reading_time;
mod report;
#[cfg(test)]
mod sample_measurements;
pub(crate) mod without_fpu;

use cost_on_chip::methods::Method;

use self::report::Measured;
use crate::docs;
use crate::prelude::*;

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
    /// Only this estimator, or `repair`
    #[arg(long = "estimator", value_name = "NAME", value_parser = method)]
    method: Option<Method>,
    /// Also rewrite the tables and figures that show these results
    #[arg(long, conflicts_with_all = ["method", "json", "board"])]
    write: bool,
}

fn method(name: &str) -> Result<Method, String> {
    Method::ALL
        .into_iter()
        .find(|method| method.name() == name)
        .ok_or_else(|| format!("there are {}", Method::ALL.map(Method::name).join(", ")))
}

pub fn main(options: &Options) -> anyhow::Result<()> {
    if options.board {
        return chip::on_board();
    }
    let measured = measure(options)?;
    if options.json {
        println!("{}", serde_json::to_string_pretty(&measured.json())?);
        return Ok(());
    }
    let blocks = measured.blocks();
    for (.., text) in &blocks {
        println!("{text}");
    }
    if !options.write {
        let files = "README.md, docs/accuracy.md, docs/cost/ and five figures";
        docs::print_hint("cargo cost", files);
        return Ok(());
    }
    measured.write_csv(&docs::path("docs/cost"))?;
    figures::draw(&measured, &docs::path("docs/figures"))?;
    for (page, mark, text) in &blocks {
        docs::write_block(page, mark, text)?;
    }
    Ok(())
}

fn measure(options: &Options) -> anyhow::Result<Measured> {
    let methods = options
        .method
        .map_or(Method::ALL.to_vec(), |method| vec![method]);
    let chip = chip::measure().context("on the emulated chip")?;
    // Times are taken while nothing else runs.
    let host_ns = methods.iter().map(|&method| host_time::nanoseconds(method));
    let host_ns = host_ns.collect();
    let peers = match options.peers {
        true => peers::compare(&chip).context("the peers")?,
        false => vec![],
    };
    Ok(Measured {
        accuracy: accuracy::measure(&methods, options.rows),
        readings: reading_time::measure((options.rows / 100).max(8), &chip.whole_rows)?,
        methods,
        distances: distances::markdown(&chip)?,
        floats: float_functions::markdown(&chip)?,
        without_fpu: without_fpu::markdown()?,
        chip,
        host_ns,
        peers,
    })
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
