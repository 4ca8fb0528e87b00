//! Gathers the bytes that come over the serial line into commands.
//!
//! Programs send whole lines ([`Input::take`]). A person types them, wants to see them, and corrects them
//! ([`Input::type_in`]).

use core::fmt::Write as _;

use heapless::Vec;

use super::command::{Command, Error, MAX_LINE, parse_in};
use crate::settings::read_number;
use crate::text::Text;
use slitrange::base::units::Units;

/// The line that is under way.
#[derive(Debug, Default)]
pub struct Input {
    line: Vec<u8, { MAX_LINE + MAX_ADDRESS }>,
    /// The sensor's address; 0 if it is alone on its line.
    address: u16,
    units: Units,
    /// The latest command was for all sensors on the line.
    is_for_all: bool,
    /// Why the rest of the line is skipped.
    skipping: Skipping,
    keys: Keys,
}

/// The most bytes of an address before a line: `@247 `.
const MAX_ADDRESS: usize = 5;

/// Whether and why the rest of a line is skipped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Skipping {
    #[default]
    Nothing,
    /// The line was too long. The error was sent when it became so.
    TooLong,
    /// Characters were lost. The error is sent at the line's end.
    Cut,
}

/// Where in the bytes of a key a terminal is: arrows and their like send an escape, a bracket, some
/// parameters, and a letter (ECMA-48, 5.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Keys {
    #[default]
    Between,
    /// After an escape.
    Escape,
    /// After the bracket.
    Sequence,
    /// After a CR, whose LF is no second line.
    Return,
}

/// What a terminal shows for a byte: at most three characters.
pub type Echo = Text<3>;

const BACKSPACE: u8 = 0x08;
const DELETE: u8 = 0x7F;
const ESCAPE: u8 = 0x1B;
/// A receiver takes a break for this byte without a stop bit.
const BREAK: u8 = 0;
/// Ctrl-C and Ctrl-U.
const CANCEL: [u8; 2] = [0x03, 0x15];

impl Input {
    /// An empty line.
    pub const fn new() -> Self {
        Self {
            line: Vec::new(),
            address: 0,
            units: Units::Millimetres,
            is_for_all: false,
            skipping: Skipping::Nothing,
            keys: Keys::Between,
        }
    }

    /// Sets the sensor's address, 0 to 247. With an address, lines for other sensors and lines without an
    /// address are ignored.
    pub const fn set_address(&mut self, address: u16) {
        self.address = address;
    }

    /// Sets the unit of lengths that name none.
    pub const fn set_units(&mut self, units: Units) {
        self.units = units;
    }

    /// Whether the latest command that was returned was for all sensors on the line, `@0 `. Nobody answers.
    pub const fn is_for_all(&self) -> bool {
        self.is_for_all
    }

    /// Whether no line is under way.
    pub fn is_empty(&self) -> bool {
        self.line.is_empty() && self.skipping == Skipping::Nothing
    }

    /// As [`Input::take`], for a person: `echo` becomes what the terminal shows. Backspace takes the last
    /// character back, Ctrl-C and Ctrl-U take the line back. Arrows and other keys without a character do
    /// nothing.
    pub fn type_in(&mut self, byte: u8, echo: &mut Echo) -> Option<Result<Command, Error>> {
        echo.clear();
        let keys = core::mem::take(&mut self.keys);
        match (keys, byte) {
            (Keys::Escape, b'[' | b'O') => self.keys = Keys::Sequence,
            // Parameters, up to the last byte of the sequence.
            (Keys::Sequence, b' '..=b'?') => self.keys = Keys::Sequence,
            (Keys::Sequence, b'@'..=b'~') => {}
            (Keys::Return, b'\n') => {}
            (_, ESCAPE) => self.keys = Keys::Escape,
            (_, BACKSPACE | DELETE) => {
                if self.line.pop().is_some() {
                    // Room for three.
                    let _ = echo.write_str("\u{8} \u{8}");
                }
            }
            (_, b'\r' | b'\n') => {
                let _ = echo.write_str("\r\n");
                let command = self.take(byte);
                if byte == b'\r' {
                    self.keys = Keys::Return;
                }
                return command;
            }
            (_, b' '..=b'~' | b'\t') => {
                let character = if byte == b'\t' { b' ' } else { byte };
                if self.skipping == Skipping::Nothing {
                    let _ = echo.write_char(char::from(character));
                }
                return self.take(character);
            }
            (_, other) if CANCEL.contains(&other) => {
                self.start_line();
                let _ = echo.write_str("\r\n");
            }
            _ => {}
        }
        None
    }

