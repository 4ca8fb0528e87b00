//! The serial line as a pseudo-terminal: `cargo demo --pty`, talked to as `tio` would.

use std::fs::OpenOptions;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Stdio};

use crate::common::is_result;

/// Lines that may come ahead of an answer. Results never end, so this ends the test and no clock.
const LINES: usize = 200;

/// The demo, which goes on until it is ended.
struct Demo(Child);

impl Drop for Demo {
    fn drop(&mut self) {
        // Gone already if it failed, which the test has said by then.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_terminal_program_talks_to_the_firmware() {
    let mut demo = Demo(
        Command::new(env!("CARGO_BIN_EXE_demo"))
            .args(["--pty", "--distance", "0.8"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("the demo starts"),
    );
    let stdout = demo.0.stdout.take().expect("a pipe");
    let mut line = String::new();
    BufReader::new(stdout)
        .read_line(&mut line)
        .expect("a first line");
    let path = line
        .trim_end()
        .strip_prefix("serial line: ")
        .unwrap_or_else(|| panic!("no path in {line:?}"));

    let terminal = OpenOptions::new()
        .read(true)
        .write(true)
        .open(path)
        .unwrap_or_else(|error| panic!("{path}: {error}"));
    (&terminal)
        .write_all(b"rows 3\r\n")
        .expect("a command sent");
    let mut lines = vec![];
    for line in BufReader::new(&terminal).lines().take(LINES) {
        let line = line.expect("a line");
        let done = line.contains(" n 3/3 ");
        lines.push(line);
        if done {
            break;
        }
    }
    println!("{path}: {lines:#?}");
    assert!(lines.iter().any(|line| line == "rows 3"), "{lines:#?}");
    assert!(
        lines
            .last()
            .is_some_and(|line| is_result(line) && line.contains(" n 3/3 ")),
        "{lines:#?}"
    );
}
