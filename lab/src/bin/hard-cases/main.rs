//! `cargo hard-cases`: hard cases through every estimator, and how often a centre is wrong without a flag.

mod story;

use std::time::Instant;

use clap::Parser;
use host_tests::hard_cases::mixtures::{self, RandomRow};
use host_tests::hard_cases::report::{self, Catalogue};
use host_tests::hard_cases::tally::Tally;
use lab::{docs, progress};
use slitrange::centre::Estimator;

/// The random rows of each kind that docs/hard-cases.md shows.
const ROWS: u64 = 1_000_000;

/// Runs the catalogue of hard cases and random mixtures of them through every estimator.
#[derive(Parser)]
#[command(name = "cargo hard-cases")]
struct Options {
    /// Print one JSON object and nothing else
    #[arg(long)]
    json: bool,
    /// Random rows with flaws, and as many clean ones
    #[arg(long, value_name = "N", default_value_t = ROWS,
          value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    rows: u64,
    /// Tell the story of one random row with flaws, and what every estimator makes of it
    #[arg(long, value_name = "SEED", conflicts_with_all = ["json", "rows"])]
    row: Option<u64>,
    /// The row of that seed without flaws
    #[arg(long, requires = "row")]
    clean: bool,
    /// Also rewrite the tables of docs/hard-cases.md. With fewer than a million rows the table of random
    /// rows stays as it is
    #[arg(long, conflicts_with_all = ["json", "row"])]
    write: bool,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    if let Some(seed) = options.row {
        let row = if options.clean {
            mixtures::clean(seed)
        } else {
            mixtures::mixture(seed)
        };
        story::tell(&row);
        return Ok(());
    }
    let catalogue = Catalogue::run();
    let start = Instant::now();
    let clean = tally("clean rows", options.rows, mixtures::clean)?;
    let mixtures = tally("rows with flaws", options.rows, mixtures::mixture)?;
    if options.json {
        let json = report::json(&catalogue, &clean, &mixtures);
        println!("{}", serde_json::to_string_pretty(&json)?);
        return Ok(());
    }
    print_summary(&catalogue, &clean, &mixtures);
    let (rows, seconds) = (2 * options.rows, start.elapsed().as_secs_f64());
    println!("\n{rows} random rows in {seconds:.0} s");
    if options.write {
        return write(
            &catalogue,
            (options.rows >= ROWS).then_some((&clean, &mixtures)),
        );
    }
    docs::print_hint("cargo hard-cases", PAGE);
    Ok(())
}

fn tally(name: &'static str, rows: u64, draw: fn(u64) -> RandomRow) -> anyhow::Result<Tally> {
    let progress = progress::bar(rows, "{msg:16} {wide_bar} {pos}/{len}, {eta} left")?;
    progress.set_message(name);
    let tally = Tally::over(0..rows, draw, &|| progress.inc(1));
    progress.finish_and_clear();
    Ok(tally)
}

fn print_summary(catalogue: &Catalogue, clean: &Tally, mixtures: &Tally) {
    println!("{}", report::random_rows_markdown(clean, mixtures));
    if !mixtures.seeds.is_empty() {
        println!(
            "the default estimator was confidently wrong with seeds {:?} (--row SEED tells their story)",
            mixtures.seeds
        );
    }
    if !clean.seeds.is_empty() {
        println!("and of clean rows with seeds {:?}", clean.seeds);
    }
    println!("\n{} cases", catalogue.len());
    for estimator in Estimator::ALL {
        let failures = catalogue.failures(estimator);
        println!("{}: {} failed", estimator.name(), failures.len());
        for failure in failures {
            println!("    {failure}");
        }
    }
}

/// The page of the tables.
const PAGE: &str = "docs/hard-cases.md";

/// Rewrites the catalogue's tables, and the rates of random rows if there are any.
fn write(catalogue: &Catalogue, rates: Option<(&Tally, &Tally)>) -> anyhow::Result<()> {
    docs::write_block(PAGE, report::CATALOGUE, &catalogue.markdown())?;
    if let Some((clean, mixtures)) = rates {
        let block = report::random_rows_markdown(clean, mixtures);
        docs::write_block(PAGE, report::RANDOM_ROWS, &block)?;
    }
    Ok(())
}
