//! Bytes on the serial line: whatever comes, it is a command, an error or nothing, and a command's text is
//! that command. And no order of an upload's lines lets a record through that was not sent whole.
#![no_main]
#![forbid(unsafe_code)]

use libfuzzer_sys::fuzz_target;
use slitrange::row::sensor_heads::tcd1304dg;
use slitrange_device::protocol::command::{Command, Error, MAX_LINE, parse};
use slitrange_device::protocol::input::{Echo, Input};
use slitrange_device::protocol::piece::{PIECE, Piece};
use slitrange_device::protocol::upload::{Step, Upload};
use slitrange_device::record::encoded::EncodedRecord;
use slitrange_device::record::{MAX_ENCODED, Record, decode};

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new();
    let mut line = Line::new();
    for &byte in bytes {
        if let Some(taken) = input.take(byte) {
            check(taken);
            if let Ok(Command::Upload(step)) = taken {
                line.take(step);
            }
        }
    }
    let (mut typed, mut echo) = (Input::new(), Echo::default());
    for &byte in bytes {
        if let Some(taken) = typed.type_in(byte, &mut echo) {
            check(taken);
        }
        assert!(echo.as_str().len() == echo.as_bytes().len());
    }
    let whole = parse(bytes);
    assert_eq!(whole == Err(Error::TooLong), bytes.len() > MAX_LINE);
    check(whole);
    // Lines with a right checksum are hard to come by: the same bytes as steps.
    let mut line = Line::new();
    for chunk in bytes.chunks(4) {
        line.take(step(chunk));
    }
});

fn check(taken: Result<Command, Error>) {
    match taken {
        Ok(command) => assert_eq!(parse(command.to_string().as_bytes()), Ok(command)),
        Err(error) => assert!(error.to_string().starts_with('E'), "{error}"),
    }
}

/// A step of any kind. Pieces are of the nominal record, or of anything.
fn step(chunk: &[u8]) -> Step {
    let at = |i: usize| chunk.get(i).copied().unwrap_or_default();
    let nominal = EncodedRecord::nominal().expect("a record");
    let offset = u16::from(at(1)) * if at(2) < 128 { PIECE as u16 } else { 1 };
    let of_nominal = Piece::of(nominal.bytes(), offset);
    let of_anything = Piece::new(offset, chunk).expect("a piece");
    match at(0) % 8 {
        0 => Step::Begin(nominal.bytes().len() as u16),
        1 => Step::Begin((u16::from(at(1)) << 4 | u16::from(at(2))) % MAX_ENCODED as u16 + 1),
        2..=4 => Step::Piece(of_nominal.unwrap_or(of_anything)),
        5 => Step::Piece(of_anything),
        6 => Step::Commit,
        _ => Step::Abort,
    }
}

/// An upload beside what it should be: the bytes that came in order since it began.
struct Line {
    upload: Upload,
    announced: Option<usize>,
    came: Vec<u8>,
}

impl Line {
    fn new() -> Self {
        Self {
            upload: Upload::none(),
            announced: None,
            came: Vec::new(),
        }
    }

    fn take(&mut self, step: Step) {
        let mut record = None;
        let taken = (self.upload.take(step, &tcd1304dg(), &mut record)).map(|_| record);
        if let Err(refusal) = &taken {
            assert!(refusal.to_string().starts_with('E'), "{refusal}");
        }
        let expected = self.expected(step);
        assert_eq!(
            taken.as_ref().ok(),
            expected.as_ref(),
            "{step:?}: {taken:?}"
        );
    }

    /// What the step gives, if it is taken.
    fn expected(&mut self, step: Step) -> Option<Option<Record>> {
        match step {
            Step::Begin(bytes) => {
                self.announced = Some(usize::from(bytes));
                self.came.clear();
                Some(None)
            }
            Step::Abort => {
                self.announced = None;
                Some(None)
            }
            Step::Piece(piece) => {
                let (offset, bytes) = (usize::from(piece.offset()), piece.bytes());
                let end = offset + bytes.len();
                if self.announced.is_none_or(|announced| end > announced) {
                    return None;
                }
                if offset == self.came.len() {
                    self.came.extend_from_slice(bytes);
                    return Some(None);
                }
                let again = end == self.came.len() && self.came.get(offset..) == Some(bytes);
                again.then_some(None)
            }
            Step::Commit => {
                if self.announced != Some(self.came.len()) {
                    return None;
                }
                self.announced = None;
                let record = decode(&self.came).ok()?;
                let is_of_this_head = record.geometry.is_compatible_with(&tcd1304dg());
                is_of_this_head.then_some(Some(record))
            }
        }
    }
}
