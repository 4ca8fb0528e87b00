//! Uploads a calibration's record over the serial line in pieces. The record is used when all of it has come,
//! or not at all.
//!
//! ```text
//! calibration begin 47
//! calibration data 0 0100010101ee1c121f22e21c010c9a33 9559      a piece a line, in order
//! ...
//! calibration commit
//! ```
//!
//! The sensor answers each line. A piece whose answer was lost may be sent again.

use super::piece::Piece;
use super::refusal::Refusal;
use crate::record::{MAX_ENCODED, Record, decode};
use slitrange::row::Geometry;

/// A step of an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Begins the upload of a record of so many bytes, 1 to [`MAX_ENCODED`].
    Begin(u16),
    /// Adds some of the bytes.
    Piece(Piece),
    /// Ends the upload: the record is to be used.
    Commit,
    /// Drops the upload.
    Abort,
}

/// An upload that is under way, or none.
#[derive(Clone, Debug)]
pub struct Upload {
    bytes: [u8; MAX_ENCODED],
    /// How many bytes have come, from the first on.
    came: usize,
    /// How many bytes the record has; 0 if no upload is under way.
    announced: usize,
}

impl Upload {
    /// No upload is under way.
    pub const fn none() -> Self {
        Self {
            bytes: [0; MAX_ENCODED],
            came: 0,
            announced: 0,
        }
    }

    /// Takes a step. If the step completes a record, that one replaces `record`, and the result is true. A
    /// record has 3 KB, so it does not go through the result.
    ///
    /// # Errors
    /// [`Refusal`] says why the step cannot be taken. An upload that lacks pieces, or got a wrong one, goes
    /// on as if that step had not come. An upload whose record is refused is over.
    pub fn take(
        &mut self,
        step: Step,
        sensor: &Geometry,
        record: &mut Option<Record>,
    ) -> Result<bool, Refusal> {
        match step {
            // Drops the one before.
            Step::Begin(bytes) => {
                self.came = 0;
                self.announced = usize::from(bytes);
            }
            Step::Piece(piece) => self.add(&piece)?,
            Step::Commit => self.commit(sensor, record)?,
            Step::Abort => self.announced = 0,
        }
        Ok(step == Step::Commit)
    }

    fn add(&mut self, piece: &Piece) -> Result<(), Refusal> {
        let (expected, announced) = (self.came, self.announced);
        if announced == 0 {
            return Err(Refusal::NoUpload);
        }
        let offset = usize::from(piece.offset());
        let end = offset.saturating_add(piece.bytes().len());
        if end > announced {
            return Err(Refusal::TooLong { end, announced });
        }
        let wrong = Refusal::WrongOffset { offset, expected };
        let place = self.bytes.get_mut(offset..end).ok_or(wrong)?;
        if offset == self.came {
            place.copy_from_slice(piece.bytes());
            self.came = end;
            Ok(())
        } else if end == self.came && place == piece.bytes() {
            // The latest piece again.
            Ok(())
        } else {
            Err(wrong)
        }
    }

