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

use std::process::Command;

use cost_on_chip::methods::Method;
use slitrange::centre::tables::{self, TableSet};

use virtual_board::trace::Call;

use lines::Line;
use program::Program;
use run::Run;
use whole_rows::WholeRows;

use crate::prelude::*;

const PACKAGE: &str = "cost-on-chip";

/// The function that makes a distance of a centre, as Rust names it.
const DISTANCE_AT: &str = "<slitrange::distance::Calibration>::distance_at";

/// The emulator makes its cycle counter from whole nanoseconds, of which a cycle has six: a difference is off
/// by up to this.
const CLOCK_ROUNDS: u64 = 2;

#[derive(Clone, Debug, Default)]
pub struct Chip {
    /// Every method at every width, the widths rising for each method.
    pub methods: Vec<MethodOnChip>,
    /// The coarse search of a whole row, the spot's width being known from the row before.
    pub search_again_instructions_per_pixel: f64,
    /// The same for a spot of any width: the first row of a frame.
    pub search_instructions_per_pixel: f64,
    /// Turning the words of a read-out into a row.
    pub geometry_instructions_per_word: f64,
    /// Words in, centre added to the frame: all that a row takes.
    pub whole_rows: WholeRows,
    /// See [`whole_rows::core_files`].
    pub core_files: BTreeSet<String>,
    /// Every form of a calibration, over several centres.
    pub forms: Vec<Counted>,
    /// The crates that one would use instead: a fit of eq. (5) to 127 pixels.
    pub peers: Vec<Counted>,
    /// The exponential, the logarithm and the square root by each library: a call.
    pub floats: Vec<Counted>,
}

/// One method at one width, over several rows: the spot is known, and so is what the method found in the row
/// before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MethodOnChip {
    pub name: String,
    /// Sigma in pixels.
    pub width: f64,
    /// The median over the rows.
    pub instructions: u64,
    /// Bytes of all functions that it may call.
    pub code_bytes: u64,
    pub table_bytes: u64,
    pub stack_bytes: u64,
    /// The fault that one of the rows gave, if one did.
    pub fault: Option<String>,
}

/// Instructions of something with a name in the log: the median, and the most.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counted {
    pub name: String,
    pub instructions: f64,
    pub most: f64,
}

pub fn of_name<'a>(counted: &'a [Counted], name: &str) -> Result<&'a Counted> {
    let found = counted.iter().find(|counted| counted.name == name);
    found.with_context(|| format!("the chip's program did not count {name}"))
}

impl Chip {
    pub fn on_chip(&self, method: Method, width: f64) -> Option<&MethodOnChip> {
        self.methods.iter().find(|counted| {
            let at_width = (counted.width - width).abs() < 1e-9;
            counted.name == method.name() && at_width && counted.fault.is_none()
        })
    }
}

/// Builds the program, runs it on the emulated board and reads what it says.
pub fn measure() -> Result<Chip> {
    chip(&Run::of(PACKAGE)?)
}

/// Flashes and runs the program on a NUCLEO-F429ZI. It prints its lines, whose cycles are the silicon's.
/// `cargo` or `probe-rs` says itself why the program does not run on the board.
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
    let per_item = |name| {
        let step = lines::find(&run.lines, "step", name)?;
        Ok::<f64, anyhow::Error>(step.number("cycles")? / step.number("items")?)
    };
    let kernels = lines::find(&run.lines, "kernels", "dual-mac")?;
    let (compared, different) = (kernels.whole("compared")?, kernels.whole("different")?);
    ensure!(
        compared >= 9000 && different == 0,
        "of {compared} inner products and square roots in assembly {different} are not what they are elsewhere"
    );
    let counted = |kind| {
        let counted = lines::all(&run.lines, kind).map(|line| {
            // A line of a function of floats is about many calls.
            let calls = line.number("calls").unwrap_or(1.0);
            Ok(Counted {
                name: line.name.replace("-f32", " f32").replace("-f64", " f64"),
                instructions: line.number("cycles")? / calls,
                most: line.number("most")? / calls,
            })
        });
        counted.collect::<Result<_>>()
    };
    Ok(Chip {
        methods: methods(run, &program)?,
        search_instructions_per_pixel: per_item("spot-find")?,
        search_again_instructions_per_pixel: per_item("spot-find-again")?,
        geometry_instructions_per_word: per_item("geometry-row")?,
        whole_rows: whole_rows::read(run, &program)?,
        core_files: whole_rows::core_files(run, &program)?,
        forms: forms(run, &program)?,
        peers: counted("peer")?,
        floats: counted("float")?,
    })
}

/// The program's count of a function of a hundred instructions and eight bytes of stack.
fn check_the_counter(run: &Run) -> Result<()> {
    let known = lines::find(&run.lines, "known", "hundred-instructions")?;
    let (cycles, stack) = (known.whole("cycles")?, known.whole("stack")?);
    ensure!(
        cycles.abs_diff(100) <= CLOCK_ROUNDS && stack == 8,
        "a hundred instructions and 8 bytes of stack were counted as {cycles} and {stack}"
    );
    Ok(())
}

