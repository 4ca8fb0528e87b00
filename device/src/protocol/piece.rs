//! Pieces of a record. A record is longer than a line, so each piece is a line with a checksum of its own.
//!
//! `calibration data 32 00112233445566778899aabbccddeeff a23c` holds the record's bytes from offset 32 on:
//! up to [`PIECE`] bytes in hexadecimal digits, and a CRC-16 (IBM-3740). The CRC is that of the offset, two
//! bytes little endian, and of the bytes.

use core::fmt;

use crc::{CRC_16_IBM_3740, Crc};

/// The most bytes in a piece: the line stays within [`MAX_LINE`](super::command::MAX_LINE).
pub const PIECE: usize = 16;

/// The checksum of pieces, and of the lines of a row. Computed without a table: they are a few bytes.
pub(super) const CRC: Crc<u16, crc::Table<0>> = Crc::<u16, crc::Table<0>>::new(&CRC_16_IBM_3740);

/// Some bytes of a record, and where they belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    offset: u16,
    bytes: [u8; PIECE],
    /// 1 to [`PIECE`].
    count: u8,
}

/// Why words are not a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PieceError {
    /// They are not a number, bytes in pairs of hexadecimal digits, and a checksum of four digits.
    Form,
    /// The bytes are not those that were sent.
    Checksum {
        /// The checksum that was sent.
        written: u16,
        /// The checksum of what came.
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

    /// Reads a piece from three words of a line.
    ///
    /// # Errors
    /// [`PieceError`] says what is wrong with them.
    pub fn parse(offset: &str, digits: &str, checksum: &str) -> Result<Self, PieceError> {
        let (pairs, rest) = digits.as_bytes().as_chunks();
        let ([high, low], []) = checksum.as_bytes().as_chunks() else {
            return Err(PieceError::Form);
        };
        if !rest.is_empty() || !offset.bytes().all(|digit| digit.is_ascii_digit()) {
            return Err(PieceError::Form);
        }
        let mut bytes = [0; PIECE];
        let places = bytes.get_mut(..pairs.len()).ok_or(PieceError::Form)?;
        for (place, pair) in places.iter_mut().zip(pairs) {
            *place = byte(pair).ok_or(PieceError::Form)?;
        }
        let offset = offset.parse().map_err(|_| PieceError::Form)?;
        let piece = Self::new(offset, places).ok_or(PieceError::Form)?;
        let (high, low) = byte(high).zip(byte(low)).ok_or(PieceError::Form)?;
        let (written, computed) = (u16::from_be_bytes([high, low]), piece.checksum());
        if written != computed {
            return Err(PieceError::Checksum { written, computed });
        }
        Ok(piece)
    }

    /// The piece of a record that begins at an offset. `None` if the record has no byte there.
    pub fn of(record: &[u8], offset: u16) -> Option<Self> {
        let rest = record.get(usize::from(offset)..)?;
        Self::new(offset, rest.get(..PIECE).unwrap_or(rest))
    }

    /// The offset of its bytes in the record.
    pub const fn offset(&self) -> u16 {
        self.offset
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        let count = usize::from(self.count);
        self.bytes.get(..count).unwrap_or_default()
    }

    fn checksum(&self) -> u16 {
        let mut digest = CRC.digest();
        digest.update(&self.offset.to_le_bytes());
        digest.update(self.bytes());
        digest.finalize()
    }
}