    fn commit(&mut self, sensor: &Geometry, record: &mut Option<Record>) -> Result<(), Refusal> {
        let (came, announced) = (self.came, self.announced);
        if announced == 0 {
            return Err(Refusal::NoUpload);
        }
        if came < announced {
            return Err(Refusal::Incomplete { came, announced });
        }
        self.announced = 0;
        let bytes = self.bytes.get(..self.came).unwrap_or_default();
        let decoded = decode(bytes).map_err(Refusal::Record)?;
        if !decoded.geometry.is_compatible_with(sensor) {
            return Err(Refusal::OtherSensor);
        }
        *record = Some(decoded);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::piece::PIECE;
    use crate::record::RecordError;
    use crate::record::encoded::EncodedRecord;
    use slitrange::distance::eq1::NOMINAL;
    use slitrange::distance::knots::{Knot, MAX_KNOTS};
    use slitrange::distance::residuals::Corrected;
    use slitrange::frame::comb::Comb;
    use slitrange::row::sensor_heads::tcd1304dg;
    use slitrange::{Calibration, CalibrationErrors, Micrometres, Pixels, Polarity};

    /// A record of several pieces, the last of which is shorter.
    fn nominal() -> EncodedRecord {
        EncodedRecord::nominal().expect("a record")
    }

    /// A record with as many knots and slits as there may be.
    fn long() -> EncodedRecord {
        let knot = |i: i32| Knot {
            centre: Pixels::from_bits(78_053_377 + 744_002 * i),
            value: Micrometres::from_bits(-50_000 + 782 * i),
        };
        let knots: Vec<Knot> = (0..MAX_KNOTS as i32).map(knot).collect();
        let corrected = Corrected::new(NOMINAL.expect("a curve"), &knots).expect("usable");
        let mut record = Record::nominal().expect("a record");
        record.calibration = Calibration::Corrected(corrected);
        record.errors = CalibrationErrors::Unknown;
        record.comb = Some(Comb::nominal());
        EncodedRecord::new(record).expect("a record")
    }

    fn pieces(bytes: &[u8]) -> impl Iterator<Item = Piece> {
        let offsets = (0..bytes.len()).step_by(PIECE);
        offsets.map(|offset| Piece::of(bytes, offset as u16).expect("a piece"))
    }

    /// Takes a step that completes nothing.
    fn go(upload: &mut Upload, step: Step) {
        assert_eq!(taken(upload, step, &tcd1304dg()), Ok(None), "{step:?}");
    }

    fn refused(upload: &mut Upload, step: Step) -> Refusal {
        taken(upload, step, &tcd1304dg()).expect_err("a refusal")
    }

    /// What a sensor does with a step: the record that it completes.
    fn taken(
        upload: &mut Upload,
        step: Step,
        sensor: &Geometry,
    ) -> Result<Option<Record>, Refusal> {
        let mut record = None;
        let is_whole = upload.take(step, sensor, &mut record)?;
        assert_eq!(record.is_some(), is_whole);
        Ok(record)
    }

    /// Takes all steps of an upload but the last, some of them several times: an answer may be lost.
    fn send(upload: &mut Upload, bytes: &[u8]) {
        for _ in 0..2 {
            go(upload, Step::Begin(bytes.len() as u16));
        }
        for piece in pieces(bytes) {
            for _ in 0..3 {
                go(upload, Step::Piece(piece));
            }
        }
    }

    fn commit(upload: &mut Upload) -> Record {
        let taken = taken(upload, Step::Commit, &tcd1304dg());
        taken.expect("no refusal").expect("a record")
    }

    #[test]
    fn the_record_that_is_sent_is_the_one_that_comes() {
        let mut upload = Upload::none();
        for written in [nominal(), long(), nominal()] {
            println!("{} bytes", written.bytes().len());
            send(&mut upload, written.bytes());
            assert_eq!(commit(&mut upload), *written.record());
            assert_eq!(refused(&mut upload, Step::Commit), Refusal::NoUpload);
        }
    }

    #[test]
    fn a_piece_that_is_not_the_next_one_is_refused_and_changes_nothing() {
        let written = nominal();
        let all: Vec<Piece> = pieces(written.bytes()).collect();
        let mut upload = Upload::none();
        go(&mut upload, Step::Begin(written.bytes().len() as u16));
        for (index, &piece) in all.iter().enumerate() {
            for &other in &all {
                let (offset, expected) = (usize::from(other.offset()), PIECE * index);
                // The next one, and the one before again.
                if offset == expected || offset + PIECE == expected {
                    continue;
                }
                let wrong = Refusal::WrongOffset { offset, expected };
                assert_eq!(refused(&mut upload, Step::Piece(other)), wrong);
            }
            go(&mut upload, Step::Piece(piece));
            // A piece with the latest one's offset and other bytes.
            let bytes: Vec<u8> = piece.bytes().iter().map(|byte| !byte).collect();
            let other = Piece::new(piece.offset(), &bytes).expect("a piece");
            let offset = usize::from(piece.offset());
            let expected = offset + bytes.len();
            let wrong = Refusal::WrongOffset { offset, expected };
            assert_eq!(refused(&mut upload, Step::Piece(other)), wrong);
        }
        assert_eq!(commit(&mut upload), *written.record());
    }

    #[test]
    fn an_upload_goes_on_after_a_refusal_and_not_beyond_its_announced_length() {
        let written = nominal();
        let announced = written.bytes().len();
        let mut upload = Upload::none();
        go(&mut upload, Step::Begin(announced as u16));
        for (piece, came) in pieces(written.bytes()).zip((0..).step_by(PIECE)) {
            let incomplete = Refusal::Incomplete { came, announced };
            assert_eq!(refused(&mut upload, Step::Commit), incomplete);
            for offset in [came, u16::MAX.into()] {
                let beyond = Piece::new(offset as u16, &[0; PIECE]).expect("a piece");
                let end = offset + PIECE;
                if end > announced {
                    let long = Refusal::TooLong { end, announced };
                    assert_eq!(refused(&mut upload, Step::Piece(beyond)), long);
                }
            }
            go(&mut upload, Step::Piece(piece));
        }
        assert_eq!(commit(&mut upload), *written.record());
    }

    #[test]
    fn a_record_that_is_damaged_or_of_another_sensor_is_refused_and_ends_the_upload() {
        let written = nominal();
        let whole = written.bytes();
        let mut damaged = whole.to_vec();
        damaged[7] ^= 1;
        let checksum = decode(&damaged).expect_err("another checksum");
        let is_checksum = matches!(checksum, RecordError::Checksum { .. });
        assert!(is_checksum, "{checksum}");
        let short = RecordError::Short { bytes: 3 };
        let mut other = tcd1304dg();
        other.polarity = Polarity::Rising;
        // A better estimate of the sensor's noise leaves its calibration as it is.
        let mut noisier = tcd1304dg();
        noisier.shot_variance_per_count_q16 = 1;
        let mut upload = Upload::none();
        for (bytes, sensor, refusal) in [
            (&damaged[..], tcd1304dg(), Some(Refusal::Record(checksum))),
            (&whole[..3], tcd1304dg(), Some(Refusal::Record(short))),
            (whole, other, Some(Refusal::OtherSensor)),
            (whole, tcd1304dg(), None),
            (whole, noisier, None),
        ] {
            send(&mut upload, bytes);
            let expected = refusal.map_or_else(|| Ok(Some(written.record().clone())), Err);
            assert_eq!(taken(&mut upload, Step::Commit, &sensor), expected);
            assert_eq!(refused(&mut upload, Step::Commit), Refusal::NoUpload);
        }
    }
}
