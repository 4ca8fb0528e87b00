//! `cargo slowest`: searches the row that takes the chip the most instructions.

use slowest_on_chip::mailbox::Question;

use crate::prelude::*;
use crate::slowest::{self, Chip, Chips, LIMIT, Search, Slow};
use crate::{docs, progress};

const ROWS: u64 = 1_000_000;

/// The page of the table, and the file of the rows.
const PAGE: &str = "docs/hard-cases.md";
const CORPUS: &str = "on-chip/slowest/src/corpus.in";

/// Searches the slowest row by evolution: rows are made from shapes, counted on the emulated chip, and the
/// slowest of them changed again.
#[derive(Args)]
pub struct Options {
    /// How many rows to count; each estimator's is a row
    #[arg(long, value_name = "N", default_value_t = ROWS)]
    rows: u64,
    /// Another seed, another search
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Start from nothing, not from the rows that are known
    #[arg(long)]
    fresh: bool,
    /// Also write the rows to on-chip/slowest/src/corpus.in, and the table to docs/hard-cases.md
    #[arg(long)]
    write: bool,
}

pub fn main(options: &Options) -> anyhow::Result<()> {
    let chip = Chip::power_on()?;
    let mut chips = Chips::like(&chip);
    let mut search = Search::new(options.seed);
    if !options.fresh {
        let known: Vec<Question> = slowest::known().map(|slow| slow.question).collect();
        search.add(&mut chips, &known)?;
    }
    let progress = progress::bar(options.rows, "{wide_bar} {pos}/{len}, {eta} left")?;
    let start = std::time::Instant::now();
    while search.rows < options.rows {
        search.step(&mut chips)?;
        progress.set_position(search.rows);
    }
    progress.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    let found = [false, true].into_iter().flat_map(|follows| {
        let slowest = |estimator| search.slowest(estimator, follows);
        Estimator::ALL.map(slowest).into_iter().flatten()
    });
    let found: Vec<Slow> = found.collect();
    let mut traced = vec![];
    for slow in &found {
        let parts = slowest::attribution(chip.program(), &chip.trace(&slow.question)?)?;
        traced.push((*slow, parts));
    }
    let table = slowest::markdown(search.rows, &traced);
    println!("\n{table}\n{} rows in {:.0} s", search.rows, seconds);
    chip.finish()?;
    if found.iter().any(|slow| slow.instructions > LIMIT) {
        println!("A row takes more than the goal of {LIMIT} instructions.");
    }
    if !options.write {
        docs::print_hint("cargo slowest", &format!("{CORPUS} and {PAGE}"));
        return Ok(());
    }
    std::fs::write(docs::path(CORPUS), corpus(&found))?;
    docs::write_block(PAGE, "cargo slowest", &table)
}

fn corpus(found: &[Slow]) -> String {
    let mut text = String::from("[\n");
    for follows in [false, true] {
        text += "[\n";
        for slow in found.iter().filter(|slow| slow.question.follows == follows) {
            text += &format!("    ({}, [", slow.instructions);
            for (i, word) in slow.question.description.to_words().iter().enumerate() {
                let before = if i % 8 == 0 { "\n        " } else { " " };
                text += &format!("{before}0x{word:08x},");
            }
            text += "\n    ]),\n";
        }
        text += "],\n";
    }
    text += "]\n";
    text
}
