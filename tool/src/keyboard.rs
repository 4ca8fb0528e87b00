//! What a person types: lines, and Ctrl-C.

use std::io::{self, BufRead, Cursor, Read};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Whether somebody pressed Ctrl-C. Empty while Ctrl-C ends the program.
static INTERRUPTED: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// What a program that Ctrl-C ends gives to the shell.
const ENDED_BY_INTERRUPT: i32 = 130;
/// How often a keyboard that waits for a line looks for Ctrl-C.
const LOOK: Duration = Duration::from_millis(50);

/// Whether somebody pressed Ctrl-C since the first call, or another program asked this one to end (SIGTERM).
/// The second time, the program ends at once.
pub fn watch_interrupts() -> bool {
    let pressed = INTERRUPTED.get_or_init(|| {
        let pressed = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // In this order: the first press must not end the program. Without them, the first press does.
            let ending = Arc::clone(&pressed);
            _ = flag::register_conditional_shutdown(signal, ENDED_BY_INTERRUPT, ending)
                .and_then(|_| flag::register(signal, Arc::clone(&pressed)));
        }
        pressed
    });
    pressed.load(Ordering::Relaxed)
}

/// Standard input. Once [`watch_interrupts`] was called, Ctrl-C is the input's end: the system goes on
/// waiting for a line after Ctrl-C, so a thread waits in place of the program.
#[derive(Debug, Default)]
pub struct Keyboard {
    lines: Option<Receiver<io::Result<Vec<u8>>>>,
    line: Cursor<Vec<u8>>,
}

impl BufRead for Keyboard {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        let goes_on = |it: &Arc<AtomicBool>| !it.load(Ordering::Relaxed);
        while self.line.fill_buf()?.is_empty() {
            match self.lines.get_or_insert_with(read_lines).recv_timeout(LOOK) {
                Ok(line) => self.line = Cursor::new(line?),
                Err(RecvTimeoutError::Timeout) if INTERRUPTED.get().is_none_or(goes_on) => {}
                Err(_) => break,
            }
        }
        self.line.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        self.line.consume(count);
    }
}

impl Read for Keyboard {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(bytes)?;
        self.consume(count);
        Ok(count)
    }
}

fn read_lines() -> Receiver<io::Result<Vec<u8>>> {
    let (sender, lines) = channel();
    std::thread::spawn(move || {
        loop {
            let mut line = Vec::new();
            let read = io::stdin().lock().read_until(b'\n', &mut line);
            let is_end = matches!(read, Ok(0));
            if is_end || sender.send(read.map(|_| line)).is_err() {
                return;
            }
        }
    });
    lines
}
