//! What a comb of slits does: `cargo comb`.

use anyhow::Result;
use clap::Parser;
use lab::comb::{At, Mask, read, with_speckle};
use lab::surfaces::{MATERIALS, Summary};
use simulator::scene::Scene;

/// Reads rough surfaces through the default comb, and compares what the readings claim with the truth.
#[derive(Parser)]
#[command(name = "cargo comb", bin_name = "cargo comb")]
struct Options {
    /// Surfaces of each kind
    #[arg(long, default_value_t = 1000)]
    surfaces: u64,
    /// Rows of a frame
    #[arg(long, default_value_t = 4)]
    rows: u16,
}

fn main() -> Result<()> {
    let options = Options::parse();
    let mask = Mask::nominal();
    let base = Scene::load("speckle-at-rest")?;
    let mut kinds = vec![];
    for (name, polarisations) in [("paper", 2), ("metal", 1)] {
        for waist in [1e-3, 0.5e-3] {
            let scene = with_speckle(&base, waist, polarisations);
            kinds.push((format!("{name} {} mm", 1e3 * waist), scene, At::One(0.8)));
        }
    }
    for (name, scene) in MATERIALS {
        let scene = Scene::load(scene)?;
        let plain = Scene {
            texture: None,
            ..scene.clone()
        };
        kinds.push((name.into(), scene.clone(), At::Between(0.55, 1.10)));
        if scene.texture.is_some() {
            kinds.push((
                format!("{name}, no texture"),
                plain,
                At::Between(0.55, 1.10),
            ));
        }
    }
    for (name, scene, at) in kinds {
        let all = read(
            &scene,
            Some(&mask),
            at,
            options.rows,
            1_000_000,
            options.surfaces,
        );
        let faults = all.iter().filter(|it| it.is_err()).count();
        let mut names: Vec<&str> = all
            .iter()
            .filter_map(|it| it.as_ref().err().map(|f| f.name()))
            .collect();
        names.sort();
        names.dedup();
        let judged: Vec<_> = all.into_iter().flatten().collect();
        let of = Summary::of(&judged);
        let used = judged
            .iter()
            .map(|it| f64::from(it.reading.slits_used))
            .sum::<f64>()
            / judged.len() as f64;
        let misfits = judged.iter().filter(|it| it.reading.misfits > 0).count();
        println!(
            "{name:28} rms {:6.1} median u {:6.1} r {:5.1} within {:.3} {:.3} {:.3} used {used:.1} flagged {misfits} faults {faults} {names:?}",
            of.rms, of.median_u, of.median_r, of.within[0], of.within[1], of.within[2]
        );
    }
    Ok(())
}
