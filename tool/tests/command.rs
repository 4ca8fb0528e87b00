//! Runs the tool's commands as a person types them, and checks what they print. Most test files import this.

pub use calibration::points::{Point, Points};
use clap::Parser as _;
pub use rand::{Rng, SeedableRng};
pub use rand_chacha::ChaCha8Rng;
pub use simulator::scene::{Scene, Simulation, Spot};
pub use simulator::with;
pub use slitrange::check::own_spot::Profile;
pub use slitrange::frame::comb::{Comb, Slits};
pub use slitrange::row::sensor_heads::{TCD1304DG_LEAD_IN, tcd1304dg};
pub use slitrange::spot::region::Region;
pub use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Counts, Estimator, Measured, Measurement, Options,
    Pixels, Polarity, Surface,
};
pub use slitrange_device::record::Record;
pub use slitrange_device::record::encoded::EncodedRecord;
pub use slitrange_device::settings::{Setting, Settings};
use slitrange_tool::Command;
pub use slitrange_tool::pc::{Pc, Port, RealPc};
pub use slitrange_tool::record_file;
pub use slitrange_tool::screen::Key;
pub use std::cell::{Cell, RefCell};
pub use std::collections::VecDeque;
pub use std::io;
pub use std::path::{Path, PathBuf};
pub use std::process::ExitCode;
pub use std::time::Duration;
pub use virtual_board::light::{Target, of_scene};
pub use virtual_board::{Firmware, VirtualBoard};

/// How a command ended, by its exit code or its error, and its output.
pub type Ended = (Result<ExitCode, String>, String);

/// Runs `slitrange` with these arguments and with what a person types.
pub fn slitrange<S: AsRef<str>>(pc: &dyn Pc, arguments: &[S], typed: &str) -> Ended {
    let arguments = arguments.iter().map(AsRef::as_ref);
    let command = Command::try_parse_from(["slitrange"].into_iter().chain(arguments));
    let command = command.unwrap_or_else(|error| panic!("{error}"));
    let mut output = Vec::new();
    let result = command.run(pc, &mut typed.as_bytes(), &mut output);
    let output = String::from_utf8(output).expect("text");
    println!("{output}");
    let result = result.map_err(|error| {
        println!("slitrange: {error:#}");
        format!("{error:#}")
    });
    (result, output)
}

/// The output of a command that succeeds, or that finds a difference.
#[track_caller]
pub fn done((result, output): Ended) -> String {
    match result {
        Ok(_) => output,
        Err(error) => panic!("{error}"),
    }
}

#[track_caller]
pub fn refused((result, output): Ended) -> String {
    result.expect_err(&output)
}

/// Holds that a text has all these parts.
#[track_caller]
pub fn says<S: AsRef<str>>(text: &str, parts: impl IntoIterator<Item = S>) {
    for part in parts {
        let part = part.as_ref();
        assert!(text.contains(part), "no {part:?} in {text}");
    }
}

/// Holds that a text begins with these words.
#[track_caller]
pub fn begins(text: &str, words: &str) {
    assert!(text.starts_with(words), "no {words:?} begins {text}");
}

/// Holds that a text ends with these words.
#[track_caller]
pub fn ends(text: &str, words: &str) {
    assert!(text.ends_with(words), "no {words:?} ends {text}");
}

#[test]
fn a_decimal_comma_is_named() {
    for line in [
        "calibrate run --from 730,5 --to 800 p.csv",
        "monitor --seconds 1,5",
    ] {
        let error = Command::read(["slitrange"].into_iter().chain(line.split(' ')));
        let error = error.err().expect("no number").to_string();
        println!("{error}");
        says(&error, ["decimals follow a point: "]);
    }
    let other = Command::read(["slitrange", "monitor", "--seconds", "some"]).err();
    assert!(!other.expect("no number").to_string().contains("decimals"));
}
