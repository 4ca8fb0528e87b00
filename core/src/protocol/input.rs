//! Gathers the bytes that come over the serial line into commands.

use heapless::Vec;

use super::command::{Command, Error, MAX_LINE, parse};

/// The line that is under way.
#[derive(Debug, Default)]
pub struct Input {
    line: Vec<u8, MAX_LINE>,
    /// The line was too long: the rest of it is skipped.
    skipping: bool,
}

impl Input {
    /// An empty line.
    pub const fn new() -> Self {
        Self {
            line: Vec::new(),
            skipping: false,
        }
    }

    /// Takes a byte. Returns the command, or the error, that the byte completes.
    ///
    /// A line ends with CR, LF or both. If both come, the second one ends an empty line, which is
    /// [`Command::Nothing`]. A line longer than [`MAX_LINE`] gives one error, as soon as it is too long; the
    /// rest of the line is skipped.
    pub fn take(&mut self, byte: u8) -> Option<Result<Command, Error>> {
        if matches!(byte, b'\r' | b'\n') {
            let command = (!self.skipping).then(|| parse(&self.line));
            *self = Self::new();
            return command;
        }
        if !self.skipping && self.line.push(byte).is_err() {
            self.skipping = true;
            return Some(Err(Error::TooLong));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(bytes: &[u8]) -> std::vec::Vec<Result<Command, Error>> {
        let mut input = Input::new();
        bytes
            .iter()
            .filter_map(|&byte| input.take(byte))
            .filter(|command| *command != Ok(Command::Nothing))
            .collect()
    }

    #[test]
    fn any_line_end_will_do() {
        let two = [Ok(Command::Help), Ok(Command::Info)];
        assert_eq!(all(b"help\rinfo\r"), two);
        assert_eq!(all(b"help\ninfo\n"), two);
        assert_eq!(all(b"help\r\ninfo\r\n\r\n"), two);
        assert_eq!(all(b"help\r\ninf"), [Ok(Command::Help)]);
    }

    #[test]
    fn a_long_line_is_one_error_and_the_next_line_is_read() {
        let mut bytes = std::vec![b'x'; 10 * MAX_LINE];
        bytes.extend_from_slice(b"\nhelp\n");
        assert_eq!(all(&bytes), [Err(Error::TooLong), Ok(Command::Help)]);
        let mut longest = std::vec![b' '; MAX_LINE - 4];
        longest.extend_from_slice(b"help\n");
        assert_eq!(all(&longest), [Ok(Command::Help)]);
    }
}
