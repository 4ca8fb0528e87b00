//! What each rung costs on the chip: the program of `cost-on-chip`, built, run on the emulated board and read.
//!
//! - **Instructions** are exact: the emulated core's cycle counter counts one for each instruction that it executes (the
//!   program checks that on a function of a hundred). Beside them stands what a call costs that does nothing.
//! - **Cycles** are an estimate from the instructions that were executed: see [`cycles`].
//! - **Code** is the size of all functions that can be reached from the rung's own, with what they share with other rungs
//!   counted for each: see [`program`]. **Tables** are the weights that the rung reads.
//! - **Stack** is what the call wrote to below its caller's.
//!
//! The program prints the same lines on a board, where its cycles are the silicon's: [`on_board`].

mod cycles;
mod lines;
mod program;
mod run;
#[cfg(test)]
mod tests;

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use slitrange::estimator::Estimator;
use slitrange::estimator::tables::{self, TableSet};

use cycles::Model;
use lines::{Kind, Line};
use program::Program;
use run::Run;

/// The package that runs on the chip.
const PACKAGE: &str = "cost-on-chip";

/// The function that does one iteration of the Gauss-Newton rung, as Rust names it.
const GAUSS_NEWTON_ITERATION: &str = "slitrange::estimator::gauss_newton::iterate";

/// What was counted on the chip.
#[derive(Clone, Debug)]
pub struct Chip {
    /// Every rung at every width, the widths rising for each rung.
    pub rungs: Vec<RungOnChip>,
    /// The coarse search of a whole row.
    pub sweep_instructions_per_pixel: f64,
    /// The coarse search near the row before's spot, over the row's pixels, where there is one.
    pub tracked_sweep_instructions_per_pixel: Option<f64>,
    /// Turning the words of a read-out into a row.
    pub geometry_instructions_per_word: f64,
    /// One iteration of the Gauss-Newton rung, the mean over all of its rows, where it iterates.
    pub gauss_newton_instructions_per_iteration: Option<f64>,
    /// Words in, centre added to the frame: all that a row takes, with the default settings.
    pub measurement_instructions_per_row: u64,
    /// Eq. (1), once a frame.
    pub distance_instructions: u64,
    /// What one would use instead.
    pub peers: Vec<PeerOnChip>,
    /// Times that an inner product or a square root in assembly was compared with its portable twin.
    pub kernels_compared: u64,
    /// How often they differed.
    pub kernels_different: u64,
    /// What the rungs found in each row.
    pub found: Vec<Found>,
}

/// One rung at one width, over several rows: the spot is known, and so is what the rung found in the row before.
#[derive(Clone, Debug, PartialEq)]
pub struct RungOnChip {
    /// The estimator's name.
    pub name: String,
    /// Sigma in pixels.
    pub width: f64,
    /// Instructions, the median over the rows.
    pub instructions: u64,
    /// The most over the rows.
    pub instructions_most: u64,
    /// Estimated cycles, the median over the rows.
    pub cycles_estimated: u64,
    /// Bytes of all functions that it may call.
    pub code_bytes: u64,
    /// Bytes of weights.
    pub table_bytes: u64,
    /// Bytes of stack.
    pub stack_bytes: u64,
    /// The fault that one of the rows gave, if one did.
    pub fault: Option<String>,
}

/// A peer's fit of eq. (5) to 127 pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct PeerOnChip {
    /// Its name.
    pub name: String,
    /// Instructions, the median over the rows.
    pub instructions: u64,
    /// Bytes of stack.
    pub stack_bytes: u64,
}

/// What a rung found in a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The estimator's name.
    pub name: String,
    /// Sigma in pixels.
    pub width: f64,
    /// The row's number.
    pub row: usize,
    /// The bits of centre and uncertainty, or the fault's name.
    pub found: Result<(i32, i32), String>,
}

/// Builds the program, runs it on the emulated board and reads what it says.
///
/// # Errors
/// The build or the emulation fails, or a line of the log is missing or makes no sense.
pub fn measure() -> Result<Chip> {
    let run = Run::of(PACKAGE)?;
    chip(&run)
}

/// Flashes and runs the program on a NUCLEO-F429ZI. Its lines say `cycles`, and there they are the silicon's.
///
/// # Errors
/// `cargo` or `probe-rs` says so itself; this says that it failed.
pub fn on_board() -> Result<()> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let status = Command::new(cargo)
        .args(["run", "--release", "--target", "thumbv7em-none-eabihf"])
        .args(["--package", PACKAGE])
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .status()
        .context("cargo did not start")?;
    ensure!(
        status.success(),
        "{PACKAGE} did not run on the board ({status}); it needs probe-rs (cargo install probe-rs-tools) and the board's USB"
    );
    Ok(())
}

