//! `cargo hard-cases`: hard cases through every estimator, and how often a centre is wrong without a flag.
//!
//! Two judges count those. The firmware's check is tuned on the first one's rows, and nothing on the second
//! one's.

mod lopsided;
mod story;

use std::time::Instant;

use judges::hard_cases::mixtures::{self, RandomRow};
use judges::hard_cases::report::{self, Catalogue};
use judges::hard_cases::tally::Tally;
use judges::second_judge::{self, Kind, Report};

use crate::prelude::*;
use crate::{docs, progress};

/// The random rows of each kind that docs/hard-cases.md shows.
const ROWS: u64 = 1_000_000;

/// Of each kind of the second judge, rows and frames for a million random rows.
const OF_A_KIND: [u64; 2] = [5000, 1000];

/// Runs the catalogue of hard cases and random mixtures of them through every estimator, and the rows of a
/// second judge through the estimators that most users choose.
#[derive(Args)]
pub struct Options {
    /// Random rows with flaws, and as many clean ones. For a million the second judge takes 5000 rows and
    /// 1000 frames of each kind
    #[arg(long, value_name = "N", default_value_t = ROWS,
          value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    rows: u64,
    /// Tell the story of one random row with flaws, and what every estimator makes of it
    #[arg(long, value_name = "SEED", conflicts_with = "rows")]
    row: Option<u64>,
    /// Tell the story of one frame of the second judge: the name of a fault in its table
    #[arg(long, value_name = "FAULT", conflicts_with_all = ["rows", "row"],
          value_parser = kind_named)]
    second: Option<&'static Kind>,
    /// Which of its frames
    #[arg(long, value_name = "N", requires = "second", default_value_t = 0)]
    number: u64,
    /// Also rewrite the tables of docs/hard-cases.md. With fewer than a million rows the tables of random
    /// rows and of the second judge stay as they are
    #[arg(long, conflicts_with_all = ["row", "second"])]
    write: bool,
}

fn kind_named(name: &str) -> Result<&'static Kind, String> {
    let names = || Kind::all().iter().map(|kind| kind.name).collect::<Vec<_>>();
    Kind::named(name).ok_or_else(|| format!("the second judge has: {}", names().join("; ")))
}

pub fn main(options: &Options) -> anyhow::Result<()> {
    if let Some(kind) = options.second {
        print!("{}", second_judge::frame(kind, options.number).story(kind));
        return Ok(());
    }
    if let Some(seed) = options.row {
        print!("{}", story::story(&mixtures::mixture(seed)));
        return Ok(());
    }
    let catalogue = Catalogue::run();
    let start = Instant::now();
    let clean = tally("clean rows", options.rows, mixtures::clean)?;
    let mixtures = tally("rows with flaws", options.rows, mixtures::mixture)?;
    let seconds = start.elapsed().as_secs_f64();
    let second = second(options.rows)?;
    print_summary(&catalogue, &clean, &mixtures);
    println!("\n{} random rows in {seconds:.0} s", 2 * options.rows);
    println!("\nThe second judge. {}", second.markdown());
    if options.write {
        let rates = (options.rows >= ROWS).then_some((&clean, &mixtures, &second));
        return write(&catalogue, rates);
    }
    docs::print_hint("cargo hard-cases", PAGE);
    Ok(())
}

fn tally(name: &'static str, rows: u64, draw: fn(u64) -> RandomRow) -> anyhow::Result<Tally> {
    let progress = progress::bar(rows, "{msg:16} {wide_bar} {pos}/{len}, {eta} left")?;
    progress.set_message(name);
    Ok(Tally::over(0..rows, draw, &|| progress.inc(1)))
}

fn second(random_rows: u64) -> anyhow::Result<Report> {
    let [rows, frames] = OF_A_KIND.map(|count| (random_rows * count / ROWS).max(1));
    let all = (rows + frames) * Kind::all().len() as u64;
    let progress = progress::bar(all, "{msg:16} {wide_bar} {pos}/{len}, {eta} left")?;
    progress.set_message("second judge");
    let done = || progress.inc(1);
    Ok(second_judge::judge_with(Kind::all(), rows, frames, &done))
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
    println!("\n{} cases", catalogue.count());
    for estimator in Estimator::ALL {
        let failures = catalogue.failures(estimator);
        println!("{}: {} failed", estimator.name(), failures.len());
        for failure in failures {
            println!("    {failure}");
        }
    }
}

const PAGE: &str = "docs/hard-cases.md";

/// Rewrites the catalogue's tables, and the rates of both judges if there are any.
fn write(catalogue: &Catalogue, rates: Option<(&Tally, &Tally, &Report)>) -> anyhow::Result<()> {
    docs::write_block(PAGE, report::CATALOGUE, &catalogue.markdown())?;
    docs::write_block("docs/uncertainty.md", lopsided::TOOL, &lopsided::markdown())?;
    if let Some((clean, mixtures, second)) = rates {
        let block = report::random_rows_markdown(clean, mixtures);
        docs::write_block(PAGE, report::RANDOM_ROWS, &block)?;
        let tables = [second.markdown(), second_judge::report::kinds_markdown()];
        docs::write_block(PAGE, second_judge::report::SECOND_JUDGE, &tables.join("\n"))?;
    }
    Ok(())
}
