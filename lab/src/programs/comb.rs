//! What a comb of slits does on rough surfaces, and the drawing of its mask: `cargo comb`.

mod design;
mod drawing;
mod dxf;
mod figure;
mod theory;
mod tolerances;

use std::collections::BTreeMap;

use indicatif::ProgressBar;

use self::tolerances::Tolerances;
use crate::comb::{Mask, Sensor, with_speckle};
use crate::prelude::*;
use crate::surfaces::{Judged, MATERIALS, POINTS, Summary, TABLE};
use crate::{docs, progress, table};

/// Reads rough surfaces through the default comb, and compares what the readings claim with the truth. Takes
/// about fifteen minutes.
#[derive(Args)]
pub struct Options {
    /// Surfaces of each kind
    #[arg(
        long,
        default_value_t = 1000,
        value_parser = clap::value_parser!(u64).range(1..=SURFACES_OF_A_SENSOR)
    )]
    surfaces: u64,
    /// Rows of a frame
    #[arg(long, default_value_t = 4)]
    rows: u16,
    /// Also rewrite the tables of docs/physics.md, and what --drawing writes
    #[arg(long)]
    write: bool,
    /// Measure nothing: write the drawing of the mask, docs/hardware/comb.svg and .dxf, its tolerances in
    /// docs/physics.md, and docs/figures/comb.svg
    #[arg(long, conflicts_with = "design")]
    drawing: bool,
    /// Measure other masks and laser spots instead, on a fifth of the surfaces of each. With --write, rewrite
    /// their table in docs/physics.md, and docs/figures/comb-design.svg
    #[arg(long)]
    design: bool,
}

const PAGE: &str = "docs/physics.md";
const SVG: &str = "docs/hardware/comb.svg";
const DXF: &str = "docs/hardware/comb.dxf";
const FIGURE: &str = "docs/figures/comb.svg";

/// The scene whose optics and noise all kinds at one distance share.
const BASE: &str = "speckle-at-rest";

/// The first surface. Those from [`SURFACES_OF_A_SENSOR`] further on belong to sensors that are calibrated.
const FIRST: u64 = 1_000_000;

/// The material that is also read in the light of a single wavelength: it shows what the line of 1 nm does.
const SINGLE_WAVELENGTH: &str = "brushed metal";

/// Sensors that are calibrated on each material.
const SENSORS: u64 = 5;

/// Numbers of surfaces that are set aside for each of them: one half for its calibration.
const SURFACES_OF_A_SENSOR: u64 = 100_000;

struct Kind {
    name: String,
    scene: Scene,
    /// Distances in metres.
    range: [f64; 2],
    /// The spot's diameter in metres and the number of speckle patterns, if all surfaces are at
    /// [`tolerances::DISTANCE`].
    theory: Option<(f64, u8)>,
}

fn kinds(base: &Scene) -> Result<Vec<Kind>> {
    let mut kinds = vec![];
    for (name, patterns) in [("paper", 2), ("metal", 1)] {
        for spot in [1e-3, 0.5e-3] {
            kinds.push(Kind {
                name: format!("{name}, {} mm", 1e3 * spot),
                scene: with_speckle(base, spot, patterns),
                range: [tolerances::DISTANCE; 2],
                theory: Some((spot, patterns)),
            });
        }
    }
    for (name, scene) in MATERIALS {
        let scene = Scene::load(scene)?;
        let mut add = |name: String, scene: Scene| {
            kinds.push(Kind {
                name,
                scene,
                range: tolerances::RANGE,
                theory: None,
            });
        };
        add(name.into(), scene.clone());
        if scene.texture.is_none() {
            continue;
        }
        let mut scene = with(scene, |it| it.texture = None);
        add(format!("{name}, no texture"), scene.clone());
        if name == SINGLE_WAVELENGTH
            && let Some(speckle) = &mut scene.speckle
        {
            speckle.linewidth = 0.0;
            add(format!("{name}, no texture, single wavelength"), scene);
        }
    }
    Ok(kinds)
}

struct Outcome {
    summary: Summary,
    faults: BTreeMap<&'static str, usize>,
    /// Mean number of slits that went into a reading.
    used: f64,
    /// Mean height in counts.
    height: f64,
}

impl Outcome {
    fn measure(scene: &Scene, range: [f64; 2], mask: &Mask, rows: u16, surfaces: u64) -> Self {
        Self::of(Sensor::nominal(Some(mask.clone())).read(scene, range, rows, FIRST, surfaces))
    }

    fn of(all: Vec<Result<Judged, Fault>>) -> Self {
        let mut faults = BTreeMap::new();
        for fault in all.iter().filter_map(|it| it.as_ref().err()) {
            *faults.entry(fault.name()).or_default() += 1;
        }
        let judged: Vec<_> = all.into_iter().flatten().collect();
        let slits = judged.iter().map(|it| f64::from(it.reading.slits_used));
        let heights = judged.iter().map(|it| it.reading.amplitude.to_f64());
        Self {
            summary: Summary::of(&judged),
            faults,
            used: mean(slits),
            height: mean(heights),
        }
    }

    fn faults(&self) -> String {
        let total: usize = self.faults.values().sum();
        let faults = self.faults.iter();
        let names = faults.map(|(name, count)| format!("{count} {name}"));
        let names: Vec<_> = names.collect();
        match total {
            0 => "0".into(),
            _ => format!("{total} ({})", names.join(", ")),
        }
    }

