//! Uploads a calibration's record over the serial line, as `slitrange calibrate write` does.

use std::time::Duration;

use anyhow::{Context as _, Result};
use slitrange_device::protocol::command::Command;
use slitrange_device::protocol::piece::{PIECE, Piece};
use slitrange_device::protocol::upload::Step;

use crate::run::VirtualBoard;

/// The pieces of a record, in order.
///
/// # Errors
/// The record is longer than any record of the core.
pub fn pieces(record: &[u8]) -> Result<Vec<Piece>> {
    let offsets = (0..record.len()).step_by(PIECE);
    offsets
        .map(|offset| {
            let piece = u16::try_from(offset).ok();
            let piece = piece.and_then(|offset| Piece::of(record, offset));
            piece.with_context(|| format!("no piece of the record at {offset}"))
        })
        .collect()
}

/// Sends a record, except the commit.
///
/// # Errors
/// The firmware does not repeat each command within `patience`.
pub fn send(board: &mut VirtualBoard, record: &[u8], patience: Duration) -> Result<()> {
    let bytes = u16::try_from(record.len()).context("the record is too long")?;
    let pieces = pieces(record)?.into_iter().map(Step::Piece);
    [Step::Begin(bytes)]
        .into_iter()
        .chain(pieces)
        .try_for_each(|step| board.tell(&Command::Upload(step).to_string(), patience))
}

/// As [`send`], and puts the record into use.
pub fn upload(board: &mut VirtualBoard, record: &[u8], patience: Duration) -> Result<()> {
    send(board, record, patience)?;
    board.tell(&Command::Upload(Step::Commit).to_string(), patience)
}
