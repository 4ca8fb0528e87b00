//! A record and its bytes: one to compute with, the other to show, to compare and to keep.

use super::{MAX_ENCODED, Record, RecordError, encode};

/// A record with the bytes that it is written as.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EncodedRecord {
    record: Record,
    bytes: [u8; MAX_ENCODED],
    count: usize,
}

impl EncodedRecord {
    /// Writes a record.
    ///
    /// # Errors
    /// What [`encode`] says of it.
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

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.count).unwrap_or_default()
    }

    /// The CRC-32 that they end with.
    pub fn sum(&self) -> u32 {
        // A record has one.
        let sum = self.bytes().last_chunk().copied().unwrap_or_default();
        u32::from_le_bytes(sum)
    }
}
