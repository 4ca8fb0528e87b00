//! Reads the firmware's log (defmt frames in RTT's up-channel 0) from the emulated RAM, as a debug probe
//! does.

use defmt_decoder::{DecodeError, Table};
use rigless::emulator::Host;
use rigless::soc::Width;

/// One message of the firmware's log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// `trace`, `debug`, `info`, `warn` or `error`; `None` for a print without a level.
    pub level: Option<String>,
    /// The time by the firmware's clock, as the firmware formats it.
    pub timestamp: Option<String>,
    /// The message.
    pub text: String,
}

/// Offsets in SEGGER's control block: the first up-channel's descriptor follows a 16-byte identifier and two
/// counts.
const UP_CHANNEL: u64 = 24;
const BUFFER: u64 = UP_CHANNEL + 4;
const SIZE: u64 = UP_CHANNEL + 8;
const WRITE: u64 = UP_CHANNEL + 12;
const READ: u64 = UP_CHANNEL + 16;
const FLAGS: u64 = UP_CHANNEL + 20;

/// The channel's mode in which the firmware is to wait for room (SEGGER_RTT_MODE_BLOCK_IF_FIFO_FULL).
const BLOCKS: u64 = 2;

/// Sets the blocking mode, as probe-rs does when it connects.
///
/// # Errors
/// The control block is not in RAM.
pub(crate) fn set_blocking(host: &mut dyn Host, block: u64) -> anyhow::Result<()> {
    Ok(host.write(block + FLAGS, Width::W32, BLOCKS)?)
}

/// The channel's size in bytes, and where in it the firmware writes next.
///
/// # Errors
/// The control block is not in RAM.
pub(crate) fn size_and_place(host: &mut dyn Host, block: u64) -> anyhow::Result<[u64; 2]> {
    let mut word = |offset| host.read(block + offset, Width::W32);
    Ok([word(SIZE)?, word(WRITE)?])
}

/// Moves the contents of up-channel 0 into `bytes`, and frees the channel for the firmware. `block` is the
/// address of the control block. Does nothing until the firmware has set the block up.
pub(crate) fn drain(host: &mut dyn Host, block: u64, bytes: &mut Vec<u8>) {
    let mut word = |offset| host.read(block + offset, Width::W32).ok();
    if word(0) != Some(u64::from(u32::from_le_bytes(*b"SEGG"))) {
        return;
    }
    let words = [word(BUFFER), word(SIZE), word(WRITE), word(READ)];
    let [Some(buffer), Some(size), Some(write), Some(mut read)] = words else {
        return;
    };
    // The firmware writes both, and may have overwritten them in a crash.
    if write >= size || read >= size || read == write {
        return;
    }
    while read != write {
        if let Ok(byte) = host.read(buffer + read, Width::W8) {
            bytes.push(byte as u8);
        }
        read = (read + 1) % size;
    }
    // This fails only if the block is not in RAM. Then the firmware has written nothing into it.
    let _ = host.write(block + READ, Width::W32, read);
}

/// Takes the whole frames off the front of `bytes` and decodes them. Drops a frame that cannot be decoded,
/// such as one that a reset cut off.
pub(crate) fn decode(table: &Table, bytes: &mut Vec<u8>) -> Vec<Message> {
    // rzCOBS, defmt's encoding, ends each frame with a zero and has none inside.
    let Some(end) = bytes.iter().rposition(|&byte| byte == 0) else {
        return Vec::new();
    };
    let mut decoder = table.new_stream_decoder();
    decoder.received(&bytes[..=end]);
    bytes.drain(..=end);
    let mut messages = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => messages.push(Message {
                level: frame.level().map(|level| level.as_str().to_owned()),
                timestamp: frame.display_timestamp().map(|time| time.to_string()),
                text: frame.display_message().to_string(),
            }),
            Err(DecodeError::Malformed) => {}
            Err(DecodeError::UnexpectedEof) => return messages,
        }
    }
}
