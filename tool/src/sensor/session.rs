//! A conversation with a sensor, which leaves it as it was found.

use std::time::Duration;

use slitrange_device::protocol::command::{Command, parse};
use slitrange_device::protocol::flat::Flat;
use slitrange_device::settings::serial_line::{Baud, Bits, Format};
use slitrange_device::settings::{Setting, Settings, Value};

use super::answers::{self, Centre, InUse, NoCentre};
use super::line::{ANSWER, FRAME, Line, LineError, RECONNECT, TRIES, is_echoed};
use crate::pc::Pc;

/// Between two attempts to reach a sensor that is away.
const PAUSE: Duration = Duration::from_millis(200);

/// A sensor that answers and does not stream. What was set for the session alone is put back at its end.
/// Each question and each setting fails if no answer comes, or an error.
pub struct Session<'a> {
    line: Line<'a>,
    head: String,
    borrowed: Borrowed,
    streams: bool,
    /// Whether the sensor may speak otherwise than plainly.
    is_binary: bool,
}

/// A sensor that went away. What is put back at the end is not forgotten.
pub struct Away<'a> {
    pc: &'a dyn Pc,
    port: String,
    borrowed: Borrowed,
}

impl<'a> Away<'a> {
    /// Opens the port and asks whether the sensor is there again. Takes four seconds if nobody answers, and
    /// then a pause.
    pub fn find_again(self, pause: Duration) -> Link<'a> {
        let found = Line::open(self.pc, &self.port).and_then(|mut line| line.find());
        match found.and_then(|()| Session::open(self.pc, &self.port)) {
            Ok(mut session) => {
                session.borrowed = self.borrowed;
                Link::There(session)
            }
            Err(error) => {
                self.pc.sleep(pause);
                Link::Gone(self, error.to_string())
            }
        }
    }
}

/// A sensor for a view that goes on after the cable was out: the sensor, or what is needed to find it again
/// and why it went away.
pub enum Link<'a> {
    /// It answers.
    There(Session<'a>),
    /// It does not.
    Gone(Away<'a>, String),
}

/// Rows and stream, as they are put back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Before {
    /// Whether readings streamed.
    pub streamed: bool,
    /// The rows in a frame; none where they are not changed.
    pub rows: Option<u16>,
}

#[derive(Clone, Debug, Default)]
struct Borrowed {
    before: Before,
    /// The sensor echoed what is typed. An echoed command looks like its answer.
    echo: bool,
    /// The sensor spoke as its settings say, not plainly.
    own_format: bool,
    /// Rows were corrected with the map of the pixels.
    map: bool,
    /// The settings that the session changed, with the values that they had.
    values: Vec<Value>,
}

impl<'a> Session<'a> {
    /// Opens a port and finds out which sensor head answers there.
    ///
    /// # Errors
    /// The port cannot be opened, or what answers there is no sensor.
    pub fn open(pc: &'a dyn Pc, port: &str) -> Result<Self, LineError> {
        let mut line = Line::open(pc, port)?;
        let mut is_woken = false;
        let answer = match line.synchronise_once() {
            // It may speak packets, or have another rate.
            Err(LineError::Silent { .. }) => {
                is_woken = true;
                line.wake()
            }
            answer => answer,
        };
        let streamed = match answer {
            // It may have got its power with the port, or a moment ago.
            Err(LineError::Restarted { .. }) => line.synchronise(),
            answer => answer,
        }?;
        let mut session = Self {
            line,
            head: String::new(),
            borrowed: Borrowed::default(),
            streams: streamed,
            is_binary: false,
        };
        session.borrowed.before.streamed = streamed;
        session.borrowed.echo = session.value(Setting::Echo)? == Value::Echo(true);
        if session.borrowed.echo {
            // The echo of this line may be taken for its answer, which then still comes.
            session.set(Command::Set(Value::Echo(false)))?;
            session.line.synchronise()?;
        }
        let found = session.value(Setting::Plain)?;
        session.borrowed.own_format = is_woken || found == Value::Plain(false);
        session.set(Command::Set(Value::Plain(true)))?;
        session.set(Command::Set(Value::Stream(false)))?;
        session.streams = false;
        let info = Command::Info.to_string();
        session.head = session.line.ask(&info, ANSWER, answers::head)?;
        Ok(session)
    }

    /// The same sensor once more after it went away or forgot what was set.
    ///
    /// # Errors
    /// It does not come back within [`RECONNECT`].
    pub fn reopen(self) -> Result<Self, LineError> {
        let Away { pc, port, borrowed } = self.leave();
        let until = pc.now() + RECONNECT;
        loop {
            match Self::open(pc, &port) {
                Ok(mut session) => {
                    session.borrowed = borrowed;
                    return Ok(session);
                }
                Err(error) if pc.now() >= until => return Err(error),
                Err(_) => pc.sleep(PAUSE),
            }
        }
    }

