//! `cargo table1`: the paper's experiment simulated, and its Table 1 beside the paper's own.

mod figures;
mod report;

use clap::Args;

use self::report::Report;
use crate::paper::apparatus::{Aperture, POSITIONS};
use crate::paper::comb_path;
use crate::paper::experiment::{Experiment, Outcome};
use crate::paper::materials::MATERIALS;
use crate::paper::training::PIECES;
use crate::{docs, progress};

/// The seed of what docs/physics.md shows.
const SEED: u64 = 1;

/// Simulates the paper's experiment: six materials, lens against slit, 16,800 positions of five captures
/// each. Beside the paper's camera stands a comb of slits on a line sensor.
#[derive(Args)]
pub struct Options {
    /// Print one JSON object and no tables
    #[arg(long)]
    json: bool,
    /// Every tenth position
    #[arg(long)]
    quick: bool,
    /// About this many positions in place of 16,800
    #[arg(long, value_name = "N", conflicts_with = "quick",
          value_parser = clap::value_parser!(u32).range(40..=POSITIONS as i64))]
    positions: Option<u32>,
    /// Only this material, by a part of its name
    #[arg(long, value_name = "NAME", value_parser = material)]
    material: Option<usize>,
    /// Only the lens or only the slit, without the comb
    #[arg(long, value_name = "NAME", value_parser = aperture)]
    optics: Option<Aperture>,
    /// Also rewrite the table and the figures of docs/physics.md with these results
    #[arg(long, conflicts_with_all = ["material", "optics", "json"])]
    write: bool,
    /// Seed of surfaces and noise
    #[arg(long, value_name = "N", default_value_t = SEED)]
    seed: u64,
}

fn material(name: &str) -> Result<usize, String> {
    let named = |known: &str| known.to_lowercase().contains(&name.to_lowercase());
    let found: Vec<usize> = (0..MATERIALS.len())
        .filter(|&i| named(MATERIALS[i].name))
        .collect();
    match found[..] {
        [only] => Ok(only),
        _ => Err(format!(
            "{} of the materials are called so: {}",
            found.len(),
            MATERIALS.map(|material| material.name).join(", ")
        )),
    }
}

fn aperture(name: &str) -> Result<Aperture, String> {
    Aperture::ALL
        .into_iter()
        .find(|aperture| aperture.name() == name.to_lowercase())
        .ok_or_else(|| "there are lens and slit".into())
}

impl Options {
    fn stride(&self) -> usize {
        match self.positions {
            Some(positions) => POSITIONS.div_ceil(positions as usize),
            None if self.quick => 10,
            None => 1,
        }
    }
}

/// Runs the program.
///
/// # Errors
/// A measurement fails, or a file cannot be read or written.
pub fn main(options: &Options) -> anyhow::Result<()> {
    let experiment = Experiment {
        stride: options.stride(),
        seed: options.seed,
        pieces: PIECES,
    };
    let report = Report::new(run(options, &experiment)?, run_combs(options)?, &experiment);
    if options.json {
        println!("{}", serde_json::to_string_pretty(&report.json())?);
        return Ok(());
    }
    print!("{}", report.markdown());
    if options.write {
        return write(&report);
    }
    docs::print_hint(
        "cargo table1",
        "docs/physics.md, docs/physics/table1.csv and the figures paper-*.svg",
    );
    Ok(())
}

/// Rewrites the table and the figures of docs/physics.md.
fn write(report: &Report) -> anyhow::Result<()> {
    figures::draw(report, &docs::path("docs/figures"))?;
    let directory = docs::path("docs/physics");
    std::fs::create_dir_all(&directory)?;
    std::fs::write(directory.join("table1.csv"), report.csv())?;
    docs::write_block("docs/physics.md", "cargo table1", &report.markdown())
}

fn run(options: &Options, experiment: &Experiment) -> anyhow::Result<Vec<Outcome>> {
    let materials = 0..MATERIALS.len();
    let cells: Vec<(usize, Aperture)> = materials
        .filter(|&material| options.material.is_none_or(|only| only == material))
        .flat_map(|material| Aperture::ALL.map(|aperture| (material, aperture)))
        .filter(|&(_, aperture)| options.optics.is_none_or(|only| only == aperture))
        .collect();
    let progress = progress::bar(
        (cells.len() * experiment.positions()) as u64,
        "{msg:24} {wide_bar} {pos}/{len} positions, {eta} left",
    )?;
    let outcomes = cells
        .into_iter()
        .map(|(material, aperture)| {
            let name = MATERIALS[material].name;
            progress.set_message(format!("{name}, {}", aperture.name()));
            experiment.run(material, aperture, &|| progress.inc(1))
        })
        .collect();
    progress.finish_and_clear();
    outcomes
}

/// The comb on a line sensor, on each material.
fn run_combs(options: &Options) -> anyhow::Result<Vec<comb_path::Judged>> {
    if options.optics.is_some() {
        return Ok(vec![]);
    }
    let materials = || {
        let all = 0..MATERIALS.len();
        all.filter(|&material| options.material.is_none_or(|only| only == material))
    };
    let positions = POSITIONS.div_ceil(options.stride());
    let progress = progress::bar(
        (materials().count() * positions) as u64,
        "{msg:24} {wide_bar} {pos}/{len} positions, {eta} left",
    )?;
    let judged = materials()
        .map(|material| {
            progress.set_message(format!("{}, comb", MATERIALS[material].name));
            comb_path::judge(material, options.seed, options.stride(), &|| {
                progress.inc(1)
            })
        })
        .collect();
    progress.finish_and_clear();
    judged
}
