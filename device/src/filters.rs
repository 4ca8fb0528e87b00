//! What happens to a reading before it becomes a line, as the settings say.
//!
//! ```text
//! frame's reading -> spike-filter -> average -> hold -> zero -> rate -> columns, units -> line
//! or fault                                                    -> limits -> switching output
//! ```
//!
//! `spike-filter` makes a fault of a reading that jumps. A fault passes all steps, and stays a fault. Only
//! `hold` gives a flagged reading in its place, and not in packets.

pub mod average;
pub mod zero;

use slitrange::base::fault::Fault;
use slitrange::base::units::Micrometres;
use slitrange::reading::Reading;

/// What the steps remember of the readings before.
#[derive(Clone, Debug, Default)]
pub struct Filters {
    /// The latest good readings.
    pub spikes: Spikes,
    /// The latest results of the average.
    pub average: average::Filter,
    /// The reading that may be held.
    pub hold: Hold,
    /// When the next line is due.
    pub rate: Rate,
    /// Whether the latest result switched the output of `limits` on.
    pub is_within: bool,
}

impl Filters {
    /// Forgets all readings. The switching output is off until the next one.
    pub fn clear(&mut self) {
        self.spikes = Spikes::default();
        self.average.clear();
        self.hold = Hold::default();
        self.is_within = false;
    }
}

/// The setting `spike-filter`: which readings are spikes.
///
/// A reading within the filter's distance of the last good one is good. Another one is withheld as
/// [`Fault::Spike`]. If three readings in succession are withheld, and no two of them are farther apart than
/// the filter's distance, the target has moved: the third one is good. Any other fault, and a good reading,
/// ends the succession.
///
/// The first reading is good. If it is a spike itself, three readings that agree put it right. A target that
/// always moves by more than the filter's distance from a frame to the next gives no readings.
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

/// What the filter for spikes remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spikes {
    /// The distance of the last good reading.
    good: Option<Micrometres>,
    /// The last two distances if they were withheld in succession, the older one first.
    withheld: [Option<Micrometres>; 2],
}

impl Spikes {
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
pub(crate) fn step(one: Micrometres, other: Micrometres) -> Micrometres {
    let bits = one.to_bits().saturating_sub(other.to_bits());
    Micrometres::from_bits(bits.saturating_abs())
}

/// What a line gives, by the setting `hold`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Held {
    /// The reading.
    pub reading: Reading,
    /// For how many results it has been held; 0 for the reading of this frame. The line has the flag `h` with
    /// this number.
    pub results: u16,
}

/// Remembers the last reading: `hold` gives it after a fault, for some results.
#[derive(Clone, Debug, Default)]
pub struct Hold {
    last: Option<Held>,
}

impl Hold {
    /// Takes a result. Instead of a fault it returns the last reading, for at most so many results in
    /// succession.
    pub fn take(&mut self, most: u16, result: Result<Reading, Fault>) -> Result<Held, Fault> {
        let held = match (result, self.last) {
            (Ok(reading), _) => Ok(Held {
                reading,
                results: 0,
            }),
            (Err(_), Some(held)) if held.results < most => Ok(Held {
                results: held.results.saturating_add(1),
                ..held
            }),
            (Err(fault), _) => Err(fault),
        };
        self.last = held.ok();
        held
    }
}

/// The setting `limits`: whether a distance lies within two limits, for a switching output.
///
/// The output switches on with a distance from the lower to the upper limit, both included. It switches off
/// with a distance beyond a limit by more than the hysteresis, and with a fault. So a distance that wanders
/// about a limit by less than the hysteresis does not make the output flutter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Limits {
    /// None: the output is off.
    #[default]
    Off,
    /// The output is on from one distance to another.
    Within {
        /// The lower limit.
        low: Micrometres,
        /// The upper limit, not below the lower one.
        high: Micrometres,
        /// How far beyond a limit the output stays on, not negative.
        hysteresis: Micrometres,
    },
}

