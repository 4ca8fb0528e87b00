//! Tests of `cargo demo --pty`, which opens the serial line as a pseudo-terminal. The tests use it as `tio`
//! does.

use std::fs::{self, File, OpenOptions};
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use simulator::distorted_optics::DistortedOptics;
use simulator::optics::Optics;

use super::common::*;

/// The most lines before an answer. Results never end, so this limit ends a failed test.
const LINES: usize = 200;

struct Demo {
    process: Child,
    terminal: BufReader<File>,
}

impl Drop for Demo {
    fn drop(&mut self) {
        // This fails if the demo has already ended. Then the test has reported it.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Demo {
    fn start(arguments: &[&str]) -> Self {
        let mut demo = Command::new(env!("CARGO_BIN_EXE_demo"));
        demo.arg("--pty").args(arguments).stdout(Stdio::piped());
        let mut process = demo.spawn().expect("the demo starts");
        let mut stdout = BufReader::new(process.stdout.take().expect("a pipe"));
        let mut line = String::new();
        stdout.read_line(&mut line).expect("a first line");
        let path = line.trim_end().strip_prefix("serial line: ");
        let path = path.unwrap_or_else(|| panic!("no path in {line:?}"));
        let terminal = OpenOptions::new().read(true).write(true).open(path);
        let terminal = terminal.unwrap_or_else(|error| panic!("{path}: {error}"));
        let terminal = BufReader::new(terminal);
        Self { process, terminal }
    }

    fn send(&mut self, command: &str) {
        let sent = write!(self.terminal.get_mut(), "{command}\r\n");
        sent.expect("a command sent");
    }

    fn line(&mut self, wanted: impl Fn(&str) -> bool) -> String {
        let mut lines = vec![];
        for _ in 0..LINES {
            let mut line = String::new();
            self.terminal.read_line(&mut line).expect("a line");
            let line = line.trim_end().to_owned();
            if wanted(&line) {
                return line;
            }
            lines.push(line);
        }
        panic!("not the line that was awaited: {lines:#?}");
    }

    /// A reading of rows that were all exposed after this call.
    fn fresh_reading(&mut self) -> String {
        self.send("rows 4");
        // Lines after the answer were sent after the call.
        self.line(|line| line == "rows 4");
        // Skip two readings: one waited for the serial line, and one was not complete.
        (0..3).map(|_| self.line(is_reading)).last().expect("three")
    }
}

/// The path of a file of this test's own, which does not exist.
fn no_file(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    // A failed test may have left the file.
    let _ = fs::remove_file(&path);
    path
}

fn name(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

#[test]
fn a_terminal_program_talks_to_the_firmware() {
    let mut demo = Demo::start(&["--distance", "800"]);
    demo.send("rows 3");
    demo.line(|line| line == "rows 3");
    let line = demo.line(|line| line.contains(" n 3/3 "));
    println!("{line}");
    assert!(is_result(&line), "{line}");
}

/// The uncertainty of readings of white paper is some um.
#[test]
fn the_target_moves_to_the_position_in_the_stage_file() {
    let file = no_file("stage");
    let mut demo = Demo::start(&["--distance", "650", "--stage", name(&file)]);
    for (text, expected) in [
        (None, 650.0),
        (Some("700\n"), 700.0),
        (Some("somewhere"), 700.0),
        (Some(""), 700.0),
        (Some("1000.25"), 1000.25),
    ] {
        if let Some(text) = text {
            fs::write(&file, text).expect("a file");
        }
        let line = demo.fresh_reading();
        println!("{text:?}: {line}");
        let off = number(&line, "d ", " mm") - expected;
        assert!(off.abs() < 0.05, "{off} mm off: {line}");
    }
    fs::remove_file(&file).expect("the file");
    let line = demo.fresh_reading();
    let off = number(&line, "d ", " mm") - 1000.25;
    assert!(off.abs() < 0.05, "{line}");
}

/// The centre follows the hidden geometry. The distance is that of the nominal calibration for this centre.
#[test]
fn with_an_unknown_geometry_the_nominal_calibration_gives_wrong_distances() {
    const SEED: u64 = 7;
    let file = no_file("stage-of-an-unknown-geometry");
    let seed = SEED.to_string();
    let mut demo = Demo::start(&["--stage", name(&file), "--unknown-geometry", &seed]);
    let hidden = DistortedOptics::unknown(SEED, 300e-6).expect("a geometry");
    for distance in [0.62, 0.99] {
        fs::write(&file, (1e3 * distance).to_string()).expect("a file");
        let line = demo.fresh_reading();
        let centre = number(&line, " x ", " a ");
        println!("{distance} m: {line}");
        assert!((centre - hidden.centre(distance)).abs() < 0.05, "{line}");
        let reading = number(&line, "d ", " mm");
        let nominal = 1e3 * Optics::nominal().distance(hidden.centre(distance));
        assert!((reading - nominal).abs() < 0.05, "{nominal} mm: {line}");
        assert!((reading - 1e3 * distance).abs() > 1.0, "{line}");
    }
    fs::remove_file(&file).expect("the file");
}

/// Kills the demo as soon as the sensor reports the save. The file must hold the configuration.
#[test]
fn saved_settings_survive_a_restart_of_the_demo() {
    let file = no_file("flash");
    let arguments = ["--distance", "800", "--flash", name(&file)];
    let mut demo = Demo::start(&arguments);
    for command in ["rows 5", "save"] {
        demo.send(command);
        demo.line(|line| line == command);
    }
    demo.send("rows 6");
    demo.line(|line| line == "rows 6");
    drop(demo);
    let mut demo = Demo::start(&arguments);
    demo.send("rows");
    assert_eq!(demo.line(|line| line.starts_with("rows ")), "rows 5");
    fs::remove_file(&file).expect("the file");
}

/// A distance is in millimetres, here as in the tool.
#[test]
fn a_distance_in_metres_is_refused() {
    for metres in ["0.8", "9000", "far"] {
        let range = "must be 10 to 8380 millimetres (800, not 0.8)";
        assert_refused(&["--distance", metres], &[range]);
    }
}

fn assert_refused(arguments: &[&str], words: &[&str]) {
    let mut demo = Command::new(env!("CARGO_BIN_EXE_demo"));
    let demo = demo.args(arguments).output().expect("the demo starts");
    let message = String::from_utf8_lossy(&demo.stderr);
    assert!(!demo.status.success());
    assert!(words.iter().all(|it| message.contains(it)), "{message}");
}

#[test]
fn a_flash_file_of_the_wrong_size_is_refused() {
    let file = no_file("no-flash");
    fs::write(&file, [0; 100]).expect("a file");
    let arguments = ["--pty", "--flash", name(&file)];
    assert_refused(&arguments, &["no-flash", "100 bytes"]);
    fs::remove_file(&file).expect("the file");
}
