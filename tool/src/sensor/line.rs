//! The serial line as lines: a command goes out, and its answer is told from what the sensor says on its own.
//!
//! Answers come in the order of the commands; lines of the stream may come in between. Noise can make a line
//! unreadable or lose it, so a command without an answer is asked again. Each command that is asked here may
//! come twice without harm.

use std::fmt;
use std::io;
use std::time::Duration;

use slitrange_device::protocol::command::{Command, parse};
use slitrange_device::protocol::modbus;
use slitrange_device::settings::serial_line::{Baud, Bits};
use slitrange_device::settings::{Setting, Value};

use crate::pc::{Pc, Port};

/// How often a command is said before nobody answers.
pub const TRIES: usize = 4;

/// How often a command is said to a sensor that answers `stream` in between. Where one line in ten is spoilt,
/// a command or its answer is in one of five tries, and 1 command in 20,000 has no answer.
const SAID: usize = 6;

/// The longest line that is kept: three times as long as any that a sensor sends. Beyond it is noise. A
/// comb's line of slits has up to 261 bytes.
const LONGEST: usize = 800;

// Waits are many times what a board takes: some 0.1 s for the longest answer, 0.4 s for a frame of 64 rows, 1
// s for a sector of flash that is erased. An emulated board can be slower than the clock on the wall.

/// How long to wait for the answer to a command.
pub const ANSWER: Duration = Duration::from_secs(2);

/// How long to wait at a port where there may be no sensor.
const GLANCE: Duration = Duration::from_secs(1);

/// How long to wait for a frame and the answer that says what it gave.
pub const FRAME: Duration = Duration::from_secs(5);

/// How long to wait for the flash to be written.
pub const SAVE: Duration = Duration::from_secs(20);

/// How long a rate is kept for a command that a sensor may take at that rate: ten times what the command
/// takes at 115200 baud.
const WAKE: Duration = Duration::from_millis(50);

/// How long to wait for the answer of a sensor that shares its line: it comes within 10 ms.
const SHARING: Duration = Duration::from_millis(20);

/// How long to wait for a sensor to come back that does not answer any more.
pub const RECONNECT: Duration = Duration::from_secs(20);

/// A sensor's serial line, held for this program alone. Whatever is asked fails if nobody answers, if the
/// answer is an error, or if the port stops working.
pub struct Line<'a> {
    pc: &'a dyn Pc,
    port: Box<dyn Port + 'a>,
    name: String,
    /// What came and is no whole line yet.
    received: Vec<u8>,
}

/// Why a command has no answer.
#[derive(Debug)]
pub enum LineError {
    /// The port of this name cannot be opened, as the system says.
    Port(String, serialport::Error),
    /// No answer came, asked repeatedly.
    Silent {
        /// The port's name.
        name: String,
        /// What was asked.
        command: String,
        /// The last line that came instead.
        heard: Option<String>,
    },
    /// The sensor answered with an error.
    Refused {
        /// What was asked.
        command: String,
        /// The answer.
        answer: String,
    },
    /// The sensor started anew, and has forgotten what was set. It said this.
    Restarted(String),
    /// The port of this name stopped working, as the system says.
    Gone(String, io::Error),
}

impl LineError {
    /// Whether the sensor may be there again, if it is given time.
    pub fn may_pass(&self) -> bool {
        !matches!(self, Self::Refused { .. })
    }
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(name, error) => cannot_open(f, name, error),
            Self::Silent {
                name,
                command,
                heard,
            } => match heard {
                None => write!(
                    f,
                    "no sensor answers `{command}` at {name}: check that this is the sensor's port and that \
                     the sensor has power"
                ),
                Some(line) => write!(
                    f,
                    "`{command}` has no answer at {name}, where `{}` came last: check that this is the \
                     sensor's port, and that its firmware knows that command (`info`, `help`)",
                    line.escape_debug()
                ),
            },
            Self::Refused { command, answer } => {
                write!(f, "the sensor answers `{command}` with `{answer}`")
            }
            Self::Restarted(banner) => write!(f, "the sensor started anew: `{banner}`"),
            Self::Gone(name, error) => {
                write!(f, "{name} stopped working ({error}): check the cable")
            }
        }
    }
}

impl std::error::Error for LineError {}

