//! What each method costs on the chip: the program of `cost-on-chip`, built, run on the emulated board and
//! read.
//!
//! - **Instructions** of a method are exact: those that the emulated core executed from the method's first to
//!   its return. The program's own count is checked against them: there its cycle counter counts one
//!   for each instruction.
//! - **Code** is the size of all functions that can be reached from the method's own. What methods share is
//!   counted for each: see [`program`]. **Tables** are the weights that the method reads.
//! - **Stack** is what the call wrote to below its caller's.
//! - **Whole rows** are counted from the words to the centre with its check, by step: see [`steps`].
//! - **Distances** are counted likewise, by every form of a calibration, from the first instruction of the
//!   function that makes them.
//!
//! The program prints the same lines on a board, where its cycles are the silicon's: [`on_board`].

mod lines;
pub mod program;
mod run;
pub mod steps;
#[cfg(test)]
mod tests;
pub mod whole_rows;

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use cost_on_chip::methods::Method;
use serde::Serialize;
use slitrange::centre::Estimator;
use slitrange::centre::tables::{self, TableSet};

use virtual_board::trace::Call;

use lines::{Kind, Line};
use program::Program;
use run::Run;
use whole_rows::WholeRows;

/// The package that runs on the chip.
const PACKAGE: &str = "cost-on-chip";

/// The function that makes a distance of a centre, as Rust names it.
const DISTANCE_AT: &str = "<slitrange::distance::Calibration>::distance_at";

/// The emulator makes its cycle counter from whole nanoseconds, of which a cycle has six: a difference is off
/// by up to this.
const CLOCK_ROUNDS: u64 = 2;

/// What was counted on the chip.
#[derive(Clone, Debug, Default)]
pub struct Chip {
    /// Every method at every width, the widths rising for each method.
    pub methods: Vec<MethodOnChip>,
    /// The coarse search of a whole row, the spot's width being known from the row before.
    pub sweep_instructions_per_pixel: f64,
    /// The same for a spot of any width: the first row of a frame.
    pub search_instructions_per_pixel: f64,
    /// Turning the words of a read-out into a row.
    pub geometry_instructions_per_word: f64,
    /// Words in, centre added to the frame: all that a row takes.
    pub whole_rows: WholeRows,
    /// Every form of a calibration.
    pub forms: Vec<FormOnChip>,
    /// What one would use instead.
    pub peers: Vec<PeerOnChip>,
    /// The exponential, the logarithm and the square root by each library.
    pub floats: Vec<FloatOnChip>,
}

/// One method at one width, over several rows: the spot is known, and so is what the method found in the row
/// before.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MethodOnChip {
    /// The method's name.
    pub name: String,
    /// Sigma in pixels.
    pub width: f64,
    /// Instructions, the median over the rows.
    pub instructions: u64,
    /// The most over the rows.
    pub instructions_most: u64,
    /// Bytes of all functions that it may call.
    pub code_bytes: u64,
    /// Bytes of weights.
    pub table_bytes: u64,
    /// Bytes of stack.
    pub stack_bytes: u64,
    /// The fault that one of the rows gave, if one did.
    pub fault: Option<String>,
}

/// A form of a calibration, over several centres: a distance, once a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FormOnChip {
    /// Its name in the log.
    pub name: String,
    /// Instructions, the median over the centres.
    pub instructions: u64,
    /// The most over the centres.
    pub instructions_most: u64,
    /// Bytes of stack.
    pub stack_bytes: u64,
}

/// A peer's fit of eq. (5) to 127 pixels.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PeerOnChip {
    /// The crate, and its numbers' type.
    pub name: String,
    /// Instructions, the median over the rows.
    pub instructions: u64,
    /// Bytes of stack.
    pub stack_bytes: u64,
}

/// A function of floats by a library, over several arguments.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FloatOnChip {
    /// Its name in the log.
    pub name: String,
    /// Instructions of a call, the median over the arguments.
    pub instructions: f64,
    /// The most over the arguments.
    pub instructions_most: f64,
}

/// Builds the program, runs it on the emulated board and reads what it says.
///
/// # Errors
/// The build or the emulation fails, or a line of the log is missing or makes no sense.
pub fn measure() -> Result<Chip> {
    let run = Run::of(PACKAGE)?;
    chip(&run)
}

