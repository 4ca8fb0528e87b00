//! `cargo scene`: what a scene shows, what each of its effects does to the error, and what it costs to
//! simulate.

mod embedded;
mod picture;
mod timing;
mod words;

use std::path::Path;

use anyhow::{Context as _, Result};
use clap::Args;
use simulator::scene::{Scene, file};
use slitrange::centre::Estimator;

use self::timing::Timing;
use crate::budget::{Budget, Plan};
use crate::{docs, progress};

/// The scenes whose pictures docs/physics.md shows.
const SHOWN: [&str; 4] = ["quiet-paper", "brushed-metal", "paper-on-camera", "lens"];

/// Shows a scene: its rows, its error budget, and what each effect costs in time. Without a name: lists the
/// scenes.
///
/// The error is that of the core's centres against the truth; a reading is a row of a line sensor, or the
/// mean over the rows of a camera's frame that are at least a tenth as high as its highest. An effect's share
/// of it is 1 - (RMS error without the effect)^2 / (RMS error)^2, of the readings that have a centre with it
/// and without it: shares of effects that interact do not add up to 1, and one without which the error would
/// be larger has a negative one.
///
/// Readings are taken of many realisations of the scene, because some effects (speckle, texture, fixed
/// pattern, response) stay as long as target or sensor do: each has a seed of its own, and the spot elsewhere
/// on its pixel. Within a realisation they are spread over a time, because others (temperature, drift) take
/// their time.
///
/// Times are those of a row as the core gets it, and of the first one of a scene, in which all is computed
/// that stays; those of an effect are by how much a row takes longer with it than without. One that takes
/// light away spares the shot noise work.
#[derive(Args)]
pub struct Options {
    /// A scene of the folder scenes/, or the path of a .toml file
    name: Option<String>,
    /// Redraw the pictures that docs/physics.md shows, and nothing else; with --effects its table
    #[arg(long, conflicts_with = "name")]
    write: bool,
    /// List the parameters of every effect, with their units and ranges
    #[arg(long, conflicts_with = "name")]
    effects: bool,
}

/// The folder of the pictures that no page shows.
const PICTURES: &str = "target/scenes";

/// The page with the table of the effects' parameters, and the mark and the command of the table.
const PAGE: &str = "docs/physics.md";
const EFFECTS: &str = "cargo scene --effects";

pub fn main(options: &Options) -> Result<()> {
    if options.effects {
        return docs::print_or_write(EFFECTS, options.write, PAGE, &[(EFFECTS, words::effects())]);
    }
    if options.write {
        let folder = docs::path("docs/figures");
        for name in SHOWN {
            picture::write(&format!("scene-{name}"), name, &Scene::load(name)?, &folder)?;
        }
        return Ok(());
    }
    options.name.as_deref().map_or_else(list, show)?;
    docs::print_hint("cargo scene", "the figures scene-*.svg of docs/physics.md");
    Ok(())
}

fn show(name: &str) -> Result<()> {
    let scene = Scene::load(name)?;
    let name = Path::new(name)
        .file_stem()
        .with_context(|| format!("{name:?} names no scene"))?
        .to_string_lossy();
    let plan = Plan::of(&scene);
    // Before anything that takes its time.
    plan.check(&scene)?;
    let picture = picture::write(&name, &name, &scene, Path::new(PICTURES))?;
    // While nothing else runs.
    let timing = Timing::of(&scene);
    print!(
        "{}",
        words::of(&name, &scene, &budget(&scene, &plan)?, &timing)
    );
    println!("\npicture: {}", picture.display());
    Ok(())
}

/// With a bar on the terminal, as speckle takes a while.
fn budget(scene: &Scene, plan: &Plan) -> Result<Budget> {
    let template = "{wide_bar} {pos}/{len} realisations, {eta} left";
    let progress = progress::bar(Budget::runs(scene, plan), template)?;
    Budget::of(scene, Estimator::default(), plan, &|| progress.inc(1))
}

fn list() -> Result<()> {
    let names = file::names()?;
    let width = names.iter().map(String::len).max().unwrap_or(0);
    for name in names {
        println!("{name:width$}  {}", Scene::load(&name)?.about);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_the_parameters_that_scenes_accept() {
        let page = std::fs::read_to_string(docs::path(PAGE)).expect(PAGE);
        let table = words::effects();
        let due = docs::with_block(&page, EFFECTS, &table).expect("marks");
        assert!(page == due, "{PAGE} is old: run `{EFFECTS} --write`");
    }
}
