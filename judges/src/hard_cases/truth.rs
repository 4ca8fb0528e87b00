//! What a perfect reader would say of a row, and how good an answer has to be.

use std::fmt;

/// Where the spot of a row is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Truth {
    /// Here, in pixels.
    Centre(f64),
    /// A spot that is not symmetric has no one centre: its peak, its centroid, and all between are as good.
    Between(f64, f64),
    /// There is no spot, or no way to tell which of two is the laser's: any centre is wrong.
    None,
}

impl fmt::Display for Truth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Centre(centre) => write!(f, "the centre is at {centre:.3} px"),
            Self::Between(low, high) => {
                write!(f, "the centre is anywhere from {low:.3} to {high:.3} px")
            }
            Self::None => f.write_str("no centre is right"),
        }
    }
}

impl Truth {
    /// The same, as far as another place that is as good.
    pub fn reaching(self, place: f64) -> Self {
        let (low, high) = match self {
            Self::None => return Self::None,
            Self::Centre(centre) => (centre, centre),
            Self::Between(low, high) => (low, high),
        };
        let (low, high) = (low.min(place), high.max(place));
        if low == high {
            Self::Centre(low)
        } else {
            Self::Between(low, high)
        }
    }

    /// How far a centre is from it in pixels: infinitely, where any is wrong.
    pub fn error(self, centre: f64) -> f64 {
        match self {
            Self::Centre(truth) => centre - truth,
            Self::Between(low, high) => centre - centre.clamp(low, high),
            Self::None => f64::INFINITY,
        }
    }
}

/// A centre is off confidently where it is further off than so many claimed standard uncertainties ...
pub const CLAIMS: f64 = 5.0;
/// ... and this many pixels, without a flag.
pub const SLACK: f64 = 0.05;

/// Whether a centre is further off than its claimed standard uncertainty allows, all in pixels.
pub fn is_beyond_claim(error: f64, uncertainty: f64) -> bool {
    error.abs() > CLAIMS * uncertainty + SLACK
}