    /// Takes a byte. Returns the command, or the error, that the byte completes.
    ///
    /// A line ends with CR, LF or both. If both come, the second one ends an empty line, which is
    /// [`Command::Nothing`]. A line longer than [`MAX_LINE`] gives one error, as soon as it is too long; the
    /// rest of the line is skipped. A break before a line is ignored: it comes when a PC opens or plugs a
    /// port. A break within a line spoils the line.
    pub fn take(&mut self, byte: u8) -> Option<Result<Command, Error>> {
        if byte == BREAK && self.is_empty() {
            return None;
        }
        if matches!(byte, b'\r' | b'\n') {
            let checked = match self.skipping {
                Skipping::Nothing => Some(without_checksum(&self.line)),
                Skipping::Cut => Some(Err(Error::Cut)),
                Skipping::TooLong => None,
            };
            let command = match checked {
                Some(Ok(line)) => addressed(line, self.address).map(|(line, is_for_all)| {
                    self.is_for_all = is_for_all;
                    parse_in(self.units, line)
                }),
                // Another sensor on the line may be meant.
                Some(Err(error)) if self.address == 0 => {
                    self.is_for_all = false;
                    Some(Err(error))
                }
                _ => None,
            };
            self.start_line();
            return command;
        }
        if self.skipping != Skipping::Nothing {
            return None;
        }
        let has_address = self.line.first() == Some(&b'@');
        let room = MAX_LINE.saturating_add(if has_address { MAX_ADDRESS } else { 0 });
        if self.line.len() < room && self.line.push(byte).is_ok() {
            return None;
        }
        self.skipping = Skipping::TooLong;
        let (_, is_for_all) = addressed(&self.line, self.address)?;
        self.is_for_all = is_for_all;
        Some(Err(Error::TooLong))
    }

    /// Characters were lost. The rest of their line is refused with [`Error::Cut`]: it could be another valid
    /// command.
    pub fn lose_characters(&mut self) {
        self.start_line();
        self.is_for_all = false;
        self.skipping = Skipping::Cut;
    }

    fn start_line(&mut self) {
        self.line.clear();
        self.skipping = Skipping::Nothing;
        self.keys = Keys::Between;
    }
}

/// A line without the checksum that it may end with: `*` and the exclusive or of all characters before it,
/// two hexadecimal digits (NMEA 0183).
fn without_checksum(line: &[u8]) -> Result<&[u8], Error> {
    let Some((body, &[b'*', high, low])) = line.split_last_chunk() else {
        return Ok(line);
    };
    let digit = |byte: u8| char::from(byte).to_digit(16);
    let (Some(high), Some(low)) = (digit(high), digit(low)) else {
        return Ok(line);
    };
    let computed = body.iter().fold(0, |sum, byte| sum ^ u32::from(*byte));
    let written = high << 4 | low;
    if written == computed {
        Ok(body)
    } else {
        Err(Error::LineChecksum { written, computed })
    }
}

/// What follows the address of a line, and whether the line is for all sensors. `None` if the line is for
/// another sensor. A sensor without an address, 0, takes lines without one too.
fn addressed(line: &[u8], address: u16) -> Option<(&[u8], bool)> {
    let Some((number, rest)) = split_address(line) else {
        return (address == 0).then_some((line, false));
    };
    (number == 0 || number == address).then_some((rest, number == 0))
}

/// The address at the front of a line, `@17 `, and what follows it.
fn split_address(line: &[u8]) -> Option<(u16, &[u8])> {
    let rest = line.strip_prefix(b"@")?;
    let end = rest.iter().position(|&byte| matches!(byte, b' ' | b'\t'))?;
    let (digits, rest) = rest.split_at_checked(end)?;
    let number = read_number(core::str::from_utf8(digits).ok()?, 0, MOST_ADDRESS).ok()?;
    // The blank is not part of the line.
    Some((number, rest.get(1..)?))
}

/// The largest address: that of a Modbus station.
const MOST_ADDRESS: u32 = 247;