fn cannot_open(f: &mut fmt::Formatter<'_>, name: &str, error: &serialport::Error) -> fmt::Result {
    use serialport::ErrorKind::{Io, NoDevice};
    match error.kind() {
        _ if is_in_use(error) => {
            write!(f, "{name} is in use: end the program that has it open")
        }
        NoDevice | Io(io::ErrorKind::NotFound) => {
            write!(f, "there is no serial port {name}")?;
            let ports = serialport::available_ports().unwrap_or_default();
            if ports.is_empty() {
                return f.write_str(", nor any other: check the cable");
            }
            f.write_str("; there is")?;
            ports
                .iter()
                .try_for_each(|port| write!(f, " {}", port.port_name))
        }
        Io(io::ErrorKind::PermissionDenied) => write!(
            f,
            "{name} may not be opened: on Linux, become a member of the group that owns it (`ls -l {name}`), \
             often dialout"
        ),
        _ => write!(f, "{name} cannot be opened as a serial port: {error}"),
    }
}

impl<'a> Line<'a> {
    /// Opens a port, unless another program has it open, and forgets what came before.
    pub fn open(pc: &'a dyn Pc, name: &str) -> Result<Self, LineError> {
        // A program that was killed while it started another leaves the port to that one for a moment.
        let until = pc.now() + ANSWER;
        let port = loop {
            match pc.open(name) {
                Err(error) if is_in_use(&error) && pc.now() < until => {
                    pc.sleep(Duration::from_millis(10));
                }
                opened => break opened,
            }
        };
        let name = name.to_owned();
        match port {
            Err(error) => Err(LineError::Port(name, error)),
            Ok(port) => Ok(Self {
                pc,
                port,
                name,
                received: Vec::new(),
            }),
        }
    }

