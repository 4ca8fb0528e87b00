//! Whole rows on the chip: the instructions from a row's words to its centre with its check, by step.

use anyhow::{Context as _, Result, bail, ensure};
use cost_on_chip::whole_rows::{COMB, FRAME};
use slitrange::centre::Estimator;
use virtual_board::trace::Call;

use super::lines::{self, Kind, Line};
use super::program::Program;
use super::run::{Run, Slow};
use super::steps::{self, Functions, Steps};
use super::{CLOCK_ROUNDS, sorted_by_instructions};

/// What rows with a spot of one width take by one estimator: the medians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtWidth {
    /// The estimator.
    pub estimator: Estimator,
    /// Sigma in pixels.
    pub width: f64,
    /// The first row of a frame.
    pub first: Steps,
    /// The second row of a frame.
    pub following: Steps,
}

/// What comes once a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnceAFrame {
    /// The estimator.
    pub estimator: Estimator,
    /// The row that completes the frame.
    pub last: Steps,
    /// The reading: a distance with its uncertainty.
    pub distance: Steps,
}

/// The slowest row that is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Slowest {
    /// The estimator.
    pub estimator: Estimator,
    /// What the row shows.
    pub name: String,
    /// What it takes.
    pub row: Steps,
}

/// All of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WholeRows {
    /// Each estimator at each width.
    pub at_widths: Vec<AtWidth>,
    /// Each estimator.
    pub once_a_frame: Vec<OnceAFrame>,
    /// Each estimator.
    pub slowest: Vec<Slowest>,
    /// A comb of 16 slits, by the default estimator.
    pub comb: Option<Comb>,
}

/// What the rows of a comb take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comb {
    /// The first row of a frame.
    pub first: Steps,
    /// The second row of a frame.
    pub following: Steps,
    /// The row that completes the frame.
    pub last: Steps,
}

/// Reads what came of a run.
pub fn read(run: &Run, program: &Program) -> Result<WholeRows> {
    let functions = Functions::of(&run.firmware)?;
    let rows = with_calls(run, program, Kind::WholeRow, steps::ROW)?;
    let readings = with_calls(run, program, Kind::Reading, steps::READING)?;
    let mut whole_rows = WholeRows::default();
    for estimator in Estimator::ALL {
        let of_place = |width: Option<f64>, place: f64| {
            let calls = rows.iter().filter(|(line, _)| {
                line.name == estimator.name()
                    && line.values.get("place") == Some(&place)
                    && width.is_none_or(|width| line.values.get("width") == Some(&width))
            });
            let calls = sorted_by_instructions(calls.map(|(_, call)| *call));
            let median = calls.get(calls.len() / 2);
            functions.steps(median.context("the chip's program measured no such row")?)
        };
        let mut widths: Vec<f64> = vec![];
        for (line, _) in &rows {
            let width = line.number("width")?;
            if !widths.contains(&width) {
                widths.push(width);
            }
        }
        for width in widths {
            whole_rows.at_widths.push(AtWidth {
                estimator,
                width,
                first: of_place(Some(width), 1.0)?,
                following: of_place(Some(width), 2.0)?,
            });
        }
        let reading = readings
            .iter()
            .find(|(line, _)| line.name == estimator.name());
        let (_, reading) = reading.context("the chip's program made no reading")?;
        whole_rows.once_a_frame.push(OnceAFrame {
            estimator,
            last: of_place(None, f64::from(FRAME))?,
            distance: functions.steps(reading)?,
        });
    }
    let of_comb = |place: u16| {
        let mut calls = rows.iter().filter(|(line, _)| {
            line.name == COMB && line.values.get("place") == Some(&f64::from(place))
        });
        let (_, call) = calls
            .next()
            .context("the chip's program measured no comb")?;
        functions.steps(call)
    };
    whole_rows.comb = Some(Comb {
        first: of_comb(1)?,
        following: of_comb(2)?,
        last: of_comb(FRAME)?,
    });
    for Slow {
        estimator,
        name,
        call,
    } in &run.slowest
    {
        whole_rows.slowest.push(Slowest {
            estimator: *estimator,
            name: name.clone(),
            row: functions.steps(call)?,
        });
    }
    Ok(whole_rows)
}

/// The program prints a line for each call, in the order of the calls: each line with its call.
pub fn with_calls<'a>(
    run: &'a Run,
    program: &Program,
    kind: Kind,
    function: &str,
) -> Result<Vec<(&'a Line, &'a Call)>> {
    let address = program
        .address(function)
        .with_context(|| format!("the chip's program has no function {function}"))?;
    let calls: Vec<&Call> = (run.calls.iter())
        .filter(|call| call.function == address)
        .collect();
    let lines: Vec<&Line> = lines::all(&run.lines, kind).collect();
    ensure!(
        lines.len() == calls.len(),
        "the chip's program called {function} {} times and spoke of {}",
        calls.len(),
        lines.len()
    );
    for (line, call) in lines.iter().zip(&calls) {
        let (said, counted) = (line.whole("cycles")?, call.instructions());
        if said.abs_diff(counted) > CLOCK_ROUNDS {
            bail!("{line:?} executes {counted} instructions");
        }
    }
    Ok(lines.into_iter().zip(calls).collect())
}
