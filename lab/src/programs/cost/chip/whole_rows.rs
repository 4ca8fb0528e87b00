//! Whole rows on the chip: the instructions from a row's words to its centre with its check, by step.

use cost_on_chip::whole_rows::{COMB, FRAME, WIDTH};
use virtual_board::trace::Call;

use super::lines::Line;
use super::program::Program;
use super::run::Run;
use super::steps::{self, Functions, Steps};
use super::{CLOCK_ROUNDS, pairs, sorted};
use crate::prelude::*;

/// The kinds of rows, and what makes a reading of a frame, as `whole-rows.csv` names them.
pub const FOLLOWING: &str = "following";
pub const FIRST: &str = "first";
pub const SLOWEST: &str = "slowest";
pub const LAST: &str = "last of a frame";
pub const READING: &str = "reading";

/// What rows of a kind take, or a reading: the median.
#[derive(Clone, Debug, PartialEq)]
pub struct WholeRow {
    pub kind: &'static str,
    /// The estimator's name, or [`COMB`], which is by the default estimator.
    pub name: &'static str,
    /// The spot's sigma in pixels, if it is known.
    pub width: Option<f64>,
    pub steps: Steps,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct WholeRows(pub Vec<WholeRow>);

impl WholeRows {
    pub fn add(
        &mut self,
        kind: &'static str,
        name: &'static str,
        width: Option<f64>,
        steps: Steps,
    ) {
        self.0.push(WholeRow {
            kind,
            name,
            width,
            steps,
        });
    }
}

/// The core's files, but for those of `base`, that a following row, a frame's last row and a reading by the
/// default estimator lie in.
pub fn core_files(run: &Run, program: &Program) -> Result<BTreeSet<String>> {
    let functions = Functions::of(&run.firmware)?;
    let name = Estimator::default().name();
    let rows = with_calls(run, program, "whole-row", steps::ROW)?;
    let is_usual = |line: &Line| {
        let value = |key| line.values.get(key).copied();
        value("width") == Some(WIDTH.into()) && value("place") >= Some(2.0)
    };
    let rows = rows.into_iter().filter(|(line, _)| is_usual(line));
    let readings = with_calls(run, program, "reading", steps::READING)?;
    for (line, call) in rows.chain(readings) {
        if line.name == name {
            functions.steps(call)?;
        }
    }
    Ok(functions.core_files())
}

pub fn read(run: &Run, program: &Program) -> Result<WholeRows> {
    let functions = Functions::of(&run.firmware)?;
    let rows = with_calls(run, program, "whole-row", steps::ROW)?;
    let readings = with_calls(run, program, "reading", steps::READING)?;
    let mut widths: Vec<f64> = vec![];
    for (line, _) in &rows {
        let width = line.number("width")?;
        if !widths.contains(&width) {
            widths.push(width);
        }
    }
    // The median of the rows of a name at a place in their frame, at one width or at all.
    let median = |name: &str, place: u16, width: Option<f64>| {
        let calls = rows.iter().filter(|(line, _)| {
            line.name == name
                && line.values.get("place") == Some(&f64::from(place))
                && width.is_none_or(|width| line.values.get("width") == Some(&width))
        });
        let calls = sorted(calls.map(|(_, call)| *call));
        let median = calls.get(calls.len() / 2);
        functions.steps(median.context("the chip's program measured no such row")?)
    };
    let mut all = WholeRows::default();
    let names = Estimator::ALL.map(Estimator::name);
    for name in names {
        for width in widths.iter().map(|&width| Some(width)) {
            all.add(FOLLOWING, name, width, median(name, 2, width)?);
            all.add(FIRST, name, width, median(name, 1, width)?);
        }
    }
    for slow in &run.slowest {
        let steps = functions.steps(&slow.call)?;
        all.add(SLOWEST, slow.estimator.name(), None, steps);
    }
    let nominal = Some(f64::from(WIDTH));
    for name in names {
        let reading = readings.iter().find(|(line, _)| line.name == name);
        let (_, reading) = reading.context("the chip's program made no reading")?;
        all.add(LAST, name, nominal, median(name, FRAME, None)?);
        all.add(READING, name, nominal, functions.steps(reading)?);
    }
    for (kind, place) in [(FOLLOWING, 2), (FIRST, 1), (LAST, FRAME)] {
        all.add(kind, COMB, nominal, median(COMB, place, None)?);
    }
    Ok(all)
}

/// Each line of a kind with its call, whose instructions must be the line's cycles.
fn with_calls<'a>(
    run: &'a Run,
    program: &Program,
    kind: &str,
    function: &str,
) -> Result<Vec<(&'a Line, &'a Call)>> {
    let address = program
        .address(function)
        .with_context(|| format!("the chip's program has no function {function}"))?;
    let calls = run.calls.iter().filter(|call| call.function == address);
    let pairs = pairs(run, kind, calls)?;
    for (line, call) in &pairs {
        let (said, counted) = (line.whole("cycles")?, call.instructions());
        ensure!(
            said.abs_diff(counted) <= CLOCK_ROUNDS,
            "{line:?} executes {counted} instructions"
        );
    }
    Ok(pairs)
}