    /// The PC that the port belongs to.
    pub fn pc(&self) -> &'a dyn Pc {
        self.pc
    }

    /// The port's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Says a command until `answer` makes something of the lines that came since.
    pub fn ask<T>(
        &mut self,
        command: &str,
        wait: Duration,
        answer: impl Fn(&[String]) -> Option<T>,
    ) -> Result<T, LineError> {
        let mut result = self.ask_once(command, wait, &answer);
        for _ in 1..SAID {
            let before = match &result {
                Err(LineError::Silent { heard, .. }) => heard.clone(),
                Err(LineError::Refused { answer, .. }) if !is_understood(answer) => None,
                _ => break,
            };
            let streams = Value::Stream(self.synchronise()?).to_string();
            result = self.ask_once(command, wait, &answer);
            // Somebody is there, whether or not a line came this time.
            if let Err(LineError::Silent { heard, .. }) = &mut result {
                heard.get_or_insert(before.unwrap_or(streams));
            }
        }
        result
    }

    /// The same, said once: for what must not be done twice.
    pub fn ask_once<T>(
        &mut self,
        command: &str,
        wait: Duration,
        answer: impl Fn(&[String]) -> Option<T>,
    ) -> Result<T, LineError> {
        // What has come so far is not about what is asked now.
        self.wait_out(Duration::ZERO)?;
        self.tell(command)?;
        let until = self.pc.now() + wait;
        let mut lines = Vec::new();
        while let Some(line) = self.line(until)? {
            if is_error(&line) {
                return Err(LineError::Refused {
                    command: command.to_owned(),
                    answer: line,
                });
            }
            lines.push(line);
            if let Some(answer) = answer(&lines) {
                return Ok(answer);
            }
        }
        Err(self.silent(command, lines.pop()))
    }

    /// The next line that comes within a time.
    ///
    /// # Errors
    /// The sensor started anew, or the port stopped working.
    pub fn next_line(&mut self, wait: Duration) -> Result<Option<String>, LineError> {
        self.line(self.pc.now() + wait)
    }

    /// Says a command whose answer is not waited for.
    pub fn tell(&mut self, command: &str) -> Result<(), LineError> {
        self.say(format!("{command}\r").as_bytes(), command)
    }

    /// The bytes that come next, whatever they are: none if none come in time.
    pub fn bytes(&mut self, bytes: &mut [u8], wait: Duration) -> Result<usize, LineError> {
        match self.port.read(bytes, wait) {
            Ok(0) => Err(self.gone(io::ErrorKind::UnexpectedEof.into())),
            Ok(count) => Ok(count),
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Ok(0),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(0),
            Err(error) => Err(self.gone(error)),
        }
    }

    /// Changes the port's rate and characters.
    pub fn set_line(&mut self, baud: Baud, bits: Bits) -> Result<(), LineError> {
        let set = self.port.set_line(baud, bits);
        set.map_err(|error| self.gone(error))
    }

    /// Has a sensor speak plainly, whichever rate, characters and format it has, and gives whether readings
    /// stream.
    pub fn wake(&mut self) -> Result<bool, LineError> {
        let mut tries = 0;
        loop {
            tries += 1;
            match self.wake_once() {
                // Above 115200 baud a byte to the sensor may be lost.
                Err(LineError::Silent { .. }) if tries < TRIES => {}
                answer => return answer,
            }
        }
    }

    fn wake_once(&mut self) -> Result<bool, LineError> {
        let plain = Command::Set(Value::Plain(true));
        // The slowest first: what a sensor still has to say at its own rate takes up to 0.9 s.
        for baud in Baud::ALL {
            for bits in Bits::ALL {
                self.set_line(baud, bits)?;
                self.tell(&format!("\x15\r{plain}"))?;
                // The bytes must have left before the rate changes.
                self.pc.sleep(WAKE);
            }
        }
        self.set_line(Baud::default(), Bits::default())?;
        let until = self.pc.now() + WAKE;
        while self.bytes(&mut [0; 4096], WAKE)? > 0 && self.pc.now() < until {}
        self.received.clear();
        self.synchronise_once()
    }

    /// Has the sensor speak as its settings say. The answer may be in a packet.
    pub fn end_plain(&mut self) -> Result<(), LineError> {
        let off = Command::Set(Value::Plain(false)).to_string();
        let answer = |lines: &[String]| lines.last()?.ends_with(&off).then_some(());
        self.ask(&off, ANSWER, answer)
    }

    /// Asks whether a sensor is there, for four seconds at most, and leaves it as it is.
    pub fn find(&mut self) -> Result<(), LineError> {
        match self.answers() {
            Err(LineError::Restarted { .. }) => Ok(()),
            Err(LineError::Silent { .. }) => {
                self.wake_once()?;
                self.end_plain()
            }
            answers => answers.map(drop),
        }
    }

    /// Looks for a sensor that shares its line, by an address or by Modbus, and gives how to talk to it.
    /// Takes ten seconds if there is none.
    pub fn find_sharing(&mut self) -> Result<Option<String>, LineError> {
        let name = self.name.clone();
        let mut heard = Vec::new();
        for number in 1..=247 {
            // Of Modbus: read the holding register 5, the address.
            let request = [number, 3, 0, 5, 0, 1];
            let request = [&request[..], &modbus::checksum(&request).to_le_bytes()].concat();
            // The CR ends what a sensor without Modbus took for the start of a line.
            for question in [request, format!("\r@{number} address\r").into()] {
                self.say(&question, "address")?;
                let mut bytes = [0; LONGEST];
                let count = self.bytes(&mut bytes, SHARING)?;
                heard.extend_from_slice(bytes.get(..count).unwrap_or_default());
            }
            // An adapter may keep bytes for a while, so this may be the answer to an earlier question. The
            // number in the answer tells whose it is.
            let text = String::from_utf8_lossy(&heard);
            let is_said = |it: &u8| text.contains(&format!("@{it} address {it}\r"));
            if let Some(address) = (1..=number).find(is_said) {
                return Ok(Some(format!(
                    "a sensor with the address {address} answers at {name}, and the tool talks to a sensor \
                     that is alone on its line: send it the line `@{address} address 0` from a terminal"
                )));
            }
            let station = heard.windows(7).find_map(|it| match it {
                &[station, 3, 2, .., low, high] => (it.get(..5))
                    .is_some_and(|it| modbus::checksum(it) == u16::from_le_bytes([low, high]))
                    .then_some(station),
                _ => None,
            });
            if let Some(station) = station {
                return Ok(Some(format!(
                    "a sensor speaks Modbus at {name} as station {station}: read it by a Modbus master, or let \
                     one write 0 to its holding register 4, for text"
                )));
            }
        }
        Ok(None)
    }

    /// Leaves behind whatever was said before, and gives whether readings stream.
    pub fn synchronise(&mut self) -> Result<bool, LineError> {
        self.ask_stream(TRIES, ANSWER)
    }

    /// The same in a second at most, at 115200 baud.
    pub fn answers(&mut self) -> Result<bool, LineError> {
        self.ask_stream(2, GLANCE / 2)
    }

    /// As [`Line::synchronise`], with one try only.
    pub fn synchronise_once(&mut self) -> Result<bool, LineError> {
        self.ask_stream(1, ANSWER)
    }

    fn ask_stream(&mut self, tries: usize, wait: Duration) -> Result<bool, LineError> {
        let question = Command::Show(Setting::Stream).to_string();
        let mut heard = None;
        for _ in 0..tries {
            // Ctrl-U is not text: a line that somebody left half typed, or that lost its end, is an error and
            // no command.
            self.say(format!("\x15\r{question}\r").as_bytes(), &question)?;
            let until = self.pc.now() + wait;
            while let Some(line) = self.line(until)? {
                if let Ok(Command::Set(Value::Stream(on))) = parse(line.as_bytes()) {
                    return Ok(on);
                }
                // What it says of the line before the question is of no interest.
                if !is_error(&line) {
                    heard = Some(line);
                }
            }
        }
        Err(self.silent(&question, heard))
    }

    /// Lets the sensor say what it still has to say of what was asked before.
    ///
    /// # Errors
    /// The sensor started anew, or the port stopped working.
    pub fn wait_out(&mut self, time: Duration) -> Result<(), LineError> {
        let until = self.pc.now() + time;
        while self.line(until)?.is_some() {}
        Ok(())
    }

    fn say(&mut self, bytes: &[u8], command: &str) -> Result<(), LineError> {
        self.port.write(bytes).map_err(|error| match error.kind() {
            io::ErrorKind::TimedOut => self.silent(command, None),
            _ => self.gone(error),
        })
    }

    /// The next line that is not empty, if it comes in time. Once time is up, what has come by then.
    fn line(&mut self, until: Duration) -> Result<Option<String>, LineError> {
        let mut bytes = [0; 1024];
        loop {
            while let Some(end) = self.received.iter().position(|byte| b"\r\n".contains(byte)) {
                let line: Vec<u8> = self.received.drain(..=end).take(end).collect();
                if line.is_empty() {
                    continue;
                }
                let line = text_of(&line);
                return match is_banner(&line) {
                    true => Err(LineError::Restarted(line)),
                    false => Ok(Some(line)),
                };
            }
            if self.received.len() > LONGEST {
                self.received.clear();
            }
            match self.bytes(&mut bytes, until.saturating_sub(self.pc.now()))? {
                0 if self.pc.now() >= until => return Ok(None),
                count => self.received.extend(bytes.iter().take(count)),
            }
        }
    }

    fn silent(&self, command: &str, heard: Option<String>) -> LineError {
        LineError::Silent {
            name: self.name.clone(),
            command: command.to_owned(),
            heard,
        }
    }

    fn gone(&self, error: io::Error) -> LineError {
        LineError::Gone(self.name.clone(), error)
    }
}

