//! `cargo hard-cases`: hard rows through every rung, and how often a centre is wrong without saying so.

use clap::Parser;
use host_tests::hard_cases::judge::answers;
use host_tests::hard_cases::mixtures::{self, Kind};
use host_tests::hard_cases::tally::Tally;
use host_tests::hard_cases::truth::is_confident_error;
use slitrange::estimator::Estimator;

#[derive(Parser)]
#[command(name = "cargo hard-cases")]
struct Options {
    /// Random rows with flaws; as many clean ones
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    rows: u64,
    /// The story of one random row with flaws, and every rung's answer to it
    #[arg(long, value_name = "SEED")]
    row: Option<u64>,
}

fn main() {
    let options = Options::parse();
    if let Some(seed) = options.row {
        tell(seed);
        return;
    }
    for (name, draw) in [
        ("clean", mixtures::clean as fn(u64) -> _),
        ("mixtures", mixtures::mixture),
    ] {
        let start = std::time::Instant::now();
        let tally = Tally::over(0..options.rows, draw, &|| {});
        println!(
            "{name}: {} rows, {:.1} s",
            tally.rows,
            start.elapsed().as_secs_f64()
        );
        let rate = |count: u64| 1e6 * count as f64 / tally.rows as f64;
        for (i, rung) in Estimator::ALL.iter().enumerate() {
            let (looked_at, alone) = (tally.looked_at[i], tally.alone[i]);
            println!(
                "{:>14}: confident errors {:>8.0} ppm (alone {:>8.0}), flagged {:>8.0} (good {:>8.0}), faults {:>8.0}",
                rung.name(),
                rate(looked_at.confident_errors),
                rate(alone.confident_errors),
                rate(looked_at.flagged),
                rate(looked_at.flagged_good),
                rate(looked_at.faults)
            );
        }
        let mut kinds: Vec<usize> = (0..Kind::ALL.len()).collect();
        kinds.sort_by_key(|&kind| std::cmp::Reverse(tally.kinds[kind].1[5]));
        for kind in kinds {
            let (rows, errors) = tally.kinds[kind];
            if rows > 0 {
                println!("{:>24}: {:?} of {rows}", Kind::ALL[kind].name(), errors);
            }
        }
        println!("seeds {:?}", tally.seeds);
    }
}

fn tell(seed: u64) {
    let random_row = mixtures::mixture(seed);
    println!("{random_row:#?}");
    let row = random_row.row();
    println!("truth {:?}", row.truth);
    for (rung, answers) in Estimator::ALL.iter().zip(answers(&row)) {
        for (how, answer) in [("alone", answers.alone), ("looked at", answers.looked_at)] {
            let what = match answer {
                Ok(found) => format!(
                    "{} +- {} px, error {:.4}, height {}, width {}{}{}",
                    found.centre,
                    found.uncertainty,
                    row.truth.error(found.centre.to_f64()),
                    found.amplitude,
                    found.width,
                    if found.misfit { ", flagged" } else { "" },
                    if is_confident_error(row.truth, &answer) {
                        ", CONFIDENT ERROR"
                    } else {
                        ""
                    },
                ),
                Err(fault) => format!("{fault:?}"),
            };
            println!("{:>14} {how:>9}: {what}", rung.name());
        }
    }
}
