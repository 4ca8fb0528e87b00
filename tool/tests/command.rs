//! Commands of the tool as a person types them, and what they say.

use std::process::ExitCode;

use clap::Parser as _;
use slitrange_tool::Command;
use slitrange_tool::pc::Pc;

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