    /// Frees the port of a sensor that went away, and puts nothing back.
    pub fn leave(mut self) -> Away<'a> {
        let away = Away {
            pc: self.line.pc(),
            port: self.port().to_owned(),
            borrowed: std::mem::take(&mut self.borrowed),
        };
        // Nothing is left to put back.
        (self.streams, self.is_binary) = (false, false);
        away
    }

    /// Has readings stream for as long as the session lasts.
    pub fn stream(&mut self) -> Result<(), LineError> {
        self.streams = true;
        self.set(Command::Set(Value::Stream(true)))
    }

    /// The rows that the sensor lost, and the lines that it dropped, since its start.
    pub fn losses(&mut self) -> Result<(u32, u32), LineError> {
        self.line
            .ask(&Command::Status.to_string(), ANSWER, answers::losses)
    }

    /// The sensor head's name.
    pub fn head(&self) -> &str {
        &self.head
    }

    /// The port's name.
    pub fn port(&self) -> &str {
        self.line.name()
    }

    /// The line, for further questions.
    pub fn line(&mut self) -> &mut Line<'a> {
        &mut self.line
    }

    /// Asks for the value of a setting. The answer is the line that sets it.
    pub fn value(&mut self, of: Setting) -> Result<Value, LineError> {
        self.line.ask(of.name(), ANSWER, |lines| {
            match parse(lines.last()?.as_bytes()) {
                Ok(Command::Set(value)) if value.setting() == of => Some(value),
                _ => None,
            }
        })
    }

    /// The values of some settings. The others are the factory's.
    pub fn settings(&mut self, asked: &[Setting]) -> Result<Settings, LineError> {
        let mut settings = Settings::default();
        for &setting in asked {
            settings.set(self.value(setting)?);
        }
        Ok(settings)
    }

    /// Says a command that may come twice without harm, and that the sensor repeats once it has done it.
    pub fn has_done(&mut self, command: &str, wait: Duration) -> Result<(), LineError> {
        (self.line).ask(command, wait, |lines| is_echoed(lines, command))
    }

    /// Sets a value.
    pub fn set(&mut self, command: Command) -> Result<(), LineError> {
        self.ask_to_set(command).map(drop)
    }

    /// Sets a value. Gives what the sensor remarks on it.
    fn ask_to_set(&mut self, command: Command) -> Result<Option<String>, LineError> {
        self.line.ask(&command.to_string(), ANSWER, |lines| {
            let (last, before) = lines.split_last()?;
            let remark = before.iter().find(|line| line.starts_with('('));
            (parse(last.as_bytes()) == Ok(command)).then(|| remark.cloned())
        })
    }

    /// The value that a setting had before the session, if the session changes it.
    pub fn found(&self, setting: Setting) -> Option<Value> {
        match setting {
            Setting::Stream => Some(Value::Stream(self.borrowed.before.streamed)),
            Setting::Echo => Some(Value::Echo(self.borrowed.echo)),
            Setting::Plain => Some(Value::Plain(!self.borrowed.own_format)),
            _ => (self.borrowed.values.iter().copied()).find(|value| value.setting() == setting),
        }
    }

    /// Sets a value that stays after the session. Gives what the sensor remarks on it.
    pub fn set_for_good(&mut self, value: Value) -> Result<Option<String>, LineError> {
        let mut remark = None;
        match value {
            // The end of the session sets them.
            Value::Stream(on) => self.borrowed.before.streamed = on,
            Value::Echo(on) => self.borrowed.echo = on,
            Value::Plain(on) => self.borrowed.own_format = !on,
            _ => {
                remark = self.ask_to_set(Command::Set(value))?;
                (self.borrowed.values).retain(|found| found.setting() != value.setting());
            }
        }
        Ok(remark)
    }

    /// Sets a value for as long as the session lasts.
    pub fn borrow(&mut self, value: Value) -> Result<(), LineError> {
        if self.found(value.setting()).is_some() {
            return self.set(Command::Set(value));
        }
        let found = self.value(value.setting())?;
        if found == value {
            return Ok(());
        }
        self.borrowed.values.push(found);
        self.set(Command::Set(value))
    }

    /// What the sensor says of its map of the pixels, in lines.
    pub fn map(&mut self) -> Result<Vec<String>, LineError> {
        (self.line).ask(&Flat::Show.to_string(), ANSWER, answers::flat)
    }

    /// Has rows stay as they are read, without the map of the pixels, for as long as the session lasts.
    pub fn borrow_without_map(&mut self) -> Result<(), LineError> {
        if self.map()?.first().is_some_and(|line| line == "flat on") {
            self.borrowed.map = true;
            self.use_map(false)?;
        }
        Ok(())
    }

    /// Puts back the map and the values of some settings before the session ends.
    pub fn give_back(&mut self, settings: &[Setting]) -> Result<(), LineError> {
        for &setting in settings {
            if let Some(found) = self.found(setting) {
                self.set_for_good(found)?;
            }
        }
        if self.borrowed.map {
            self.use_map(true)?;
            self.borrowed.map = false;
        }
        Ok(())
    }

    fn use_map(&mut self, on: bool) -> Result<(), LineError> {
        self.has_done(&Flat::Use(on).to_string(), ANSWER)
    }

    /// Has the sensor send packets at a rate until the session ends. The packets come from [`Session::line`].
    /// Above 115200 baud the sensor may lose the command: if no packet comes, call
    /// [`Session::ask_for_packets`] again.
    pub fn send_packets(&mut self, baud: Baud) -> Result<(), LineError> {
        self.is_binary = true;
        // Text at first, because the answer to `plain off` is one.
        let format = Value::Format(Format::Text);
        let bits = Bits::default();
        for value in [
            format,
            Value::Address(0),
            Value::Bits(bits),
            Value::Baud(baud),
        ] {
            let found = self.value(value.setting())?;
            self.borrowed.values.push(found);
            self.set(Command::Set(value))?;
        }
        self.set(Command::Set(Value::Plain(false)))?;
        self.line.set_line(baud, bits)?;
        self.ask_for_packets()
    }

    /// Sends `format binary`, and does not wait for an answer.
    pub fn ask_for_packets(&mut self) -> Result<(), LineError> {
        // Ctrl-U and the CR end a line that lost a byte before.
        let binary = Command::Set(Value::Format(Format::Binary));
        self.line.tell(&format!("\x15\r{binary}"))
    }

    /// Sets the rows in a frame for as long as the session lasts.
    pub fn borrow_rows(&mut self, rows: u16) -> Result<(), LineError> {
        self.before()?;
        self.set(Command::Set(Value::Rows(rows)))
    }

    /// What is put back at the end, with the rows.
    pub fn before(&mut self) -> Result<Before, LineError> {
        if self.borrowed.before.rows.is_none()
            && let Value::Rows(rows) = self.value(Setting::Rows)?
        {
            self.borrowed.before.rows = Some(rows);
        }
        Ok(self.borrowed.before)
    }

    /// Puts back something else at the end than what was found.
    pub fn put_back_instead(&mut self, before: Before) {
        self.borrowed.before = before;
    }

    /// What the sensor's centres mean at present.
    pub fn calibration(&mut self) -> Result<InUse, LineError> {
        let question = Command::Calibration(None).to_string();
        self.line.ask(&question, ANSWER, answers::in_use)
    }

    /// The centre of the next frame that is complete.
    pub fn centre(&mut self) -> Result<Result<Centre, NoCentre>, LineError> {
        let question = Command::Centre.to_string();
        let mut tries = 0;
        loop {
            let answer = self.line.ask_once(&question, FRAME, answers::centre);
            tries += 1;
            match answer {
                Err(LineError::Silent { .. } | LineError::Refused { .. }) if tries < TRIES => {
                    self.line.synchronise()?;
                    // The answer may only be late: it must not become that of another frame.
                    self.line.wait_out(FRAME / 4)?;
                }
                answer => return answer,
            }
        }
    }

    fn put_back(&mut self) -> Result<(), LineError> {
        let found = std::mem::take(&mut self.borrowed);
        let (values, Before { streamed, rows }) = (found.values, found.before);
        let is_changed = found.echo || found.own_format || found.map || rows.is_some();
        let is_changed = is_changed || !values.is_empty();
        if !is_changed && !streamed && !self.streams && !self.is_binary {
            return Ok(());
        }
        if self.is_binary {
            self.line.wake()?;
        } else {
            self.line.synchronise()?;
        }
        for value in values.into_iter().rev() {
            self.set(Command::Set(value))?;
        }
        if found.map {
            self.use_map(true)?;
        }
        if let Some(rows) = rows {
            self.set(Command::Set(Value::Rows(rows)))?;
        }
        self.set(Command::Set(Value::Stream(streamed)))?;
        if found.echo {
            self.set(Command::Set(Value::Echo(true)))?;
        }
        match found.own_format {
            true => self.line.end_plain(),
            false => Ok(()),
        }
    }

    fn changed(&self) -> String {
        let Borrowed { map, values, .. } = &self.borrowed;
        let values = values.iter().map(|value| value.setting().name());
        let names = ["stream", "rows", "echo"].into_iter().chain(values);
        let names = names.chain(map.then_some("flat"));
        let names: Vec<String> = names.map(|name| format!("`{name}`")).collect();
        names.join(", ")
    }
}

impl Drop for Session<'_> {
    fn drop(&mut self) {
        let changed = self.changed();
        if let Err(error) = self.put_back() {
            eprintln!("the sensor's own settings could not be put back: check {changed} ({error})");
        }
    }
}
