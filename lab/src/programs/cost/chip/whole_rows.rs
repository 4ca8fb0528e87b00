//! Whole rows on the chip: the instructions from a row's words to its centre with its check, by step.

use anyhow::{Context as _, Result, ensure};
use cost_on_chip::whole_rows::{COMB, FRAME};
use slitrange::centre::Estimator;
use virtual_board::trace::Call;

use super::lines::Line;
use super::program::Program;
use super::run::{Run, Slow};
use super::steps::{self, Functions, Steps};
use super::{CLOCK_ROUNDS, pairs, sorted};

/// What rows with a spot of one width take by one estimator: the medians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtWidth {
    pub estimator: Estimator,
    /// Sigma in pixels.
    pub width: f64,
    pub first: Steps,
    /// The second row of a frame.
    pub following: Steps,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnceAFrame {
    pub estimator: Estimator,
    /// The row that completes the frame.
    pub last: Steps,
    /// The reading: a distance with its uncertainty.
    pub distance: Steps,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Slowest {
    pub estimator: Estimator,
    pub name: String,
    pub row: Steps,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct WholeRows {
    pub at_widths: Vec<AtWidth>,
    pub once_a_frame: Vec<OnceAFrame>,
    pub slowest: Vec<Slowest>,
    /// A comb of 16 slits, by the default estimator.
    pub comb: Option<Comb>,
}

/// The first row of a comb's frame, the second, and the one that completes the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comb {
    pub first: Steps,
    pub following: Steps,
    pub last: Steps,
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
    let mut whole_rows = WholeRows::default();
    for estimator in Estimator::ALL {
        let name = estimator.name();
        for &width in &widths {
            whole_rows.at_widths.push(AtWidth {
                estimator,
                width,
                first: median(name, 1, Some(width))?,
                following: median(name, 2, Some(width))?,
            });
        }
        let reading = readings.iter().find(|(line, _)| line.name == name);
        let (_, reading) = reading.context("the chip's program made no reading")?;
        whole_rows.once_a_frame.push(OnceAFrame {
            estimator,
            last: median(name, FRAME, None)?,
            distance: functions.steps(reading)?,
        });
    }
    whole_rows.comb = Some(Comb {
        first: median(COMB, 1, None)?,
        following: median(COMB, 2, None)?,
        last: median(COMB, FRAME, None)?,
    });
    let slowest = run.slowest.iter().map(|slow: &Slow| {
        Ok(Slowest {
            estimator: slow.estimator,
            name: slow.name.clone(),
            row: functions.steps(&slow.call)?,
        })
    });
    whole_rows.slowest = slowest.collect::<Result<_>>()?;
    Ok(whole_rows)
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
