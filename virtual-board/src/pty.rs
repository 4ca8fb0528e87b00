//! The serial line as a pseudo-terminal: `tio`, `screen` or a program talks to the emulated board as to a real one.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::pty::openpty;
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::unistd::ttyname;

use crate::VirtualBoard;

/// How long the board runs between two looks at the terminal.
const SLICE: Duration = Duration::from_millis(5);

/// How far the board may fall behind the wall clock before it stops trying to catch up.
const PATIENCE: Duration = Duration::from_millis(100);

/// How fast the board runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// At the wall clock's, or as fast as it can if that is slower.
    WallClock,
    /// As fast as it can.
    Unbound,
}

/// A pseudo-terminal that stands for the board's serial line, over a power cycle too: what is plugged in stays plugged in.
#[derive(Debug)]
pub struct PseudoTerminal {
    board_side: File,
    /// Stays open, or reading would fail whenever no program has the terminal open.
    _program_side: OwnedFd,
    path: PathBuf,
}

impl PseudoTerminal {
    /// Opens one.
    ///
    /// # Errors
    ///
    /// There is none to be had.
    pub fn open() -> Result<Self> {
        let ends = openpty(None, None).context("opening a pseudo-terminal")?;
        let mut settings =
            tcgetattr(&ends.slave).context("reading the pseudo-terminal's settings")?;
        // Raw: no echo of what the firmware says back to it, and line ends as they are.
        cfmakeraw(&mut settings);
        tcsetattr(&ends.slave, SetArg::TCSANOW, &settings)
            .context("making the pseudo-terminal raw")?;
        fcntl(&ends.master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))
            .context("making the pseudo-terminal non-blocking")?;
        let path = ttyname(&ends.slave).context("asking for the pseudo-terminal's path")?;
        Ok(Self {
            board_side: File::from(ends.master),
            _program_side: ends.slave,
            path,
        })
    }

    /// What a program opens.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Runs `board` and passes bytes both ways for as long as `goes_on` says so. What nobody reads is lost, as on a real line.
    ///
    /// # Errors
    ///
    /// The pseudo-terminal failed, or as [`VirtualBoard::run_for`].
    pub fn serve(
        &mut self,
        board: &mut VirtualBoard,
        pace: Pace,
        mut goes_on: impl FnMut(&mut VirtualBoard) -> bool,
    ) -> Result<()> {
        let mut due = Instant::now();
        while goes_on(board) {
            self.pass_on(board)?;
            if pace == Pace::WallClock {
                due += SLICE;
                let now = Instant::now();
                if now > due + PATIENCE {
                    due = now;
                }
                std::thread::sleep(due.saturating_duration_since(now));
            }
        }
        Ok(())
    }

    /// What a program has sent goes to the board, which runs for a slice; what it says goes back.
    fn pass_on(&mut self, board: &mut VirtualBoard) -> Result<()> {
        let mut received = [0; 256];
        match self.board_side.read(&mut received) {
            Ok(count) => board.send_at(board.now(), &received[..count]),
            Err(error) if is_idle(error.kind()) => {}
            Err(error) => return Err(error).context("reading the pseudo-terminal"),
        }
        board.run_for(SLICE)?;
        let sent: Vec<u8> = board
            .take_bytes()
            .into_iter()
            .map(|(_, byte)| byte)
            .collect();
        // The lines would pile up.
        board.take_lines();
        match self.board_side.write(&sent) {
            Ok(_) => Ok(()),
            Err(error) if is_idle(error.kind()) => Ok(()),
            Err(error) => Err(error).context("writing to the pseudo-terminal"),
        }
    }
}

/// Nothing to read, or nobody who reads.
fn is_idle(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::Interrupted)
}