/// The byte that two hexadecimal digits stand for.
fn byte(digits: &[u8; 2]) -> Option<u8> {
    let [high, low] = digits.map(|digit| char::from(digit).to_digit(16));
    // Both are below 16.
    u8::try_from(high?.saturating_mul(16).saturating_add(low?)).ok()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::command::{Command, Error, MAX_LINE, parse};
    use crate::protocol::upload::Step;

    #[test]
    fn a_piece_is_as_documented() {
        let bytes: [u8; PIECE] = core::array::from_fn(|i| 0x11 * i as u8);
        for (offset, bytes, line) in [
            (
                32,
                &bytes[..],
                "calibration data 32 00112233445566778899aabbccddeeff a23c",
            ),
            // The sum's check value from its catalogue: that of "123456789", whose first two bytes are the
            // offset here.
            (
                u16::from_le_bytes(*b"12"),
                b"3456789",
                "calibration data 12849 33343536373839 29b1",
            ),
        ] {
            let piece = Piece::new(offset, bytes).expect("a piece");
            assert_eq!(piece.to_string(), line);
        }
        let longest = Piece::new(u16::MAX, &bytes).expect("a piece").to_string();
        assert!(longest.len() <= MAX_LINE, "{longest}");
    }

    #[test]
    fn pieces_of_a_record_are_all_of_it() {
        let record: Vec<u8> = (0..=99).collect();
        let mut read = Vec::new();
        while let Some(piece) = Piece::of(&record, read.len() as u16) {
            read.extend_from_slice(piece.bytes());
        }
        assert_eq!(read, record);
        assert_eq!(Piece::of(&record, 100), None);
        assert_eq!(Piece::of(&record, 101), None);
        assert_eq!(Piece::of(&[], 0), None);
        assert_eq!(Piece::new(0, &[0; PIECE + 1]), None);
    }

    #[test]
    fn words_that_are_no_piece_are_refused() {
        for (offset, digits, checksum) in [
            ("", "00", "0000"),
            ("+1", "00", "0000"),
            ("65536", "00", "0000"),
            ("0", "", "0000"),
            ("0", "0", "0000"),
            ("0", "+0", "0000"),
            ("0", "0g", "0000"),
            ("0", "000102030405060708090a0b0c0d0e0f10", "0000"),
            ("0", "00", "+000"),
            ("0", "00", "000"),
            ("0", "00", "00000"),
            ("0", "00", "000000"),
            ("0", "00", ""),
        ] {
            let found = Piece::parse(offset, digits, checksum);
            assert_eq!(found, Err(PieceError::Form), "{offset} {digits} {checksum}");
        }
    }

    /// Replaces every character by every other. A sum of 16 bits detects every change within 16 bits in a
    /// row, and so a change of the offset or of a digit.
    #[test]
    fn a_character_that_is_garbled_is_noticed() {
        /// One character in so many is tried: Miri is slow.
        const STRIDE: usize = if cfg!(miri) { 197 } else { 1 };

        let bytes = [7, 0, 255, 128, 1, 9, 0x5c, 0xa3, 77, 3, 250, 0, 0, 0, 0, 1];
        let pieces = [
            (0, 16),
            (32, 16),
            (9, 1),
            (1360, 1),
            (1111, 7),
            (65_535, 16),
        ];
        for &(offset, count) in &pieces[..if cfg!(miri) { 1 } else { 6 }] {
            let piece = Piece::new(offset, &bytes[..count]).expect("a piece");
            let line = piece.to_string();
            let same = Ok(Command::Upload(Step::Piece(piece)));
            assert_eq!(parse(line.as_bytes()), same, "{line}");
            let mut refused = 0;
            for at in 0..line.len() {
                for character in (0..=255).step_by(STRIDE) {
                    let mut garbled = line.clone().into_bytes();
                    garbled[at] = character;
                    match parse(&garbled) {
                        Err(Error::TooLong | Error::Value(..) | Error::Row(_)) => {
                            panic!("another error: {}", garbled.escape_ascii())
                        }
                        Err(_) => refused += 1,
                        other => assert_eq!(other, same, "{}", garbled.escape_ascii()),
                    }
                }
            }
            // All but the character itself, a digit's other case, and a blank's other form.
            let are_all = refused >= line.len() * 253;
            assert!(cfg!(miri) || are_all, "{line}: {refused}");
        }
    }
}
