//! Running the program on the emulated board.

use std::time::Duration;

use anyhow::{Result, bail};
use virtual_board::trace::Call;
use virtual_board::{Firmware, PIXELS, VirtualBoard};

use super::lines::Line;
use super::program::Program;

/// The program is done in less than half of this virtual time.
const AT_MOST: Duration = Duration::from_secs(60);

/// What came of a run.
pub struct Run {
    /// The program's ELF file.
    pub firmware: Firmware,
    /// What it printed.
    pub lines: Vec<Line>,
    /// Every call of a method, of one iteration of `gauss-newton`, and of a calibration: the instructions
    /// that were executed.
    pub calls: Vec<Call>,
}

impl Run {
    /// Builds the package's program and runs it to its end.
    pub fn of(package: &str) -> Result<Self> {
        let firmware = Firmware::build_package(package)?;
        let program = Program::of(&firmware)?;
        let mut board = VirtualBoard::power_on(&firmware, Box::new(|_| vec![0.0; PIXELS]))?;
        for function in program.traced() {
            board.trace_calls_of(function);
        }
        let (mut lines, mut calls) = (Vec::new(), Vec::new());
        loop {
            // The program waits long enough after each line.
            board.run_for(Duration::from_millis(10))?;
            calls.extend(board.take_calls());
            for message in board.take_log() {
                if message.text == "end" {
                    board.finish()?;
                    return Ok(Self {
                        firmware,
                        lines,
                        calls,
                    });
                }
                if message.level.is_some() {
                    bail!("the chip's program ended with: {message}");
                }
                lines.push(Line::parse(&message.text)?);
            }
            if u128::from(board.now()) > AT_MOST.as_nanos() {
                bail!("the chip's program did not end within {AT_MOST:?}");
            }
        }
    }
}
