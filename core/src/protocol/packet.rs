//! Packets: what the sensor sends with `format binary`.
//!
//! ```text
//! 0 | COBS of (sequence number, message, CRC-32 of both) | 0
//! ```
//!
//! A packet is a [`Packet`] by postcard, then the CRC-32 (ISO-HDLC, as in zip) of those bytes, little endian.
//! COBS (consistent overhead byte stuffing, Cheshire and Baker 1999) writes all this without a zero. So a
//! zero is never inside a packet: a reader that joins in the middle is in step from the next zero on. A
//! packet begins and ends with a zero. If noise changes one of the two zeros, the packet beside it is not
//! lost too.
//!
//! The commands to the sensor are lines of text all the same.
//!
//! [`Packets`] writes packets, and [`Decoder`] reads them. A damaged packet passes the CRC with a probability
//! of 2^-32.

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc};
use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::fault::Fault;
use crate::reading::Reading;

/// How the sensor writes what it sends: the setting `format`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Format {
    /// Lines of text.
    #[default]
    Text,
    /// Packets.
    Binary,
}

impl Format {
    /// The name on the serial line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Text => "text",
            Self::Binary => "binary",
        }
    }

    /// Finds a format by its [`name`](Self::name).
    pub fn named(name: &str) -> Option<Self> {
        [Self::Text, Self::Binary]
            .into_iter()
            .find(|format| format.name() == name)
    }
}

/// A packet before the CRC and COBS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Packet<'a> {
    /// Counts all packets since the start, also those that the sensor dropped because the line was busy.
    /// Wraps at 2^16.
    pub sequence: u16,
    /// What the packet says.
    #[serde(borrow)]
    pub message: Message<'a>,
}

/// What a packet says. Its number on the line is its place in this list. A message that changes gets a new
/// number, and an old number is never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Message<'a> {
    /// Up to [`TEXT_PART`] bytes of the text of an answer. All such parts, in their order, are the text. A
    /// part ends where a line ends, with CR LF, unless the line is longer than a part.
    Text(&'a [u8]),
    /// The result of a frame.
    Result(FrameResult),
}

/// The result of a frame, as the stream reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameResult {
    /// Counts the results since the start, this one included. Wraps at 2^32.
    pub counter: u32,
    /// When the frame's last row was in memory, in microseconds since the start.
    pub time_us: u64,
    /// The distance is relative to `zero`.
    pub is_difference: bool,
    /// The reading, or why there is none.
    pub result: Result<Reading, Fault>,
}

/// The most bytes in a part of a text.
pub const TEXT_PART: usize = 256;

/// The longest packet before COBS: a whole part of text, its length, the number of the message, the sequence
/// number and the CRC.
pub const MAX_BODY: usize = TEXT_PART + 2 + 1 + 3 + SUM;

/// The longest packet on the line. COBS adds a byte for each group of up to 254 bytes, and two zeros follow.
pub const MAX_PACKET: usize = MAX_BODY + MAX_BODY / GROUP + 1 + 2;

/// Bytes of the CRC.
const SUM: usize = size_of::<u32>();

/// The most bytes between two bytes of COBS.
const GROUP: usize = 254;

/// With a table of 1 KB: packets come with each row, and bit by bit their CRC would take eight times as long.
const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Writes packets, one after the other.
#[derive(Clone, Debug, Default)]
pub struct Packets {
    sequence: u16,
    bytes: Vec<u8, MAX_PACKET>,
}

impl Packets {
    /// Writes a packet, at most [`MAX_PACKET`] bytes, and counts it. Empty if the message is longer than any
    /// should be: a text of more than [`TEXT_PART`] bytes.
    pub fn encode(&mut self, message: Message<'_>) -> &[u8] {
        self.bytes.clear();
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        if write(&Packet { sequence, message }, &mut self.bytes).is_none() {
            self.bytes.clear();
        }
        &self.bytes
    }
}

/// The parts of a text, one for each packet.
pub fn parts_of_text(text: &str) -> impl Iterator<Item = &[u8]> {
    text.split_inclusive('\n')
        .flat_map(|line| line.as_bytes().chunks(TEXT_PART))
}

