//! Packets: what the sensor sends with `format binary`.
//!
//! ```text
//! 0 | COBS of (sequence number, message, CRC-32 of both) | 0
//! ```
//!
//! A packet is a [`Packet`] by postcard, then the CRC-32 of those bytes, little endian: docs/serial-line.md
//! explains each. A packet begins and ends with a zero. If noise changes one of the two zeros, the packet
//! beside it is not lost too.
//!
//! [`Packets`] writes packets, and [`Decoder`] reads them. A damaged packet passes the CRC with a probability
//! of 2^-32.

use crc::{CRC_32_ISO_HDLC, Crc};
use heapless::Vec;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::protocol::row_lines;
use slitrange::base::exposure::Exposure;
use slitrange::row::{Geometry, LARGEST_COUNT};
use slitrange::{Fault, Measured, Reading};

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
    /// The pixels around the spot in the frame's last row, behind the frame's result.
    Window {
        /// The [`FrameResult::counter`] of the frame.
        counter: u32,
        /// The place of the first pixel on the row, from 0.
        first: u16,
        /// The counts, light positive: at most [`COUNTS_A_PACKET`], by [`Packed`].
        counts: &'a [u8],
    },
    /// A row, of which [`RowHead::words`] words follow.
    Row(RowHead),
    /// Words of the latest row.
    Words {
        /// The [`RowHead::number`] of the row.
        number: u32,
        /// The place of the first word in the read-out, from 0.
        first: u16,
        /// The words as the converter gave them: at most [`COUNTS_A_PACKET`], by [`Packed`].
        words: &'a [u8],
    },
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

/// A whole row and what the sensor measures in this row alone: a frame of one row, without a row before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RowHead {
    /// Counts the rows that the sensor read since its start. Wraps at 2^32.
    pub number: u32,
    /// Rows that the sensor read since the row before in this stream, and did not send.
    pub skipped: u32,
    /// When the row was in memory, in microseconds since the start.
    pub time_us: u64,
    /// For how long the laser was on in this row. `None` if it was off, or if no row came.
    pub exposure: Option<Exposure>,
    /// The words that follow: all of the read-out, or none if no row came. None also if a word has more than
    /// twelve bits, which no sensor makes.
    pub words: u16,
    /// The result.
    pub result: Result<Measured, Fault>,
}

/// The most counts or words in a packet.
pub const COUNTS_A_PACKET: usize = 256;

/// The bytes of so many.
const PACKED: usize = COUNTS_A_PACKET / 2 * 3;

/// Numbers of twelve bits, two in three bytes: the lower eight bits of the first, its upper four with the
/// lower four of the second above them, and the upper eight of the second. An odd one at the end has two
/// bytes. (GenICam calls this Mono12p.)
#[derive(Clone, Debug, Default)]
pub struct Packed(Vec<u8, PACKED>);

impl Packed {
    /// Packs numbers, at most [`COUNTS_A_PACKET`]. The rest is left out. A larger number counts as 4095.
    pub fn new(numbers: impl Iterator<Item = u16>) -> Self {
        let mut bytes = Vec::new();
        let mut before = None;
        let mut push = |byte: u8| {
            // There is room for the numbers of a packet.
            let _ = bytes.push(byte);
        };
        for number in numbers.take(COUNTS_A_PACKET) {
            let number = number.min(LARGEST_COUNT);
            match core::mem::take(&mut before) {
                None => {
                    push((number & 0xff) as u8);
                    before = Some((number >> 8) as u8);
                }
                Some(upper) => {
                    push(upper | ((number & 0xf) as u8 * (1 << 4)));
                    push(((number >> 4) & 0xff) as u8);
                }
            }
        }
        if let Some(upper) = before {
            push(upper);
        }
        Self(bytes)
    }

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

/// The numbers that [`Packed`] packed.
pub fn unpack(bytes: &[u8]) -> impl Iterator<Item = u16> {
    bytes.chunks(3).flat_map(|three| {
        let number = |low: Option<&u8>, high: Option<&u8>| Some((*low?, *high?));
        let (low, middle, high) = (three.first(), three.get(1), three.get(2));
        let first = number(low, middle)
            .map(|(low, middle)| u16::from(low) | (u16::from(middle & 0xf) * (1 << 8)));
        let second = number(middle, high)
            .map(|(middle, high)| u16::from(middle >> 4) | (u16::from(high) * (1 << 4)));
        first.into_iter().chain(second)
    })
}

/// The pixels around a spot.
#[derive(Clone, Debug)]
pub struct Window {
    first: u16,
    counts: Packed,
}

impl Window {
    /// The pixels around the spot of a row: those of `row window`, but at most [`COUNTS_A_PACKET`] of them,
    /// around the middle. `words` are those of the frame's last row, as the measurement left them.
    pub fn new(measured: &Measured, geometry: &Geometry, words: &[u16]) -> Option<Self> {
        let light = geometry.row_of_valid(words)?.light();
        let window = row_lines::window(measured);
        let beyond = window.len().saturating_sub(COUNTS_A_PACKET);
        let first = window.start.saturating_add(beyond / 2).min(light.len());
        let last = first.saturating_add(window.len().min(COUNTS_A_PACKET));
        let last = last.min(light.len());
        Some(Self {
            first: u16::try_from(first).ok()?,
            counts: Packed::new(light.slice(first..last)?.iter()),
        })
    }

