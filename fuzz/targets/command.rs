//! Bytes on the serial line: whatever comes, it is a command, an error or nothing; and a command's text is that command.
#![no_main]

use libfuzzer_sys::fuzz_target;
use slitrange::protocol::command::{Command, Error, MAX_LINE, parse};
use slitrange::protocol::input::Input;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new();
    for &byte in bytes {
        if let Some(taken) = input.take(byte) {
            check(taken);
        }
    }
    let whole = parse(bytes);
    assert_eq!(whole == Err(Error::TooLong), bytes.len() > MAX_LINE);
    check(whole);
});

fn check(taken: Result<Command, Error>) {
    match taken {
        Ok(command) => assert_eq!(parse(command.to_string().as_bytes()), Ok(command)),
        Err(error) => assert!(error.to_string().starts_with('E'), "{error}"),
    }
}