    fn row(&self, name: &str) -> Vec<String> {
        let it = &self.summary;
        let mut cells = vec![name.to_owned(), it.count.to_string(), self.faults()];
        cells.extend([it.rms, it.median_u].map(|um| format!("{um:.0}")));
        cells.extend(it.within.map(|share| format!("{:.1} %", 100.0 * share)));
        cells.push(format!("{:.1}", self.used));
        cells
    }
}

const HEAD: &str =
    "kind | readings | faults | RMS error | median u | within u | 2u | 3u | slits used";

fn measure(base: &Scene, options: &Options) -> Result<String> {
    let (kinds, mask) = (kinds(base)?, Mask::nominal());
    let progress = bar(kinds.len() as u64 * options.surfaces)?;
    let mut rows = vec![];
    let mut beside_theory = vec![];
    for kind in &kinds {
        progress.set_message(kind.name.clone());
        let (frame, surfaces) = (options.rows, options.surfaces);
        let outcome = Outcome::measure(&kind.scene, kind.range, &mask, frame, surfaces);
        progress.inc(surfaces);
        rows.push(outcome.row(&kind.name));
        if let Some((spot, patterns)) = kind.theory {
            beside_theory.push((kind.name.clone(), spot, patterns, outcome.summary.rms));
        }
    }
    let [near, far] = tolerances::RANGE;
    Ok(format!(
        "Simulated on a PC: the default comb, {} surfaces of each kind, frames of {} rows, the nominal \
         calibration without the tolerances of an unadjusted head. Lengths in um; within 2u: the share of \
         errors that are at most twice u, which is 95.4 % for normal errors. The first four kinds: at {} \
         m, a laser of a single wavelength, and the 1/e² diameter of its spot. The others: scenes of \
         `scenes/`, at {near} to {far:.2} m.\n\n{}\nTheory and measurement at {} m, in um unless another \
         unit is given:\n\n{}",
        options.surfaces,
        options.rows,
        tolerances::DISTANCE,
        table::of(HEAD, rows),
        tolerances::DISTANCE,
        theory::report(tolerances::DISTANCE, &beside_theory),
    ))
}

/// Reads the materials with sensors that are calibrated on them, each by surfaces of its own.
fn measure_calibrated(options: &Options) -> Result<String> {
    let each = options.surfaces.div_ceil(SENSORS);
    let progress = bar(MATERIALS.len() as u64 * SENSORS * each)?;
    let mut rows = vec![];
    for (name, scene) in MATERIALS {
        progress.set_message(format!("{name}, calibrated"));
        let scene = Scene::load(scene)?;
        let mut all = vec![];
        for number in 1..=SENSORS {
            let first = FIRST + SURFACES_OF_A_SENSOR * number;
            let sensor = Sensor::calibrated(&scene, first)?;
            let first = first + SURFACES_OF_A_SENSOR / 2;
            all.extend(sensor.read(&scene, TABLE, options.rows, first, each));
            progress.inc(each);
        }
        rows.push(Outcome::of(all).row(name));
    }
    Ok(format!(
        "Simulated on a PC: {SENSORS} sensors for each material, calibrated on it with {POINTS} points; each \
         then reads {each} other places of it at {} to {} m, in frames of {} rows. Lengths in um.\n\n{}",
        TABLE[0],
        TABLE[1],
        options.rows,
        table::of(HEAD, rows),
    ))
}

fn bar(surfaces: u64) -> Result<ProgressBar> {
    progress::bar(surfaces, "{msg:28} {wide_bar} {pos}/{len}, {eta} left")
}

fn write_drawing(base: &Scene) -> Result<()> {
    let tolerances = Tolerances::nominal();
    let write = |name: &str, text: String| {
        let path = docs::path(name);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        std::fs::write(path, text).with_context(|| name.to_owned())
    };
    write(SVG, drawing::svg(&tolerances))?;
    write(DXF, dxf::write(&tolerances))?;
    write(FIGURE, figure::svg(base))?;
    docs::write_block(PAGE, "cargo comb, mask", &tolerances::report(&tolerances))
}

pub fn main(options: &Options) -> Result<()> {
    let base = Scene::load(BASE)?;
    if options.drawing {
        write_drawing(&base)?;
        println!("{}", tolerances::report(&Tolerances::nominal()));
        println!("Written: {SVG}, {DXF}, {FIGURE}, and the tolerances in {PAGE}.");
        return Ok(());
    }
    if options.design {
        let variants = design::measure(&base, options.rows, options.surfaces.div_ceil(5))?;
        let block = ("cargo comb, design", design::report(&variants));
        docs::print_or_write("cargo comb --design", options.write, PAGE, &[block])?;
        if options.write {
            design::draw(&variants, &docs::path(design::FIGURE))?;
        }
        return Ok(());
    }
    let blocks = [
        ("cargo comb", measure(&base, options)?),
        ("cargo comb, calibrated", measure_calibrated(options)?),
    ];
    docs::print_or_write("cargo comb", options.write, PAGE, &blocks)?;
    if options.write {
        write_drawing(&base)?;
    }
    Ok(())
}