/// Flashes and runs the program on a NUCLEO-F429ZI. It prints its lines, whose cycles are the silicon's.
///
/// # Errors
/// `cargo` or `probe-rs` says itself why the program does not run on the board; this says that it failed.
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
        "{PACKAGE} did not run on the board ({status}); it needs probe-rs (cargo install probe-rs-tools) and \
         the board's USB"
    );
    Ok(())
}

fn chip(run: &Run) -> Result<Chip> {
    check_the_counter(run)?;
    let program = Program::of(&run.firmware)?;
    let step = |name| lines::find(&run.lines, Kind::Step, name);
    let per_item =
        |line: &Line| Ok::<f64, anyhow::Error>(line.number("cycles")? / line.number("items")?);
    let kernels = lines::find(&run.lines, Kind::Kernels, "dual-mac")?;
    let different = kernels.whole("different")?;
    ensure!(
        different == 0,
        "on the chip {different} inner products or square roots in assembly are not what they are elsewhere"
    );
    Ok(Chip {
        methods: methods(run, &program)?,
        search_instructions_per_pixel: per_item(step("spot-find")?)?,
        sweep_instructions_per_pixel: per_item(step("spot-find-again")?)?,
        geometry_instructions_per_word: per_item(step("geometry-row")?)?,
        whole_rows: whole_rows::read(run, &program)?,
        forms: forms(run, &program)?,
        peers: lines::all(&run.lines, Kind::Peer)
            .map(peer)
            .collect::<Result<_>>()?,
        floats: lines::all(&run.lines, Kind::Float)
            .map(float)
            .collect::<Result<_>>()?,
    })
}

/// The program's count of a function of a hundred instructions and eight bytes of stack.
fn check_the_counter(run: &Run) -> Result<()> {
    let known = lines::find(&run.lines, Kind::Known, "hundred-instructions")?;
    let (cycles, stack) = (known.whole("cycles")?, known.whole("stack")?);
    ensure!(
        cycles.abs_diff(100) <= CLOCK_ROUNDS && stack == 8,
        "a hundred instructions and 8 bytes of stack were counted as {cycles} and {stack}"
    );
    Ok(())
}

fn methods(run: &Run, program: &Program) -> Result<Vec<MethodOnChip>> {
    let calls = calls_of_methods(run, program)?;
    let mut counted_methods = Vec::new();
    for method in Method::ALL {
        let name = method.name();
        let code_bytes = program.reachable_bytes(&wrapper(name))?;
        for line in lines::all(&run.lines, Kind::Method).filter(|line| line.name == name) {
            let width = line.number("width")?;
            let rows = || {
                calls
                    .iter()
                    .filter(|(row, _)| row.name == name && row.values.get("width") == Some(&width))
            };
            let instructions = sorted(rows().map(|(_, call)| call.instructions()));
            let (Some(median), Some(most)) = (middle(&instructions), instructions.last()) else {
                bail!("the chip's program ran {name} on no row of width {width}");
            };
            let counted = line.whole("cycles")?;
            ensure!(
                counted.abs_diff(median) <= CLOCK_ROUNDS,
                "{name} at width {width} executes {median} instructions, but the cycle counter says {counted}"
            );
            counted_methods.push(MethodOnChip {
                name: name.to_owned(),
                width,
                instructions: median,
                instructions_most: *most,
                code_bytes,
                table_bytes: table_bytes(method),
                stack_bytes: line.whole("stack")?,
                fault: rows().find_map(|(row, _)| row.fault.clone()),
            });
        }
    }
    Ok(counted_methods)
}

/// The program prints a line for each call of a method, in the order of the calls: each line with its call.
fn calls_of_methods<'a>(run: &'a Run, program: &Program) -> Result<Vec<(&'a Line, &'a Call)>> {
    // Functions of the same instructions are one, so an address may stand for several methods.
    let wrappers: BTreeSet<u64> = Method::ALL
        .into_iter()
        .filter_map(|method| program.address(&wrapper(method.name())))
        .collect();
    let calls: Vec<&Call> = run
        .calls
        .iter()
        .filter(|call| wrappers.contains(&call.function))
        .collect();
    let rows: Vec<&Line> = lines::all(&run.lines, Kind::Row).collect();
    ensure!(
        calls.len() == rows.len(),
        "the chip's program called {} methods and spoke of {}",
        calls.len(),
        rows.len()
    );
    Ok(rows.into_iter().zip(calls).collect())
}

