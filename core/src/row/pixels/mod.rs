//! How a sensor's pixels differ: a response and an offset of their own, which stay.
//!
//! The rows of a frame share these errors, so more rows do not reduce what they do to a centre. A [`map`] of
//! the pixels, taken once, corrects them.

pub mod flat_field;
pub mod map;
pub mod scatter;

use serde::{Deserialize, Serialize};

use crate::base::Counts;

/// How far pixels differ from each other, as standard deviations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PixelErrors {
    /// Of the response to light over its mean, Q0.16: 656 is 1 %.
    pub response_q16: u16,
    /// Of the count of an unlit pixel.
    pub offset: Counts,
}

impl PixelErrors {
    /// What the data sheet of the TCD1304DG allows.
    ///
    /// Response: at most 10 % from the mean. The largest of 3648 normal deviations is 3.6 standard deviations
    /// on average, so the standard deviation is 2.8 %.
    ///
    /// Offset: a dark signal of at most 5 mV in 10 ms, which is 2.85 mV or 19.5 counts in a row period of 5.7
    /// ms. If the largest of the pixels has that signal, the standard deviation is 5.4 counts.
    pub const TCD1304DG: Self = Self {
        response_q16: 1835,
        offset: Counts::from_bits(1382),
    };
}
