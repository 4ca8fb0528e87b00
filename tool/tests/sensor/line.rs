//! A port is opened, a command answered, and what goes wrong is said.

use slitrange::protocol::command::Command;
use slitrange::settings::{Setting, Value};
use slitrange_tool::sensor::line::{Line, LineError};
use slitrange_tool::sensor::session::Session;

use crate::stand_in::{StandIn, Trouble, WAITS};

fn error(port: &str) -> String {
    Session::open(port, WAITS)
        .expect_err("no sensor")
        .to_string()
}

#[test]
fn a_pseudo_terminal_is_a_port_and_belongs_to_one_program() {
    let sensor = StandIn::new(1, Trouble::default());
    let port = sensor.port();
    let mut session = Session::open(&port, WAITS).expect("a session");
    assert_eq!(session.head(), "TCD1304DG");
    assert!(!sensor.state().settings().stream);
    assert_eq!(
        error(&port),
        format!("{port} is in use: end the program that has it open")
    );
    session.borrow_rows(64).expect("set");
    assert_eq!(sensor.state().settings().rows, 64);
    // What was set is put back, and the port is free again.
    drop(session);
    assert!(sensor.state().settings().stream);
    assert_eq!(sensor.state().settings().rows, 16);
    drop(Session::open(&port, WAITS).expect("a session"));
}

#[test]
fn a_stream_that_was_off_stays_off() {
    let sensor = StandIn::new(2, Trouble::default());
    sensor.state().type_line("stream off");
    drop(Session::open(&sensor.port(), WAITS).expect("a session"));
    assert!(!sensor.state().settings().stream);
}

#[test]
fn what_stands_in_the_way_is_said() {
    let none = error("/dev/none");
    println!("{none}");
    assert!(
        none.starts_with("there is no serial port /dev/none"),
        "{none}"
    );
    let file = error("/etc/hostname");
    println!("{file}");
    assert!(
        file.starts_with("/etc/hostname cannot be opened as a serial port: "),
        "{file}"
    );

    let sensor = StandIn::new(
        3,
        Trouble {
            lost: 1.0,
            ..Trouble::default()
        },
    );
    let port = sensor.port();
    assert_eq!(
        error(&port),
        format!(
            "nobody answers `stream` at {port}: check that this is the sensor's port and that the sensor has power"
        )
    );
    sensor.state().trouble.lost = 0.0;
    let mut session = Session::open(&port, WAITS).expect("a session");
    let line = session.line();
    let refused = line
        .ask("rows 65", WAITS.answer, |_| None::<()>)
        .expect_err("too many");
    assert_eq!(
        refused.to_string(),
        "the sensor answers `rows 65` with `E3 out of range, expected rows 1..64`"
    );
    let silent = line
        .ask("rows", WAITS.answer, |_| None::<()>)
        .expect_err("no answer");
    assert!(
        silent.to_string().starts_with(&format!(
            "`rows` has no answer at {port}, where `rows 16` came last: "
        )),
        "{silent}"
    );
}

#[test]
fn a_sensor_that_starts_anew_is_noticed() {
    let sensor = StandIn::new(4, Trouble::default());
    let mut session = Session::open(&sensor.port(), WAITS).expect("a session");
    sensor.state().off_until = Some(std::time::Instant::now());
    let error = session.value(Setting::Rows).map(|_| ());
    let error = error.and_then(|()| {
        std::thread::sleep(WAITS.answer);
        session.value(Setting::Rows).map(|_| ())
    });
    assert!(
        matches!(error, Err(LineError::Restarted { .. })),
        "{error:?}"
    );
    println!("{}", error.expect_err("restarted"));
}

/// Values arrive whole over a line on which every fifth line is lost or garbled, either way.
#[test]
fn a_bad_line_takes_longer_and_no_more() {
    let sensor = StandIn::new(5, Trouble::default());
    let mut session = Session::open(&sensor.port(), WAITS).expect("a session");
    sensor.state().trouble = Trouble {
        lost: 0.1,
        garbled: 0.1,
        ..Trouble::default()
    };
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
    let line: &mut Line = session.line();
    line.synchronise().expect("in order again");
}
