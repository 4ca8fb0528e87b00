//! `cargo table1`: the paper's experiment simulated, and its Table 1 beside the paper's own.

mod figures;
mod report;

use self::report::Report;
use crate::paper::apparatus::Aperture;
use crate::paper::data_set::positions;
use crate::paper::experiment::Experiment;
use crate::paper::firmware::{self, Fit, Head};
use crate::paper::materials::MATERIALS;
use crate::prelude::*;
use crate::{docs, progress, table};

const SEED: u64 = 1;

/// Simulates the paper's experiment: six materials, lens against slit, 16,800 positions of five captures
/// each. Then the firmware's estimators at every tenth of these positions: on the camera, and on a line
/// sensor with one slit and with a comb.
#[derive(Args)]
pub struct Options {
    /// Every tenth position
    #[arg(long)]
    quick: bool,
    /// Only the firmware's estimators
    #[arg(long)]
    firmware: bool,
    /// Also rewrite the tables and the figures of docs/physics.md with these results
    #[arg(long)]
    write: bool,
}

pub fn main(options: &Options) -> anyhow::Result<()> {
    let stride = if options.quick { 10 } else { 1 };
    let of_firmware = by_firmware(10 * stride)?;
    println!("{of_firmware}");
    let report = (!options.firmware).then(|| run(stride)).transpose()?;
    if let Some(report) = &report {
        print!("{}", report.markdown());
    }
    if !options.write {
        docs::print_hint(
            "cargo table1",
            "docs/physics.md and the figures paper-*.svg",
        );
        return Ok(());
    }
    docs::write_block("docs/physics.md", "cargo table1, firmware", &of_firmware)?;
    if let Some(report) = report {
        figures::draw(&report, &docs::path("docs/figures"))?;
        docs::write_block("docs/physics.md", "cargo table1", &report.markdown())?;
    }
    Ok(())
}

/// The heads that the firmware is judged on, and their names.
const HEADS: [(&str, Head); 3] = [
    ("camera", Head::Camera),
    ("line sensor, one slit", Head::Line(Slits::One)),
    ("line sensor, comb", Head::Line(Slits::Comb)),
];

/// The mean errors of the paper's fit and of the firmware's estimators, as a table.
fn by_firmware(stride: usize) -> anyhow::Result<String> {
    let firmware = Estimator::ALL.map(Fit::Firmware);
    let fits: Vec<Fit> = [Fit::Plain].into_iter().chain(firmware).collect();
    let positions = (MATERIALS.len() * HEADS.len() * positions(stride).len()) as u64;
    let progress = progress::bar(
        positions,
        "{msg:24} {wide_bar} {pos}/{len} positions, {eta} left",
    )?;
    let (mut rows, mut without) = (vec![], 0);
    for (material, it) in MATERIALS.iter().enumerate() {
        for (name, head) in HEADS {
            progress.set_message(format!("{}, {name}", it.name));
            let judged = firmware::judge(head, &fits, material, SEED, stride, &|| progress.inc(1))?;
            without += judged.iter().map(|it| it.without_centre).sum::<usize>();
            let mae = judged.iter().map(|it| format!("{:.1}", it.mae * 1e6));
            let name = format!("{}, {name}", it.name);
            rows.push([name].into_iter().chain(mae).collect());
        }
    }
    progress.finish_and_clear();
    let names = Estimator::ALL.map(|it| match it == Estimator::default() {
        true => format!("{} (default)", it.name()),
        false => it.name().to_owned(),
    });
    let head = format!("material, head | plain gaussian | {}", names.join(" | "));
    Ok(format!(
        "MAE in um of the firmware's estimators on the same pieces of material, at every {stride}th of the \
         paper's positions, simulated on a PC. *plain gaussian*: the paper's fit, all pixels alike. A \
         reading is the plain mean of every tenth of the camera's 600 rows, or a frame of five rows of \
         the line sensor (TCD1304DG). {without} readings have no distance.\n\n{}",
        table::of(&head, rows)
    ))
}

fn run(stride: usize) -> anyhow::Result<Report> {
    let experiment = Experiment { stride, seed: SEED };
    let of_material = Aperture::ALL.len() * positions(stride).len();
    let progress = progress::bar(
        (MATERIALS.len() * of_material) as u64,
        "{msg:24} {wide_bar} {pos}/{len} positions, {eta} left",
    )?;
    let mut outcomes = vec![];
    for (material, it) in MATERIALS.iter().enumerate() {
        for aperture in Aperture::ALL {
            progress.set_message(format!("{}, {}", it.name, aperture.name()));
            outcomes.push(experiment.run(material, aperture, &|| progress.inc(1))?);
        }
    }
    progress.finish_and_clear();
    Ok(Report {
        outcomes,
        experiment,
    })
}