fn methods(run: &Run, program: &Program) -> Result<Vec<MethodOnChip>> {
    let wrappers = Method::ALL.map(|method| program.address(&wrapper(method.name())));
    // Functions of the same instructions are one, so an address may stand for several methods.
    let calls = (run.calls.iter()).filter(|call| wrappers.contains(&Some(call.function)));
    let rows = pairs(run, "row", calls)?;
    let of_method = |(line, method): (&Line, Method)| {
        let width = line.number("width")?;
        let is_here = |row: &Line| row.name == line.name && row.values.get("width") == Some(&width);
        let rows = || rows.iter().filter(|(row, _)| is_here(row));
        let [instructions, _] = median_and_most(rows().map(|(_, call)| *call), &line.name)?;
        let counted = line.whole("cycles")?;
        ensure!(
            counted.abs_diff(instructions) <= CLOCK_ROUNDS,
            "{line:?} executes {instructions} instructions, but the cycle counter says {counted}"
        );
        Ok(MethodOnChip {
            name: line.name.clone(),
            width,
            instructions,
            code_bytes: program.reachable_bytes(&wrapper(&line.name))?,
            table_bytes: table_bytes(method),
            stack_bytes: line.whole("stack")?,
            fault: rows().find_map(|(row, _)| row.fault.clone()),
        })
    };
    let lines = Method::ALL.into_iter().flat_map(|method| {
        let lines = lines::all(&run.lines, "method");
        let lines = lines.filter(move |line| line.name == method.name());
        lines.map(move |line| (line, method))
    });
    lines.map(of_method).collect()
}

/// The program prints a line of a kind for each call, in the order of the calls: each line with its call.
fn pairs<'a>(
    run: &'a Run,
    kind: &str,
    calls: impl IntoIterator<Item = &'a Call>,
) -> Result<Vec<(&'a Line, &'a Call)>> {
    let calls: Vec<&Call> = calls.into_iter().collect();
    let lines: Vec<&Line> = lines::all(&run.lines, kind).collect();
    ensure!(
        calls.len() == lines.len(),
        "the chip's program made {} calls of the kind {kind} and spoke of {}",
        calls.len(),
        lines.len()
    );
    Ok(lines.into_iter().zip(calls).collect())
}

/// The program asks each form for a distance at each of its centres, and prints a line for each.
fn forms(run: &Run, program: &Program) -> Result<Vec<Counted>> {
    let function = program
        .named(DISTANCE_AT)
        .with_context(|| format!("the chip's program has no function {DISTANCE_AT}"))?;
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
    let asked = pairs(run, "distance", calls)?;
    let form = |line: &Line| {
        let of_form = asked.iter().filter(|(asked, _)| asked.name == line.name);
        let counts = median_and_most(of_form.map(|(_, call)| *call), &line.name)?;
        let [instructions, most] = counts.map(|count| count as f64);
        Ok(Counted {
            name: line.name.clone(),
            instructions,
            most,
        })
    };
    lines::all(&run.lines, "form").map(form).collect()
}

fn sorted<'a>(calls: impl Iterator<Item = &'a Call>) -> Vec<&'a Call> {
    let mut calls: Vec<&Call> = calls.collect();
    calls.sort_by_key(|call| call.instructions());
    calls
}

/// Instructions of calls: the median, the upper one of two, and the most.
fn median_and_most<'a>(calls: impl Iterator<Item = &'a Call>, name: &str) -> Result<[u64; 2]> {
    let calls = sorted(calls);
    let both = calls.get(calls.len() / 2).zip(calls.last());
    let (median, most) = both.with_context(|| format!("the chip's program never called {name}"))?;
    Ok([median, most].map(|call| call.instructions()))
}

/// The function on the chip that is a method alone.
fn wrapper(name: &str) -> String {
    format!("method_{}", name.replace('-', "_"))
}

fn table_bytes(method: Method) -> u64 {
    match method {
        Method::Estimator(Estimator::Centroid | Estimator::GaussNewton) => 0,
        Method::Estimator(Estimator::PhaseTable) => bytes_of(&tables::GAUSSIAN),
        Method::Estimator(Estimator::Fraunhofer) => bytes_of(&tables::SLIT),
        Method::Estimator(Estimator::Adaptive) | Method::Repair => {
            let mixes = tables::MIXES.iter().map(|(_, tables)| bytes_of(tables));
            mixes.sum::<u64>() + bytes_of(&tables::TILTED) + bytes_of(&tables::LOPSIDED)
        }
    }
}

fn bytes_of(set: &TableSet<'_>) -> u64 {
    set.tables()
        .iter()
        .map(|table| size_of_val(table.weights) + size_of_val(table.stretch))
        .sum::<usize>() as u64
}