    /// The message about the frame with this [`FrameResult::counter`].
    pub fn message(&self, counter: u32) -> Message<'_> {
        Message::Window {
            counter,
            first: self.first,
            counts: self.counts.bytes(),
        }
    }
}

/// The words of a row, as messages.
#[derive(Clone, Debug)]
pub struct RowWords<'a> {
    number: u32,
    first: u16,
    rest: &'a [u16],
    packed: Packed,
}

impl<'a> RowWords<'a> {
    /// The words of a row with this [`RowHead::number`]. None if one of them has more than twelve bits.
    pub fn new(number: u32, words: &'a [u16]) -> Self {
        let is_whole = words.iter().all(|&word| word <= LARGEST_COUNT);
        Self {
            number,
            first: 0,
            rest: if is_whole { words } else { &[] },
            packed: Packed::default(),
        }
    }

    /// How many words are still to come.
    pub const fn left(&self) -> usize {
        self.rest.len()
    }

    /// The next message, until there are no more words.
    pub fn next_message(&mut self) -> Option<Message<'_>> {
        let (words, rest) = self.rest.split_at(self.rest.len().min(COUNTS_A_PACKET));
        if words.is_empty() {
            return None;
        }
        let first = self.first;
        self.rest = rest;
        self.first = first.saturating_add(u16::try_from(words.len()).ok()?);
        self.packed = Packed::new(words.iter().copied());
        Some(Message::Words {
            number: self.number,
            first,
            words: self.packed.bytes(),
        })
    }
}

/// The most bytes in a part of a text.
pub const TEXT_PART: usize = 256;

/// The longest packet before COBS: words or counts, their length, the two numbers before them, the number of
/// the message, the sequence number and the CRC. The longest [`RowHead`], that of a comb, is shorter, and so
/// is the longest text.
pub const MAX_BODY: usize = PACKED + 2 + 5 + 3 + 1 + 3 + SUM;

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

    /// The memory of the packets, for other bytes while no packet is sent. The next packet overwrites them.
    pub const fn buffer(&mut self) -> &mut Vec<u8, MAX_PACKET> {
        &mut self.bytes
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
        let length = u8::try_from(group.len()).ok()?;
        to.push(length.checked_add(1)?).ok()?;
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum PacketError {
    /// A group of COBS ends too early: the beginning or the end is missing, or a byte is wrong.
    #[error("a packet is cut")]
    Cut,
    /// There are more bytes than in any packet.
    #[error("more bytes than in any packet")]
    TooLong,
    /// The CRC differs.
    #[error("a packet has a wrong checksum")]
    Checksum,
    /// The CRC is right, but this version of the library does not know the message.
    #[error("a packet of another version of the firmware")]
    Unknown,
}

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

#[cfg(test)]
mod tests {
    use super::*;

    /// For Miri, which takes too long for the properties in host-tests/tests/packets.rs.
    #[test]
    fn packets_are_read_as_they_are_written() {
        let words = Packed::new((0..COUNTS_A_PACKET as u16).map(|word| 16 * word));
        let messages = [
            Message::Text(b"rows 16\r\n"),
            Message::Text(&[0; TEXT_PART]),
            Message::Result(FrameResult {
                counter: 7,
                time_us: u64::MAX,
                is_difference: false,
                result: Err(Fault::LaserOff),
            }),
            Message::Words {
                number: 3,
                first: 256,
                words: words.bytes(),
            },
        ];
        let mut packets = Packets::default();
        let mut decoder = Decoder::new();
        for (sequence, message) in (0..).zip(messages) {
            let bytes = packets.encode(message).to_vec();
            let (end, start) = bytes.split_last().expect("bytes");
            assert!(start.iter().all(|&byte| decoder.take(byte).is_none()));
            assert_eq!(decoder.take(*end), Some(Ok(Packet { sequence, message })));
        }
    }
}
