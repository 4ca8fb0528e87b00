//! How true u is on rough surfaces: `cargo surfaces`.

use anyhow::Result;
use clap::Parser;
use lab::surfaces::{Judged, MATERIALS, Summary, calibrate, judge};
use simulator::scene::Scene;
use slitrange::record::Record;
use slitrange::uncertainty::Surface;

/// Calibrates simulated sensors on rough materials, and compares what their readings claim with the truth.
#[derive(Parser)]
#[command(name = "cargo surfaces", bin_name = "cargo surfaces")]
struct Options {
    /// Sensors that are calibrated on each material
    #[arg(long, default_value_t = 10)]
    sensors: u64,
    /// Surfaces that each of them reads
    #[arg(long, default_value_t = 100)]
    surfaces: u64,
    /// Points of a calibration
    #[arg(long, default_value_t = 60)]
    points: usize,
}

fn main() -> Result<()> {
    let options = Options::parse();
    for (name, scene) in MATERIALS {
        let scene = Scene::load(scene)?;
        let (mut own, mut nominal) = (vec![], vec![]);
        for sensor in 0..options.sensors {
            // Surfaces that no other sensor sees: 10,000 for its calibration, and its readings after them.
            let first = 100_000 * (sensor + 1);
            let record = calibrate(&scene, options.points, first)?;
            let readings = |record: &Record| {
                judge(
                    &scene,
                    record,
                    Surface::Auto,
                    options.surfaces,
                    first + 50_000,
                )
            };
            own.extend(readings(&record));
            if sensor == 0 {
                println!("{:?}", record.errors);
            }
            if let Some(record) = Record::nominal() {
                nominal.extend(readings(&record));
            }
        }
        println!("{name}: {:.0?}", Summary::of(&own));
        println!(
            "   {:.3?} nominal {:.3?}",
            Summary::of(&own).within,
            Summary::of(&nominal).within
        );
    }
    Ok(())
}
