//! A record with its bytes: the record to compute with, the bytes to send, to compare and to store.

use super::{MAX_ENCODED, Record, RecordError, encode, sum_of};

/// A record with its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EncodedRecord {
    record: Record,
    bytes: [u8; MAX_ENCODED],
    count: usize,
}

impl EncodedRecord {
    /// Encodes a record.
    ///
    /// # Errors
    /// The error with which [`encode`] refuses the record.
    pub fn new(record: Record) -> Result<Self, RecordError> {
        let mut bytes = [0; MAX_ENCODED];
        let count = encode(&record, &mut bytes)?.len();
        Ok(Self {
            record,
            bytes,
            count,
        })
    }

    /// The nominal calibration's record.
    pub fn nominal() -> Option<Self> {
        Self::new(Record::nominal()?).ok()
    }

    /// The record.
    pub const fn record(&self) -> &Record {
        &self.record
    }

    /// The record's bytes.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.count).unwrap_or_default()
    }

    /// The CRC-32 at the end of the bytes.
    pub fn sum(&self) -> u32 {
        sum_of(self.bytes())
    }
}