fn write(packet: &Packet<'_>, to: &mut Vec<u8, MAX_PACKET>) -> Option<()> {
    let mut body = [0; MAX_BODY];
    let length = postcard::to_slice(packet, &mut body).ok()?.len();
    let (before, after) = body.split_at_mut_checked(length)?;
    *after.first_chunk_mut()? = CRC.checksum(before).to_le_bytes();
    to.push(0).ok()?;
    stuff(body.get(..length.saturating_add(SUM))?, to)?;
    to.push(0).ok()
}

/// Writes bytes by COBS: groups of up to 254 bytes without a zero, each behind a byte that is one more than
/// their number. A zero follows each group but the last one and those of 254 bytes.
///
/// Not the crate `cobs`: the linker must prove that the firmware cannot panic. host-tests/tests/packets.rs
/// compares the two.
fn stuff(bytes: &[u8], to: &mut Vec<u8, MAX_PACKET>) -> Option<()> {
    let mut rest = bytes;
    loop {
        let group = rest.iter().take(GROUP).take_while(|&&byte| byte != 0);
        let (group, after) = rest.split_at_checked(group.count())?;
        // At most 254 bytes.
        to.push((group.len() as u8).wrapping_add(1)).ok()?;
        // Byte by byte: of `extend_from_slice` it cannot be proven that nothing overflows.
        group.iter().try_for_each(|&byte| to.push(byte).ok())?;
        rest = match after {
            [] => return Some(()),
            after if group.len() == GROUP => after,
            [_zero, after @ ..] => after,
        };
    }
}

/// Why bytes between two zeros are no packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketError {
    /// A group of COBS ends too early: the beginning or the end is missing, or a byte is wrong.
    Cut,
    /// There are more bytes than in any packet.
    TooLong,
    /// The CRC differs.
    Checksum,
    /// The CRC is right, but this version of the library does not know the message.
    Unknown,
}

impl fmt::Display for PacketError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cut => "a packet is cut",
            Self::TooLong => "more bytes than in any packet",
            Self::Checksum => "a packet has a wrong checksum",
            Self::Unknown => "a packet of another version of the firmware",
        })
    }
}

impl core::error::Error for PacketError {}

/// Reads packets from bytes, from any point of the stream on.
#[derive(Clone, Debug, Default)]
pub struct Decoder {
    body: Vec<u8, MAX_BODY>,
    /// Bytes that the group under way still has.
    left: u8,
    /// A zero belongs between the group under way and the next one.
    is_zero_due: bool,
    is_too_long: bool,
    /// The packet has ended, and the next byte begins another one.
    is_over: bool,
}

impl Decoder {
    /// A decoder that has seen no byte.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the next byte. Returns the packet that it ends, if it ends one.
    ///
    /// # Errors
    /// [`PacketError`] if the bytes since the last zero are no packet. The next packet can be read all the
    /// same.
    pub fn take(&mut self, byte: u8) -> Option<Result<Packet<'_>, PacketError>> {
        if self.is_over {
            self.start();
        }
        match (byte, self.left) {
            (0, _) => {
                self.is_over = true;
                let is_empty = self.body.is_empty() && self.left == 0 && !self.is_zero_due;
                return (!is_empty).then(|| self.packet());
            }
            (code, 0) => {
                if self.is_zero_due {
                    self.push(0);
                }
                self.left = code.saturating_sub(1);
                self.is_zero_due = usize::from(self.left) < GROUP;
            }
            (byte, left) => {
                self.left = left.saturating_sub(1);
                self.push(byte);
            }
        }
        None
    }

    /// Forgets the bytes so far.
    fn start(&mut self) {
        self.body.clear();
        (self.left, self.is_zero_due) = (0, false);
        (self.is_too_long, self.is_over) = (false, false);
    }

    fn push(&mut self, byte: u8) {
        self.is_too_long |= self.body.push(byte).is_err();
    }

    fn packet(&self) -> Result<Packet<'_>, PacketError> {
        if self.is_too_long {
            return Err(PacketError::TooLong);
        }
        if self.left != 0 {
            return Err(PacketError::Cut);
        }
        let (packet, sum) = self.body.split_last_chunk().ok_or(PacketError::Cut)?;
        if u32::from_le_bytes(*sum) != CRC.checksum(packet) {
            return Err(PacketError::Checksum);
        }
        match postcard::take_from_bytes(packet) {
            Ok((packet, [])) => Ok(packet),
            _ => Err(PacketError::Unknown),
        }
    }
}
