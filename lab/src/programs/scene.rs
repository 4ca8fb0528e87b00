//! `cargo scene`: what a scene shows, what each of its effects does to the error, and what it costs to
//! simulate.

mod embedded;
mod picture;
mod timing;
mod words;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use clap::Args;
use serde::Serialize;
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
    /// How the centres of rows are found
    #[arg(long, value_name = "NAME", default_value = Estimator::default().name(), value_parser = estimator)]
    estimator: Estimator,
    /// Seeds to average over [default: 100; with speckle 40; for a camera 24]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    realisations: Option<u64>,
    /// Readings of each [default: 4; with speckle 10; for a camera 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    readings: Option<u64>,
    /// Time over which a realisation's readings are spread [default: 600, or what it takes the target to move
    /// by a centimetre]
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    /// Folder of the picture, NAME.svg
    #[arg(long, value_name = "FOLDER", default_value = "target/scenes")]
    output: PathBuf,
    /// Print all figures as one JSON object
    #[arg(long)]
    json: bool,
    /// Redraw the pictures that docs/physics.md shows, and nothing else
    #[arg(long, conflicts_with_all = ["name", "json", "output"])]
    write: bool,
}

fn estimator(name: &str) -> Result<Estimator, String> {
    Estimator::named(name).ok_or_else(|| {
        let names = Estimator::ALL.map(Estimator::name).join(", ");
        format!("there are {names}")
    })
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().map_err(|_| "it is no number".to_owned())?;
    if !(0.0..=1e6).contains(&seconds) {
        return Err("it must be from 0 to 1e6".into());
    }
    Ok(seconds)
}

/// All that there is to say about a scene.
#[derive(Serialize)]
pub struct Shown {
    name: String,
    scene: Scene,
    budget: Budget,
    timing: Timing,
    picture: PathBuf,
}

pub fn main(options: &Options) -> Result<()> {
    if options.write {
        return redraw(options.estimator);
    }
    let Some(name) = &options.name else {
        return list(options.json);
    };
    let scene = Scene::load(name)?;
    let name = Path::new(name)
        .file_stem()
        .with_context(|| format!("{name:?} names no scene"))?
        .to_string_lossy()
        .into_owned();
    let plan = options.plan(&scene);
    // Before anything that takes its time.
    plan.check(&scene)?;

    let shown = Shown {
        picture: picture::write(&name, &scene, options.estimator, &options.output)?,
        // While nothing else runs.
        timing: Timing::of(&scene),
        budget: budget(&scene, options.estimator, &plan)?,
        name,
        scene,
    };
    if options.json {
        println!("{}", serde_json::to_string_pretty(&shown)?);
    } else {
        print!("{}", words::of(&shown)?);
        hint();
    }
    Ok(())
}

impl Options {
    fn plan(&self, scene: &Scene) -> Plan {
        let plan = Plan::of(scene);
        Plan {
            realisations: self.realisations.unwrap_or(plan.realisations),
            readings: self.readings.unwrap_or(plan.readings),
            seconds: self.seconds.unwrap_or(plan.seconds),
        }
    }
}

/// With a bar on the terminal, as speckle takes a while.
fn budget(scene: &Scene, estimator: Estimator, plan: &Plan) -> Result<Budget> {
    let template = "{wide_bar} {pos}/{len} realisations, {eta} left";
    let progress = progress::bar(Budget::runs(scene, plan), template)?;
    let budget = Budget::of(scene, estimator, plan, &|| progress.inc(1));
    progress.finish_and_clear();
    budget
}

/// The scenes that come with the project.
fn list(json: bool) -> Result<()> {
    let scenes = file::names()?
        .into_iter()
        .map(|name| Ok((Scene::load(&name)?.about, name)))
        .collect::<Result<Vec<_>>>()?;
    if json {
        let scenes = scenes
            .iter()
            .map(|(about, name)| serde_json::json!({"name": name, "about": about}));
        println!("{}", serde_json::Value::from_iter(scenes));
    } else {
        let width = scenes.iter().map(|(_, name)| name.len()).max().unwrap_or(0);
        for (about, name) in scenes {
            println!("{name:width$}  {about}");
        }
        hint();
    }
    Ok(())
}

fn hint() {
    docs::print_hint("cargo scene", "the figures scene-*.svg of docs/physics.md");
}

fn redraw(estimator: Estimator) -> Result<()> {
    let folder = docs::path("docs/figures");
    for name in SHOWN {
        let figure = format!("scene-{name}");
        picture::write_as(&figure, name, &Scene::load(name)?, estimator, &folder)?;
    }
    Ok(())
}
