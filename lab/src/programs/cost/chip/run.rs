//! Running the program on the emulated board.

use cost_on_chip::whole_rows::Order;
use virtual_board::PIXELS;
use virtual_board::trace::Call;

use super::lines::Line;
use super::program::Program;
use super::steps;
use crate::prelude::*;
use crate::slowest;

/// The program is done in less than half of this virtual time.
const AT_MOST: Duration = Duration::from_secs(60);

pub struct Run {
    pub firmware: Firmware,
    pub lines: Vec<Line>,
    /// Every call of a method, of a calibration, and of a whole row: the instructions that were executed.
    pub calls: Vec<Call>,
    pub slowest: Vec<Slow>,
}

pub struct Slow {
    pub estimator: Estimator,
    pub call: Call,
}

impl Run {
    pub fn of(package: &str) -> Result<Self> {
        let firmware = Firmware::build_package(package)?;
        let program = Program::of(&firmware)?;
        let mut board = VirtualBoard::power_on(&firmware, Box::new(|_| vec![0.0; PIXELS]))?;
        for function in program.traced() {
            board.trace_calls_of(function);
        }
        let (lines, calls) = run_to_the_end(&mut board)?;
        for function in program.traced() {
            board.stop_tracing(function);
        }
        let slowest = slowest(&mut board, &firmware)?;
        board.finish()?;
        Ok(Self {
            firmware,
            lines,
            calls,
            slowest,
        })
    }
}

/// Builds the package's program, runs it without a trace, and gives what it printed. A trace takes a minute.
#[cfg(test)]
pub fn lines_of(package: &str) -> Result<Vec<Line>> {
    let firmware = Firmware::build_package(package)?;
    let mut board = VirtualBoard::power_on(&firmware, Box::new(|_| vec![0.0; PIXELS]))?;
    let (lines, _) = run_to_the_end(&mut board)?;
    board.finish()?;
    Ok(lines)
}

/// Runs the program to its end, and gives what it printed and the calls of the traced functions.
fn run_to_the_end(board: &mut VirtualBoard) -> Result<(Vec<Line>, Vec<Call>)> {
    let (mut lines, mut calls) = (Vec::new(), Vec::new());
    loop {
        // The program waits long enough after each line.
        board.run_for(Duration::from_millis(10))?;
        calls.extend(board.take_calls());
        for message in board.take_log() {
            if message.text == "end" {
                return Ok((lines, calls));
            }
            if message.level.is_some() {
                bail!("the chip's program ended with: {message:?}");
            }
            lines.push(Line::parse(&message.text)?);
        }
        if u128::from(board.now()) > AT_MOST.as_nanos() {
            bail!("the chip's program did not end within {AT_MOST:?}");
        }
    }
}

/// The slowest row of each estimator that `cargo slowest` found. The program waits for rows.
fn slowest(board: &mut VirtualBoard, firmware: &Firmware) -> Result<Vec<Slow>> {
    let function = firmware.address_of(steps::ROW)?;
    let slowest_of = |estimator| {
        let (before, row) = slowest::slowest_pair(estimator).context("no slow row is known")?;
        if let Some(before) = &before {
            put(board, firmware, estimator, before, true)?;
        }
        board.trace_calls_of(function);
        put(board, firmware, estimator, &row, before.is_none())?;
        board.stop_tracing(function);
        let call = board.take_calls().pop();
        Ok(Slow {
            estimator,
            call: call.context("the slowest row was not traced")?,
        })
    };
    Estimator::ALL.into_iter().map(slowest_of).collect()
}

/// Gives the program that waits a row, and waits until it has measured the row.
fn put(
    board: &mut VirtualBoard,
    firmware: &Firmware,
    estimator: Estimator,
    row: &[u16],
    is_first: bool,
) -> Result<()> {
    let asked = firmware.address_of("ASKED")?;
    let halves = row.chunks(2).map(|two| two.iter().rev());
    let words = halves.map(|two| two.fold(0, |word, &half| word << 16 | u32::from(half)));
    board.write_words(firmware.address_of("ROW")?, words.collect())?;
    let order = Order {
        estimator,
        is_first,
    };
    board.write_words(asked, vec![order.to_word()])?;
    let asked_at = board.now();
    while board.read_word(asked)? != 0 {
        board.run_for(Duration::from_micros(250))?;
        if u128::from(board.now() - asked_at) > AT_MOST.as_nanos() {
            bail!("the chip's program did not measure a row within {AT_MOST:?}");
        }
    }
    Ok(())
}