/// The program asks each form for a distance at each of its centres, and prints a line for each.
fn forms(run: &Run, program: &Program) -> Result<Vec<FormOnChip>> {
    let function = program
        .named(DISTANCE_AT)
        .with_context(|| format!("the chip's program has no function {DISTANCE_AT}"))?;
    let asked: Vec<&Line> = lines::all(&run.lines, Kind::Distance).collect();
    // A reading makes a distance too, and returns after it.
    let reading = program.address(steps::READING);
    let mut calls: Vec<&Call> = vec![];
    for call in &run.calls {
        if call.function == function {
            calls.push(call);
        } else if Some(call.function) == reading {
            calls.pop();
        }
    }
    ensure!(
        calls.len() == asked.len(),
        "the chip's program made {} distances and spoke of {}",
        calls.len(),
        asked.len()
    );
    let form = |line: &Line| {
        let calls = || {
            let pairs = asked.iter().zip(&calls);
            pairs.filter_map(|(asked, call)| (asked.name == line.name).then_some(call))
        };
        let instructions = sorted(calls().map(|call| call.instructions()));
        let (Some(median), Some(most)) = (middle(&instructions), instructions.last()) else {
            bail!("the chip's program made no distance by {}", line.name);
        };
        Ok(FormOnChip {
            name: line.name.clone(),
            instructions: median,
            instructions_most: *most,
            stack_bytes: line.whole("stack")?,
        })
    };
    lines::all(&run.lines, Kind::Form).map(form).collect()
}

/// Calls from the shortest to the longest.
fn sorted_by_instructions<'a>(calls: impl Iterator<Item = &'a Call>) -> Vec<&'a Call> {
    let mut calls: Vec<&Call> = calls.collect();
    calls.sort_by_key(|call| call.instructions());
    calls
}

fn sorted(numbers: impl Iterator<Item = u64>) -> Vec<u64> {
    let mut numbers: Vec<u64> = numbers.collect();
    numbers.sort_unstable();
    numbers
}

/// The median of sorted numbers, the upper one of two.
fn middle(sorted: &[u64]) -> Option<u64> {
    sorted.get(sorted.len() / 2).copied()
}

/// The function on the chip that is a method alone.
fn wrapper(name: &str) -> String {
    format!("method_{}", name.replace('-', "_"))
}

/// Bytes of the weights that a method reads.
fn table_bytes(method: Method) -> u64 {
    match method {
        Method::Estimator(Estimator::Centroid | Estimator::GaussNewton) => 0,
        Method::Estimator(Estimator::PhaseTable) => bytes_of(&tables::GAUSSIAN),
        Method::Estimator(Estimator::Fraunhofer) => bytes_of(&tables::SLIT),
        Method::Estimator(Estimator::Adaptive) | Method::Repair => {
            let mixes = tables::MIXES.iter().map(|mix| bytes_of(mix.tables));
            mixes.sum::<u64>() + bytes_of(&tables::TILTED)
        }
    }
}

/// Bytes of a set's weights.
fn bytes_of(set: &TableSet<'_>) -> u64 {
    set.tables()
        .iter()
        .map(|table| size_of_val(table.weights) + size_of_val(table.stretch))
        .sum::<usize>() as u64
}

fn peer(line: &Line) -> Result<PeerOnChip> {
    Ok(PeerOnChip {
        name: line.name.replace("-f32", " f32").replace("-f64", " f64"),
        instructions: line.whole("cycles")?,
        stack_bytes: line.whole("stack")?,
    })
}

fn float(line: &Line) -> Result<FloatOnChip> {
    let a_call = |key| Ok::<f64, anyhow::Error>(line.number(key)? / line.number("calls")?);
    Ok(FloatOnChip {
        name: line.name.clone(),
        instructions: a_call("cycles")?,
        instructions_most: a_call("most")?,
    })
}