fn chip(run: &Run) -> Result<Chip> {
    let program = Program::of(&run.firmware)?;
    let model = Model::of(&program);
    let step = |name| lines::find(&run.lines, Kind::Step, name);
    let per_item =
        |line: &Line| Ok::<f64, anyhow::Error>(line.number("cycles")? / line.number("items")?);
    let kernels = lines::find(&run.lines, Kind::Kernels, "dual-mac")?;
    Ok(Chip {
        rungs: rungs(run, &program, &model)?,
        sweep_instructions_per_pixel: per_item(step("spot-find")?)?,
        tracked_sweep_instructions_per_pixel: step("spot-find-again")
            .ok()
            .map(per_item)
            .transpose()?,
        geometry_instructions_per_word: per_item(step("geometry-row")?)?,
        gauss_newton_instructions_per_iteration: gauss_newton_iteration(run, &program),
        measurement_instructions_per_row: step("measurement-row")?.whole("cycles")?,
        distance_instructions: step("distance-at")?.whole("cycles")?,
        peers: lines::all(&run.lines, Kind::Peer)
            .map(peer)
            .collect::<Result<_>>()?,
        kernels_compared: kernels.whole("compared")?,
        kernels_different: kernels.whole("different")?,
        found: lines::all(&run.lines, Kind::Row)
            .map(found)
            .collect::<Result<_>>()?,
    })
}

fn rungs(run: &Run, program: &Program, model: &Model<'_>) -> Result<Vec<RungOnChip>> {
    let mut rungs = Vec::new();
    for estimator in Estimator::ALL {
        let name = estimator.name();
        let wrapper = wrapper(name);
        let mut calls = run.calls_of(program, &wrapper)?;
        for line in lines::all(&run.lines, Kind::Rung).filter(|line| line.name == name) {
            let rows = lines::all(&run.lines, Kind::Row).filter(|row| {
                row.name == name && row.values.get("width") == line.values.get("width")
            });
            let faults: Vec<Option<String>> = rows.map(|row| row.fault.clone()).collect();
            let mut cycles: Vec<u64> = calls
                .by_ref()
                .take(faults.len())
                .map(|call| model.cycles(call))
                .collect();
            ensure!(
                cycles.len() == faults.len() && !cycles.is_empty(),
                "{wrapper} was called fewer times than it printed a row"
            );
            cycles.sort_unstable();
            rungs.push(RungOnChip {
                name: name.to_owned(),
                width: line.number("width")?,
                instructions: line.whole("cycles")?,
                instructions_most: line.whole("most")?,
                cycles_estimated: cycles[cycles.len() / 2],
                code_bytes: program.reachable_bytes(&wrapper)?,
                table_bytes: table_bytes(estimator),
                stack_bytes: line.whole("stack")?,
                fault: faults.into_iter().flatten().next(),
            });
        }
    }
    Ok(rungs)
}

/// The function on the chip that is a rung alone.
fn wrapper(name: &str) -> String {
    format!("rung_{}", name.replace('-', "_"))
}

/// Bytes of the weights that a rung reads.
fn table_bytes(estimator: Estimator) -> u64 {
    match estimator {
        Estimator::Centroid
        | Estimator::Parabola
        | Estimator::LogParabola
        | Estimator::ZeroCrossing
        | Estimator::GaussNewton => 0,
        Estimator::Blocks
        | Estimator::PhaseTable
        | Estimator::Adaptive
        | Estimator::Robust
        | Estimator::Fraunhofer => bytes_of(&tables::GAUSSIAN),
    }
}

/// Bytes of a set's weights.
fn bytes_of(set: &TableSet<'_>) -> u64 {
    set.tables()
        .iter()
        .map(|table| {
            size_of_val(table.score) + size_of_val(table.slope) + size_of_val(table.stretch)
        })
        .sum::<usize>() as u64
}

/// The mean over all calls of the function that does one iteration; `None` where the program has none.
fn gauss_newton_iteration(run: &Run, program: &Program) -> Option<f64> {
    let iteration = program.named(GAUSS_NEWTON_ITERATION)?;
    let counts: Vec<u64> = run
        .calls
        .iter()
        .filter(|call| call.function == iteration)
        .map(virtual_board::trace::Call::instructions)
        .collect();
    (!counts.is_empty()).then(|| counts.iter().sum::<u64>() as f64 / counts.len() as f64)
}

fn peer(line: &Line) -> Result<PeerOnChip> {
    Ok(PeerOnChip {
        name: line.name.clone(),
        instructions: line.whole("cycles")?,
        stack_bytes: line.whole("stack")?,
    })
}

fn found(line: &Line) -> Result<Found> {
    Ok(Found {
        name: line.name.clone(),
        width: line.number("width")?,
        row: usize::try_from(line.whole("number")?)?,
        found: match &line.fault {
            Some(fault) => Err(fault.clone()),
            // Whole numbers of 32 bits, which a double holds.
            None => Ok((
                line.number("centre")? as i32,
                line.number("uncertainty")? as i32,
            )),
        },
    })
}
