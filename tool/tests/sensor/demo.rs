//! `demo` with a script in place of the virtual board: its port is that of the simulated sensor.

use std::fs;
use std::io::Write;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Command, Stdio};
use std::time::Instant;

use slitrange_tool::demo::{DemoOptions, serve};

use super::screen::Person;
use super::stand_in::StandIn;
use crate::command::*;

/// A program that notes its process and its options, says a few lines, and goes on as `rest` says.
fn board(sensor: &StandIn, rest: &str) -> PathBuf {
    let program = sensor.path("board");
    let (noted, port) = (sensor.file("noted"), sensor.port());
    let script = format!(
        "#!/bin/sh\necho $$ \"$@\" > '{noted}'\necho 'a message' >&2\necho booting\n\
         echo 'serial line: {port}'\n{rest}\n"
    );
    fs::write(&program, script).expect("a script");
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).expect("a program");
    program
}

/// The process that the script noted, and its options.
fn noted(sensor: &StandIn) -> (u32, String) {
    let noted = sensor.text("noted");
    let (process, options) = noted.trim_end().split_once(' ').expect("two words");
    (process.parse().expect("a number"), options.to_owned())
}

/// Whether a process of this PC runs. It may take a moment to end.
fn runs(process: u32) -> bool {
    let until = Instant::now() + Duration::from_secs(10);
    let is_there = || {
        let mut kill = Command::new("kill");
        let kill = kill.args(["-0", &process.to_string()]);
        let kill = kill.stderr(Stdio::null());
        kill.status().expect("the command kill").success()
    };
    while is_there() {
        if Instant::now() > until {
            return true;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    false
}

/// A person who presses Ctrl-C once the output says that Ctrl-C ends the board.
struct Reader<'a>(&'a StandIn, String);

impl Write for Reader<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.1.push_str(&String::from_utf8_lossy(bytes));
        self.0.state().trouble.interrupted = self.1.contains("Ctrl-C ends it");
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn options(scene: Option<&str>, monitor: bool) -> DemoOptions {
    DemoOptions {
        scene: scene.map(str::to_owned),
        monitor,
        board: vec![],
    }
}

#[test]
fn the_board_is_started_and_its_port_is_named_and_ctrl_c_ends_it() {
    let sensor = StandIn::new(1);
    let program = board(&sensor, "exec sleep 600");
    let with = DemoOptions {
        board: vec!["--rows".to_owned(), "4".to_owned()],
        ..options(Some("quiet-paper"), false)
    };
    let mut reader = Reader(&sensor, String::new());
    serve(&program, &with, &sensor, &mut reader).expect("an end");
    says(&reader.1, [format!("monitor --port {}\n", sensor.port())]);
    let (process, arguments) = noted(&sensor);
    assert_eq!(arguments, "--pty --scene quiet-paper --rows 4");
    assert!(!runs(process));
}

#[test]
fn the_live_view_shows_the_readings_of_the_board() {
    let sensor = StandIn::new(2);
    let program = board(&sensor, "exec sleep 600");
    let person = Person::new(&sensor, &[(20, Key::Quit)]);
    let mut output = Vec::new();
    serve(&program, &options(None, true), &person, &mut output).expect("an end");
    let output = String::from_utf8(output).expect("text");
    println!("{output}");
    begins(&output, "booting\n");
    says(&output, [" readings, ", "no faults"]);
    let (process, arguments) = noted(&sensor);
    assert_eq!(arguments, "--pty");
    assert!(!runs(process));
}

#[test]
fn a_board_that_ends_is_an_error() {
    let sensor = StandIn::new(3);
    let program = board(&sensor, "exit 3");
    let mut output = Vec::new();
    let ended = serve(&program, &options(None, false), &sensor, &mut output);
    let error = format!("{:#}", ended.expect_err("it ended"));
    says(&error, ["the virtual board ended (exit status: 3)"]);
    begins(&String::from_utf8_lossy(&output), "booting\n");
}

#[test]
fn without_the_board_the_error_says_how_to_build_it() {
    // The program of this test has no virtual board beside it.
    let error = StandIn::new(4).refused("demo quiet-paper");
    says(&error, ["`cargo build --bin demo`"]);
}