#[cfg(test)]
mod tests {
    use super::*;

    type Taken = std::vec::Vec<(Result<Command, Error>, bool)>;

    /// The commands that bytes bring to a sensor with an address, and whether they are for all.
    fn taken(address: u16, bytes: impl AsRef<[u8]>) -> Taken {
        let mut input = Input::new();
        input.set_address(address);
        let mut commands = std::vec![];
        for &byte in bytes.as_ref() {
            if let Some(command) = input.take(byte) {
                commands.push((command, input.is_for_all()));
            }
        }
        commands
    }

    /// The commands that are something, of a sensor without an address.
    fn all(bytes: &[u8]) -> std::vec::Vec<Result<Command, Error>> {
        let commands = taken(0, bytes).into_iter().map(|(command, _)| command);
        commands.filter(|it| *it != Ok(Command::Nothing)).collect()
    }

    #[test]
    fn any_line_end_will_do_and_a_break_spoils_a_line_only_within() {
        let two = [Ok(Command::Help), Ok(Command::Info)];
        let spoilt = [Err(Error::NotText), Ok(Command::Info)];
        for (bytes, expected) in [
            (&b"help\rinfo\r"[..], two),
            (b"help\ninfo\n", two),
            (b"help\r\ninfo\r\n\r\n", two),
            (b"\0\0help\r\n\0\r\n\0info\r\n", two),
            (b"he\0lp\r\n\0info\r\n", spoilt),
            (b"help\0\r\ninfo\r\n", spoilt),
        ] {
            assert_eq!(all(bytes), expected, "{}", bytes.escape_ascii());
        }
        assert_eq!(all(b"help\r\ninf"), [Ok(Command::Help)]);
    }

    #[test]
    fn a_line_of_which_characters_were_lost_is_refused() {
        for (before, after, expected) in [
            ("rows 1", "6\r", &[Error::Cut][..]),
            ("", "\r\n", &[Error::Cut]),
            ("", "help\r", &[Error::Cut]),
            ("", &"x".repeat(2 * MAX_LINE), &[]),
        ] {
            for address in [0, 5] {
                let mut input = Input::new();
                input.set_address(address);
                assert!(before.bytes().all(|byte| input.take(byte).is_none()));
                input.lose_characters();
                assert!(!input.is_empty());
                let mut answers: std::vec::Vec<_> =
                    after.bytes().filter_map(|byte| input.take(byte)).collect();
                answers.retain(|it| *it != Ok(Command::Nothing));
                let expected: &[_] = if address == 0 { expected } else { &[] };
                assert!(
                    answers
                        .iter()
                        .map(|it| it.as_ref().err())
                        .eq(expected.iter().map(Some)),
                    "{after:?}"
                );
            }
        }
    }

    #[test]
    fn a_line_with_a_checksum_is_taken_only_if_it_is_right() {
        let sum = |line: &str| line.bytes().fold(0, |sum, byte| sum ^ byte);
        for line in ["help", "@5 help", "@0 help"] {
            let right = format!("{line}*{:02x}\r", sum(line));
            let address = if line == "help" { 0 } else { 5 };
            let answer = [(Ok(Command::Help), line == "@0 help")];
            assert_eq!(taken(address, &right), answer);
            // Each bit of the line wrong. A digit may be a capital, and `*` a line feed, which ends the line.
            for bit in 0..8 * (right.len() - 1) {
                let mut wrong = right.clone().into_bytes();
                wrong[bit / 8] ^= 1 << (bit % 8);
                let is_right = wrong[line.len()] == b'\n'
                    || bit / 8 > line.len() && wrong.eq_ignore_ascii_case(right.as_bytes());
                let is_taken = taken(address, &wrong).iter().any(|(it, _)| it.is_ok());
                assert_eq!(is_taken, is_right, "{}", wrong.escape_ascii());
            }
        }
        let error = Error::LineChecksum {
            written: 0x1A,
            computed: 0x11,
        };
        let after_one_for_all = [(Ok(Command::Help), true), (Err(error), false)];
        assert_eq!(taken(0, b"@0 help\rhelp*1a\r"), after_one_for_all);
        assert_eq!(
            error.to_string(),
            "E7 checksum 1a, of what came 11: send it again"
        );
    }

