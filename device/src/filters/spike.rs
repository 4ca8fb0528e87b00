//! The setting `spike-filter`: a reading that jumps away is a fault until readings agree on the new place.
//!
//! A reading within the filter's distance of the last good one is good. Another one is withheld as
//! [`Fault::Spike`]. If three readings in succession are withheld, and no two of them are farther apart than
//! the filter's distance, the target has moved: the third one is good. Any other fault, and a good reading,
//! ends the succession.
//!
//! The first reading is good. If it is a spike itself, three readings that agree put it right. A target that
//! always moves by more than the filter's distance from a frame to the next gives no readings.

use slitrange::{Fault, Micrometres, Reading};

/// Which readings are spikes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpikeFilter {
    /// None.
    #[default]
    Off,
    /// Those farther from the last good reading than this.
    Beyond(Micrometres),
}

impl SpikeFilter {
    /// The largest distance of the filter, in micrometres.
    pub const MOST_UM: u32 = 100_000;
}

/// What the filter remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spikes {
    /// The distance of the last good reading.
    good: Option<Micrometres>,
    /// The last two distances if they were withheld in succession, the older one first.
    withheld: [Option<Micrometres>; 2],
}

impl Spikes {
    /// Forgets all readings.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Takes a result. Returns it, or [`Fault::Spike`] in place of a reading that jumped away.
    pub fn take(
        &mut self,
        filter: SpikeFilter,
        result: Result<Reading, Fault>,
    ) -> Result<Reading, Fault> {
        let [older, newer] = core::mem::take(&mut self.withheld);
        let SpikeFilter::Beyond(most) = filter else {
            self.good = None;
            return result;
        };
        let reading = result?;
        let now = reading.distance;
        let agree = |one: Micrometres, other: Micrometres| step(one, other) <= most;
        let have_moved = match (older, newer) {
            (Some(older), Some(newer)) => {
                agree(older, newer) && agree(older, now) && agree(newer, now)
            }
            _ => false,
        };
        match self.good {
            Some(good) if !agree(good, now) && !have_moved => {
                self.withheld = [newer, Some(now)];
                Err(Fault::Spike {
                    step: step(good, now),
                })
            }
            _ => {
                self.good = Some(now);
                Ok(reading)
            }
        }
    }
}

/// How far two distances are apart. Saturates.
fn step(one: Micrometres, other: Micrometres) -> Micrometres {
    let bits = one.to_bits().saturating_sub(other.to_bits());
    Micrometres::from_bits(bits.saturating_abs())
}
