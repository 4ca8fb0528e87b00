//! The commands `zero` and `master`: distances relative to a reading.

use slitrange::base::units::Micrometres;
use slitrange::reading::Reading;

/// The reading that distances are relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Zero {
    /// The reading.
    pub reading: Reading,
    /// The distance that its place has: 0, or the value of `master`.
    pub value: Micrometres,
}

impl Zero {
    /// The largest [`Self::value`] and, negative, the smallest one, in micrometres: half of what
    /// [`Micrometres`] holds, so that a reading several metres away from the master is right, too.
    pub const MOST_UM: i32 = 4_000_000;

    /// A reading relative to this one. The value is exact, so the uncertainty is that of the difference. The
    /// distance saturates.
    pub fn relative(&self, now: &Reading) -> Reading {
        Reading {
            distance: self.distance(now.distance),
            ..now.relative_to(&self.reading)
        }
    }

    /// The distance of [`Self::relative`].
    pub fn distance(&self, now: Micrometres) -> Micrometres {
        let [zero, now] = [self.reading.distance, now].map(Micrometres::to_bits);
        let difference = now.saturating_sub(zero);
        Micrometres::from_bits(difference.saturating_add(self.value.to_bits()))
    }
}