    #[test]
    fn a_sensor_with_an_address_takes_its_own_lines_and_those_for_all() {
        let mine = [(Ok(Command::Help), false)];
        let all = [(Ok(Command::Help), true)];
        for address in [1, 17, 247] {
            assert_eq!(taken(address, format!("@{address} help\r")), mine);
            assert_eq!(taken(address, format!("@0{address}\thelp\n")), mine);
            assert_eq!(taken(address, b"@0 help\r"), all);
            // For others, for nobody, and no commands.
            for line in [
                "help",
                "",
                "@",
                "@18 help",
                "@248 help",
                "@65553 help",
                "@x help",
                "@ help",
                "@#help",
                " @# help",
                "@#",
            ] {
                let line = line.replace('#', &address.to_string());
                assert_eq!(taken(address, format!("{line}\r\n")), [], "{line}");
            }
            // Lines that are too long, the last one by a byte.
            let unknown = format!("@{address} {}", "x".repeat(MAX_LINE + 6));
            let too_long = [(Err(Error::TooLong), false)];
            assert_eq!(taken(address, format!("{unknown}\r")), too_long);
            assert_eq!(taken(address, [b'x'; 300]), []);
            let longest = format!("@{address} {}help\r", " ".repeat(MAX_LINE - 4));
            assert_eq!(taken(address, longest), mine);
        }
        assert_eq!(taken(0, b"@0 help\r"), all);
        assert_eq!(taken(0, b"help\r"), mine);
        assert_eq!(taken(0, b"@5 help\r"), []);
        assert_eq!(taken(0, b"@help\r").len(), 1, "an error");
    }

    /// What a person typed, what the terminal showed, and the commands.
    fn typed(bytes: &[u8]) -> (std::string::String, std::vec::Vec<Result<Command, Error>>) {
        let (mut input, mut echo) = (Input::new(), Echo::default());
        let (mut shown, mut commands) = (std::string::String::new(), std::vec![]);
        for &byte in bytes {
            commands.extend(input.type_in(byte, &mut echo));
            shown += echo.as_str();
        }
        (shown, commands)
    }

    #[test]
    fn what_a_person_types_is_shown_and_can_be_corrected() {
        let help = std::vec![Ok(Command::Help)];
        for (bytes, shown) in [
            (&b"help\r"[..], "help\r\n"),
            (b"help\r\n", "help\r\n"),
            (b"help\n", "help\r\n"),
            (b"hex\x7flp\r", "hex\u{8} \u{8}lp\r\n"),
            (b"x\x08\x08\x08help\r", "x\u{8} \u{8}help\r\n"),
            // Arrows, Home, Delete, F5, and a lone escape.
            (b"he\x1b[A\x1b[1;5Dl\x1b[3~\x1bOHp\x1b[15~\r", "help\r\n"),
            (b"\x1bhelp\r", "help\r\n"),
            (b"save\x03help\r", "save\r\nhelp\r\n"),
            (b"save\x15help\r", "save\r\nhelp\r\n"),
            (b"\x01\x02\xffhelp\0\r", "help\r\n"),
        ] {
            let (echo, commands) = typed(bytes);
            let found = (echo.as_str(), &commands);
            assert_eq!(found, (shown, &help), "{}", bytes.escape_ascii());
        }
        assert_eq!(typed(b"rows\t64\r").0, "rows 64\r\n");
        assert_eq!(typed(b"\r\n\r\n").1, [Ok(Command::Nothing); 2]);
    }

    #[test]
    fn a_long_typed_line_is_one_error_and_can_be_taken_back() {
        let line = format!("{}\x03help\r", "x".repeat(MAX_LINE + 9));
        let (shown, commands) = typed(line.as_bytes());
        assert_eq!(commands, [Err(Error::TooLong), Ok(Command::Help)]);
        assert_eq!(shown.matches('x').count(), MAX_LINE + 1);
    }

    #[test]
    fn a_long_line_is_one_error_and_the_next_line_is_read() {
        let lines = format!("{}\nhelp\n", "x".repeat(10 * MAX_LINE));
        let expected = [Err(Error::TooLong), Ok(Command::Help)];
        assert_eq!(all(lines.as_bytes()), expected);
        let longest = format!("{}help\n", " ".repeat(MAX_LINE - 4));
        assert_eq!(all(longest.as_bytes()), [Ok(Command::Help)]);
    }
}
