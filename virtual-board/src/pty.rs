//! The serial line as a pseudo-terminal: `tio`, `screen` or a program talks to the emulated board as to a real one.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
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

/// Opens a pseudo-terminal, prints its path, and runs `board` at the wall clock's pace (or as fast as it can, if that is
/// slower), passing bytes both ways, until the process is interrupted. What nobody reads is lost, as on a real line.
///
/// `meanwhile` is called every 5 ms: before the bytes that have been read are passed on to the board, and before those that the board
/// has sent are written.
///
/// # Errors
///
/// There is no pseudo-terminal to be had, or as `meanwhile` or [`VirtualBoard::run_for`].
pub fn serve(board: &mut VirtualBoard, meanwhile: impl FnMut() -> Result<()>) -> Result<()> {
    let ends = openpty(None, None).context("opening a pseudo-terminal")?;
    let mut settings = tcgetattr(&ends.slave).context("reading the pseudo-terminal's settings")?;
    // Raw: no echo of what the firmware says back to it, and line ends as they are.
    cfmakeraw(&mut settings);
    tcsetattr(&ends.slave, SetArg::TCSANOW, &settings).context("making the pseudo-terminal raw")?;
    fcntl(&ends.master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))
        .context("making the pseudo-terminal non-blocking")?;
    let path = ttyname(&ends.slave).context("asking for the pseudo-terminal's path")?;
    println!("serial line: {}", path.display());
    // `ends.slave` stays open, or reading would fail whenever no program has the terminal open.
    forward(board, &mut File::from(ends.master), meanwhile)
}

/// Runs `board` and passes bytes between it and `terminal`.
fn forward(
    board: &mut VirtualBoard,
    terminal: &mut File,
    mut meanwhile: impl FnMut() -> Result<()>,
) -> Result<()> {
    let mut due = Instant::now();
    let mut received = [0; 256];
    let mut sent = vec![];
    loop {
        let count = match terminal.read(&mut received) {
            Ok(count) => count,
            Err(error) if is_idle(error.kind()) => 0,
            Err(error) => return Err(error).context("reading the pseudo-terminal"),
        };
        // In between: a command finds what was done before it was sent, and what the board says it has done is done.
        meanwhile()?;
        match terminal.write(&sent) {
            Ok(_) => {}
            Err(error) if is_idle(error.kind()) => {}
            Err(error) => return Err(error).context("writing to the pseudo-terminal"),
        }
        board.send_at(board.now(), &received[..count]);
        board.run_for(SLICE)?;
        sent = board
            .take_bytes()
            .into_iter()
            .map(|(_, byte)| byte)
            .collect();
        // The lines would pile up.
        board.take_lines();
        due += SLICE;
        let now = Instant::now();
        if now > due + PATIENCE {
            due = now;
        }
        std::thread::sleep(due.saturating_duration_since(now));
    }
}

/// Nothing to read, or nobody who reads.
fn is_idle(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::Interrupted)
}
