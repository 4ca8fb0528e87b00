//! The setting `limits`: whether a distance lies within two limits, for a switching output.
//!
//! The output switches on with a distance from the lower to the upper limit, both included. It switches off
//! with a distance beyond a limit by more than the hysteresis, and with a fault. So a distance that wanders
//! about a limit by less than the hysteresis does not make the output flutter.

use slitrange::base::units::Micrometres;

/// The limits.
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
}