/// So says the library on Unix of a port that another program has locked.
fn is_in_use(error: &serialport::Error) -> bool {
    cfg!(unix) && error.kind() == serialport::ErrorKind::NoDevice
}

/// A line without control characters, which would act on a terminal.
fn text_of(line: &[u8]) -> String {
    String::from_utf8_lossy(line).replace(char::is_control, "\u{FFFD}")
}

/// `E3 out of range ...`
fn is_error(line: &str) -> bool {
    let mut bytes = line.bytes();
    bytes.next() == Some(b'E') && bytes.next().is_some_and(|byte| byte.is_ascii_digit())
}

/// Whether an error is about what was asked, and not about words that noise may have changed: those are the
/// errors up to E7, of [`Error`](slitrange_device::protocol::command::Error).
fn is_understood(error: &str) -> bool {
    let words = error.strip_prefix('E').unwrap_or_default();
    let digits = words.split(' ').next().unwrap_or_default();
    digits.parse().is_ok_and(|number: u32| number > 7)
}

/// Whether the last line is the command itself: so a sensor answers what it has done.
pub(super) fn is_echoed(lines: &[String], command: &str) -> Option<()> {
    (lines.last()? == command).then_some(())
}

fn is_banner(line: &str) -> bool {
    line.starts_with("slitrange ") && line.contains(", started by ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_does_nothing_to_a_terminal() {
        assert_eq!(text_of(b"E3 \x1b[2J\x07"), "E3 \u{FFFD}[2J\u{FFFD}");
    }
}
