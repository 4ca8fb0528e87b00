//! The serial line as a pseudo-terminal: `tio`, `screen` or a program talks to the emulated board as to a
//! real one.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use nix::errno::Errno;
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::pty::openpty;
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use nix::unistd::ttyname;

use crate::run::VirtualBoard;

/// How long the board runs before the terminal is read again.
const SLICE: Duration = Duration::from_millis(5);

/// How far the board may fall behind the wall clock before it stops trying to catch up.
const PATIENCE: Duration = Duration::from_millis(100);

/// How often the board's speed is looked at. Over this time, [`PATIENCE`] is a twentieth.
const SPEED_PERIOD: Duration = Duration::from_secs(2);

/// How long the board waits for a program that reads too slowly, in milliseconds. The system keeps 4 KiB for
/// the program, which last 44 ms at the highest rate. On a busy PC the program may wait for longer than that.
const WAIT_FOR_READER_MS: u16 = 2000;

/// A board that is slower than this share of wall time is reported.
const KEEPS_UP: f64 = 0.95;

/// A pseudo-terminal that stands for the board's serial line. It stays open over a power cycle.
#[derive(Debug)]
pub struct PseudoTerminal {
    board_side: File,
    /// The bytes that a program has sent and that the board has not yet received.
    received: Vec<u8>,
    /// Whether there was room for what the board sent last. Without it, no program reads.
    is_read: bool,
    /// Stays open, because reading fails if no program has the terminal open.
    _program_side: OwnedFd,
    /// The path that a program opens.
    pub path: PathBuf,
}

impl PseudoTerminal {
    /// Opens a pseudo-terminal.
    ///
    /// # Errors
    /// The system gives no pseudo-terminal.
    pub fn open() -> Result<Self> {
        let ends = openpty(None, None).context("opening a pseudo-terminal")?;
        let mut settings =
            tcgetattr(&ends.slave).context("reading the pseudo-terminal's settings")?;
        // Raw: the firmware's text is not echoed to it, and line ends stay as they are.
        cfmakeraw(&mut settings);
        tcsetattr(&ends.slave, SetArg::TCSANOW, &settings)
            .context("making the pseudo-terminal raw")?;
        fcntl(&ends.master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))
            .context("making the pseudo-terminal non-blocking")?;
        let path = ttyname(&ends.slave).context("asking for the pseudo-terminal's path")?;
        Ok(Self {
            board_side: File::from(ends.master),
            received: vec![],
            is_read: false,
            _program_side: ends.slave,
            path,
        })
    }

    /// Runs `board` and passes bytes both ways until `goes_on` returns false. Bytes that no program reads are
    /// lost, as on a real line. For a program that reads, but too slowly, the board waits.
    ///
    /// `goes_on` is called every 5 ms: before the board receives the program's bytes, and before the program
    /// receives the board's bytes. So a command finds all that was done before it was sent, and `goes_on`
    /// sees what the board did before the program reads about it.
    ///
    /// The board runs as fast as the wall clock. If the PC or the program is too slow for that, a message on
    /// standard error says every 2 s at what share of wall time the board runs.
    ///
    /// # Errors
    /// The pseudo-terminal failed, or an error of [`VirtualBoard::run_for`].
    pub fn serve(
        &mut self,
        board: &mut VirtualBoard,
        mut goes_on: impl FnMut(&mut VirtualBoard) -> bool,
    ) -> Result<()> {
        let mut due = Instant::now();
        let (mut since, mut board_since) = (due, board.now());
        loop {
            self.receive()?;
            let goes_on = goes_on(board);
            self.say(board)?;
            if !goes_on {
                return Ok(());
            }
            board.send_at(board.now(), &self.received);
            self.received.clear();
            board.run_for(SLICE)?;
            due += SLICE;
            let now = Instant::now();
            if now > due + PATIENCE {
                due = now;
            }
            let wall = now - since;
            if wall >= SPEED_PERIOD {
                let ran = (board.now() - board_since) as f64 * 1e-9;
                let share = ran / wall.as_secs_f64();
                if share < KEEPS_UP {
                    eprintln!(
                        "the board runs at {share:.2} of wall time: this PC is too slow, or the program \
                         that reads is"
                    );
                }
                (since, board_since) = (now, board.now());
            }
            std::thread::sleep(due.saturating_duration_since(now));
        }
    }

    fn receive(&mut self) -> Result<()> {
        let mut bytes = [0; 256];
        match self.board_side.read(&mut bytes) {
            Ok(count) => self.received.extend(&bytes[..count]),
            Err(error) if is_idle(error.kind()) => {}
            Err(error) => return Err(error).context("reading the pseudo-terminal"),
        }
        Ok(())
    }

    /// Passes the board's bytes to the program.
    fn say(&mut self, board: &mut VirtualBoard) -> Result<()> {
        let said = board.take_bytes().into_iter().map(|(_, byte)| byte);
        let said: Vec<u8> = said.collect();
        // The lines are not needed, and would pile up.
        board.take_lines();
        self.pass(&said, WAIT_FOR_READER_MS.into())
    }

    /// Passes bytes to the program, and waits for so long for one that has read until now.
    fn pass(&mut self, mut bytes: &[u8], wait: PollTimeout) -> Result<()> {
        while !bytes.is_empty() {
            match self.board_side.write(bytes) {
                Ok(written) => {
                    bytes = &bytes[written..];
                    self.is_read = true;
                }
                Err(error) if !is_idle(error.kind()) => {
                    return Err(error).context("writing to the pseudo-terminal");
                }
                Err(_) if self.is_read => {
                    let mut board_side = [PollFd::new(self.board_side.as_fd(), PollFlags::POLLOUT)];
                    match poll(&mut board_side, wait) {
                        // A signal ended the wait.
                        Err(Errno::EINTR) => {}
                        ready => {
                            let ready = ready.context("waiting for the pseudo-terminal")?;
                            self.is_read = ready > 0;
                        }
                    }
                }
                Err(_) => break,
            }
        }
        Ok(())
    }
}

/// Whether the error means: nothing to read, or no program that reads.
fn is_idle(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 64 KiB are sixteen times what the system keeps. While the program reads, the wait never
    /// ends, so no busy PC can fail this.
    #[test]
    fn a_slow_program_gets_all_bytes_and_without_one_they_are_lost() -> Result<()> {
        let bytes: Vec<u8> = (0..=255).cycle().take(1 << 16).collect();
        let mut terminal = PseudoTerminal::open()?;
        let mut program = File::open(&terminal.path)?;
        std::thread::scope(|scope| {
            let sends = scope.spawn(|| terminal.pass(&bytes, PollTimeout::NONE));
            let mut came = vec![0; bytes.len()];
            program.read_exact(&mut came)?;
            assert!(came == bytes);
            sends.join().expect("no panic")
        })?;
        // With a wait, this could wait for ever: the system may make room after it said that there is none.
        terminal.pass(&bytes, PollTimeout::ZERO)?;
        assert!(!terminal.is_read);
        Ok(())
    }
}
