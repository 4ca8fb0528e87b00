//! `cargo table1`: the paper's experiment simulated, and its Table 1 beside the paper's own.

mod figures;
mod report;

use clap::Args;

use self::report::Report;
use crate::paper::apparatus::Aperture;
use crate::paper::comb_path;
use crate::paper::data_set::positions;
use crate::paper::experiment::Experiment;
use crate::paper::materials::MATERIALS;
use crate::{docs, progress};

const SEED: u64 = 1;

/// Simulates the paper's experiment: six materials, lens against slit, 16,800 positions of five captures
/// each. Beside the paper's camera stands a comb of slits on a line sensor.
#[derive(Args)]
pub struct Options {
    /// Every tenth position
    #[arg(long)]
    quick: bool,
    /// Also rewrite the table and the figures of docs/physics.md with these results
    #[arg(long)]
    write: bool,
}

pub fn main(options: &Options) -> anyhow::Result<()> {
    let report = run(if options.quick { 10 } else { 1 })?;
    print!("{}", report.markdown());
    if !options.write {
        docs::print_hint(
            "cargo table1",
            "docs/physics.md and the figures paper-*.svg",
        );
        return Ok(());
    }
    figures::draw(&report, &docs::path("docs/figures"))?;
    docs::write_block("docs/physics.md", "cargo table1", &report.markdown())
}

fn run(stride: usize) -> anyhow::Result<Report> {
    let experiment = Experiment { stride, seed: SEED };
    // Lens, slit and comb.
    let of_material = (Aperture::ALL.len() + 1) * positions(stride).len();
    let progress = progress::bar(
        (MATERIALS.len() * of_material) as u64,
        "{msg:24} {wide_bar} {pos}/{len} positions, {eta} left",
    )?;
    let (mut outcomes, mut combs) = (vec![], vec![]);
    for (material, it) in MATERIALS.iter().enumerate() {
        for aperture in Aperture::ALL {
            progress.set_message(format!("{}, {}", it.name, aperture.name()));
            outcomes.push(experiment.run(material, aperture, &|| progress.inc(1))?);
        }
        progress.set_message(format!("{}, comb", it.name));
        combs.push(comb_path::judge(material, SEED, stride, &|| {
            progress.inc(1)
        })?);
    }
    progress.finish_and_clear();
    Ok(Report {
        outcomes,
        combs,
        experiment,
    })
}
