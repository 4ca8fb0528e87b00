//! How true u is on rough surfaces: `cargo surfaces`.

use slitrange::reading::uncertainty::{CalibrationErrors, FittedErrors};
use slitrange_device::record::Record;
use slitrange_device::record::encoded::EncodedRecord;

use crate::docs;
use crate::prelude::*;
use crate::surfaces::{MATERIALS, Study, calibrate, report};
use crate::surfaces::{estimators, steps};

/// Calibrates simulated sensors on rough materials, and compares what their readings claim with the truth.
/// Compares the estimators on the same materials. Takes about ten minutes.
#[derive(Args)]
pub struct Options {
    /// Sensors that are calibrated on each material
    #[arg(long, default_value_t = 10)]
    sensors: u64,
    /// Surfaces that each of them reads
    #[arg(long, default_value_t = 105)]
    surfaces: u64,
    /// Also rewrite the tables of docs/uncertainty.md and docs/accuracy.md, and the demo's record
    #[arg(long)]
    write: bool,
}

/// The demo's record, from the workspace's root.
const RECORD: &str = "virtual-board/src/bin/demo/paper.record";

/// Points of the demo's calibration on white paper.
const POINTS: usize = 240;

/// The first surface of the demo's calibration. No other sensor sees these.
const FIRST: u64 = 50_000_000;

/// The demo's sensor: its curve is from a target without speckle, so that the demo shows what the core can do
/// there; what it says of the surface is from white paper.
fn record_of_demo() -> Result<Record> {
    let [quiet, paper] = [("quiet-paper", 60), (MATERIALS[0].1, POINTS)]
        .map(|(scene, points)| calibrate(&Scene::load(scene)?, points, FIRST));
    let (quiet, paper) = (quiet?, paper?);
    let (CalibrationErrors::Fitted(curve), CalibrationErrors::Fitted(surface)) =
        (&quiet.errors, &paper.errors)
    else {
        bail!("a fit of many points says nothing of its errors");
    };
    Ok(Record {
        errors: CalibrationErrors::Fitted(FittedErrors {
            curve: curve.curve,
            surface: surface.surface,
        }),
        // The spots on white paper scatter as those of the demo do.
        profile: paper.profile,
        ..quiet
    })
}

pub fn main(options: &Options) -> Result<()> {
    if options.write {
        let record = EncodedRecord::new(record_of_demo()?)?;
        std::fs::write(docs::path(RECORD), record.bytes()).context(RECORD)?;
    }
    let studies = MATERIALS
        .map(|(name, scene)| Study::run(name, scene, options.sensors, options.surfaces))
        .into_iter();
    let blocks = [
        (
            "cargo surfaces",
            report(&studies.collect::<Result<Vec<_>>>()?),
        ),
        (
            "cargo surfaces, steps",
            steps::report(&steps::measure(steps::SURFACES)?),
        ),
    ];
    let command = "cargo surfaces";
    docs::print_or_write(command, options.write, "docs/uncertainty.md", &blocks)?;
    let compared = estimators::report(&estimators::measure()?);
    let block = ("cargo surfaces, estimators", compared);
    docs::print_or_write(command, options.write, "docs/accuracy.md", &[block])
}
