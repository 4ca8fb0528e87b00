//! Pieces of a record, which is more than a line: each a line with a checksum of its own.
//!
//! `calibration data 32 00112233445566778899aabbccddeeff 1d0f` is the record's bytes from the 32nd on, up to [`PIECE`] of them in
//! hexadecimal digits, and the CRC-16 (IBM-3740) of the offset, two bytes little endian, and of the bytes.

use core::fmt;

use crc::{CRC_16_IBM_3740, Crc};

/// The most bytes in a piece: the line stays within [`MAX_LINE`](super::command::MAX_LINE).
pub const PIECE: usize = 16;

/// Without a table of its own: a piece is a few bytes.
const CRC: Crc<u16, crc::Table<0>> = Crc::<u16, crc::Table<0>>::new(&CRC_16_IBM_3740);

/// Some bytes of a record, and where they belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    offset: u16,
    bytes: [u8; PIECE],
    /// 1 to [`PIECE`].
    count: u8,
}

/// Why words are no piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PieceError {
    /// They are no number, bytes in pairs of hexadecimal digits, and a checksum of four.
    Form,
    /// The bytes are not those that were sent.
    Checksum {
        /// What was sent as their checksum.
        written: u16,
        /// What it is.
        computed: u16,
    },
}

impl Piece {
    /// The bytes from an offset on, if there are 1 to [`PIECE`] of them.
    pub fn new(offset: u16, bytes: &[u8]) -> Option<Self> {
        let count = u8::try_from(bytes.len()).ok().filter(|&count| count > 0)?;
        let mut piece = Self {
            offset,
            bytes: [0; PIECE],
            count,
        };
        piece.bytes.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(piece)
    }

    /// The piece that three words of a line stand for.
    ///
    /// # Errors
    /// [`PieceError`] says what they lack.
    pub fn parse(offset: &str, digits: &str, checksum: &str) -> Result<Self, PieceError> {
        let _ = (offset, digits, checksum);
        todo!()
    }

    /// Where its bytes belong in the record.
    pub const fn offset(&self) -> u16 {
        self.offset
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        self.bytes
            .get(..usize::from(self.count))
            .unwrap_or_default()
    }

    fn checksum(&self) -> u16 {
        let mut digest = CRC.digest();
        digest.update(&self.offset.to_le_bytes());
        digest.update(self.bytes());
        digest.finalize()
    }
}

impl fmt::Display for Piece {
    /// The line without its end.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "calibration data {} ", self.offset)?;
        for byte in self.bytes() {
            write!(f, "{byte:02x}")?;
        }
        write!(f, " {:04x}", self.checksum())
    }
}