impl Limits {
    /// The largest limit and, negative, the smallest one, in micrometres.
    pub const MOST_UM: u32 = 8_000_000;

    /// The largest hysteresis, in micrometres.
    pub const MOST_HYSTERESIS_UM: u32 = 1_000_000;

    /// Whether the output is on with this distance, or without one, after it was on or off.
    pub const fn is_on(self, was_on: bool, distance: Option<Micrometres>) -> bool {
        let (
            Self::Within {
                low,
                high,
                hysteresis,
            },
            Some(distance),
        ) = (self, distance)
        else {
            return false;
        };
        let distance = distance.to_bits();
        let beyond = if was_on { hysteresis.to_bits() } else { 0 };
        // A limit beyond what a distance can be is the last distance, which is not beyond the limit either.
        low.to_bits().saturating_sub(beyond) <= distance
            && distance <= high.to_bits().saturating_add(beyond)
    }
}

/// Remembers when the next line is due: the setting `rate` leaves lines out.
#[derive(Clone, Debug, Default)]
pub struct Rate {
    /// In microseconds since the start.
    due_us: u64,
}

impl Rate {
    /// Whether the line of a result at this time, in microseconds since the start, is sent: at most `rate`
    /// lines a second on average, or all if it is 0.
    pub fn is_due(&mut self, rate: u16, us: u64) -> bool {
        if rate == 0 {
            return true;
        }
        let period = 1_000_000 / u64::from(rate.max(1));
        let early = self.due_us.saturating_sub(us);
        // A line that is due later than in a period was planned for a lower `rate`.
        if early > 0 && early <= period {
            return false;
        }
        let late = us.saturating_sub(self.due_us);
        // A line waits for the end of a frame. The next one is not late by that, too.
        let is_late = early == 0 && late < period;
        let from = if is_late { self.due_us } else { us };
        self.due_us = from.saturating_add(period);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_output_switches_at_the_limits_and_beyond_the_hysteresis() {
        let um = Micrometres::from_int;
        let step =
            |distance: Micrometres, steps| Some(Micrometres::from_bits(distance.to_bits() + steps));
        let limits = Limits::Within {
            low: um(-1000),
            high: um(2000),
            hysteresis: um(50),
        };
        for (distance, from_off, from_on) in [
            (step(um(-1000), 0), true, true),
            (step(um(-1000), -1), false, true),
            (step(um(-1050), 0), false, true),
            (step(um(-1050), -1), false, false),
            (step(um(0), 0), true, true),
            (step(um(2000), 0), true, true),
            (step(um(2000), 1), false, true),
            (step(um(2050), 0), false, true),
            (step(um(2050), 1), false, false),
            (None, false, false),
        ] {
            assert_eq!(limits.is_on(false, distance), from_off, "{distance:?}");
            assert_eq!(limits.is_on(true, distance), from_on, "{distance:?}");
            assert!(!Limits::Off.is_on(true, distance));
        }
    }

    /// Frames of 16 rows come every 91.2 ms: of 1000, three lines a second are 273.6.
    #[test]
    fn the_mean_rate_is_kept_whatever_the_frames_period_is() {
        let frame_us = 91_200;
        for (rate, expected) in [
            (0, 1000),
            (1, 92),
            (3, 274),
            (10, 912),
            (11, 1000),
            (1000, 1000),
        ] {
            let mut state = Rate::default();
            let sent = (0..1000).filter(|frame| state.is_due(rate, frame * frame_us));
            assert_eq!(sent.count(), expected, "{rate}");
        }
    }

    /// Neither a pause nor another rate makes a burst of lines, or a long silence.
    #[test]
    fn a_pause_or_another_rate_takes_effect_at_once() {
        let mut state = Rate::default();
        assert!(state.is_due(1, 0) && !state.is_due(1, 999_999) && state.is_due(1, 1_000_000));
        assert!(state.is_due(10, 1_100_000) && !state.is_due(10, 1_199_999));
        assert!(state.is_due(10, 60_000_000) && !state.is_due(10, 60_050_000));
    }
}
