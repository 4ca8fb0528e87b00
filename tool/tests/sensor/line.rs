//! Opens a port and sends commands. Errors say what went wrong.

use std::fs::File;
use std::io::{Read as _, Write as _};

use nix::pty::openpty;
use nix::unistd::ttyname;
use slitrange_device::protocol::command::Command;
use slitrange_device::settings::Value;
use slitrange_device::settings::trigger::Trigger;
use slitrange_tool::sensor::line::{ANSWER, LineError};
use slitrange_tool::sensor::session::Session;

use super::stand_in::{StandIn, Trouble};
use crate::command::*;

/// The PC's own ports, with a clock that stands still while they are read: an answer may take any time.
#[derive(Default)]
struct RealPorts {
    pc: RealPc,
    now: Cell<Duration>,
}

impl Pc for RealPorts {
    fn open(&self, port: &str) -> serialport::Result<Box<dyn Port + '_>> {
        Ok(Box::new(Patient(self.pc.open(port)?)))
    }

    fn now(&self) -> Duration {
        self.now.get()
    }

    fn sleep(&self, time: Duration) {
        self.now.set(self.now.get() + time);
    }
}

struct Patient<'a>(Box<dyn Port + 'a>);

impl Port for Patient<'_> {
    fn read(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<usize> {
        // Ends a test that hangs.
        let minutes = Duration::from_secs(300);
        self.0
            .read(bytes, if wait.is_zero() { wait } else { minutes })
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write(bytes)
    }
}

fn error(pc: &dyn Pc, port: &str) -> String {
    let session = Session::open(pc, port);
    session.err().expect("no sensor").to_string()
}

#[test]
fn a_pseudo_terminal_is_a_port_and_belongs_to_one_program() {
    let ends = openpty(None, None).expect("a pseudo-terminal");
    let path = ttyname(&ends.slave).expect("its path");
    let port = path.to_str().expect("text");
    let mut sensor_side = File::from(ends.master);
    let sensor = std::thread::spawn(move || {
        let sensor = StandIn::new(1);
        let mut bytes = [0; 1024];
        // An error once the other end is closed.
        while let Ok(count) = sensor_side.read(&mut bytes) {
            let answer = sensor.exchange(&bytes[..count]);
            sensor_side.write_all(&answer).expect("written");
        }
        let settings = sensor.state().settings();
        (settings.rows, settings.stream)
    });
    let pc = RealPorts::default();
    let mut session = Session::open(&pc, port).expect("a session");
    assert_eq!(session.head(), "TCD1304DG");
    let stream = session.value(Setting::Stream).expect("an answer");
    assert_eq!(stream, Value::Stream(false));
    let in_use = format!("{port} is in use: end the program that has it open");
    assert_eq!(error(&pc, port), in_use);
    session.borrow_rows(64).expect("set");
    let rows = session.value(Setting::Rows).expect("an answer");
    assert_eq!(rows, Value::Rows(64));
    // What was set is put back, and the port is free again.
    drop(session);
    let mut session = Session::open(&pc, port).expect("a session");
    let rows = session.value(Setting::Rows).expect("an answer");
    assert_eq!(rows, Value::Rows(16));
    drop(session);
    drop(ends.slave);
    assert_eq!(sensor.join().expect("no panic"), (16, true));
}

#[test]
fn a_port_that_cannot_be_opened_is_an_error_with_a_reason() {
    let pc = RealPorts::default();
    let none = error(&pc, "/dev/none");
    begins(&none, "there is no serial port /dev/none");
    let file = error(&pc, "/etc/hostname");
    begins(&file, "/etc/hostname cannot be opened as a serial port: ");
    let sensor = StandIn::new(3);
    sensor.state().trouble.lost = 1.0;
    let port = sensor.port();
    let silent = format!(
        "no sensor answers `stream` at {port}: check that this is the sensor's port and that the sensor has \
         power"
    );
    assert_eq!(error(&sensor, &port), silent);
    sensor.state().trouble.lost = 0.0;
    let mut session = Session::open(&sensor, &port).expect("a session");
    let line = session.line();
    let mut refusal = |command| {
        let answer = line.ask(command, ANSWER, |_| None::<()>);
        answer.expect_err("no answer").to_string()
    };
    let refused = "the sensor answers `rows 65` with `E3 out of range, expected rows 1..64`";
    assert_eq!(refusal("rows 65"), refused);
    let silent = format!("`rows` has no answer at {port}, where `rows 16` came last: ");
    begins(&refusal("rows"), &silent);
}

#[test]
fn a_sensor_that_starts_anew_is_noticed() {
    let sensor = StandIn::new(4);
    let mut session = Session::open(&sensor, &sensor.port()).expect("a session");
    sensor.state().cut_power(Duration::ZERO);
    let error = session.value(Setting::Rows);
    assert!(
        matches!(error, Err(LineError::Restarted { .. })),
        "{error:?}"
    );
    println!("{}", error.expect_err("restarted"));
}

/// Every fifth line is lost or garbled, in both directions. Every value still arrives unchanged.
#[test]
fn a_bad_line_slows_a_session_and_changes_no_value() {
    let sensor = StandIn::new(5);
    let mut session = Session::open(&sensor, &sensor.port()).expect("a session");
    sensor.state().trouble = Trouble::of_line(0.1, 0.1);
    let (mut failed, mut set) = (0, 0);
    for rows in (1..=64).cycle().take(40) {
        match session.set(Command::Set(Value::Rows(rows))) {
            Ok(()) => {
                set += 1;
                assert_eq!(sensor.state().settings().rows, rows);
            }
            Err(error) => {
                println!("{error}");
                failed += 1;
            }
        }
    }
    println!("{set} set, {failed} not");
    // One in five either way: of 64 commands that are said four times, six fail each time.
    assert!(set >= 30, "{set}");
    sensor.state().trouble = Trouble::default();
    session.line().synchronise().expect("in order again");
}

#[test]
fn a_setting_is_borrowed_for_a_session() {
    let continuous = Value::Trigger(Trigger::Continuous);
    let sensor = StandIn::new(1);
    sensor.state().type_line("trigger serial");
    let mut session = Session::open(&sensor, &sensor.port()).expect("a sensor");
    session.borrow(continuous).expect("an answer");
    assert_eq!(sensor.state().settings().trigger, Trigger::Continuous);
    let found = session.found(Setting::Trigger);
    assert_eq!(found, Some(Value::Trigger(Trigger::Serial)));
    drop(session);
    assert_eq!(sensor.state().settings().trigger, Trigger::Serial);
}
