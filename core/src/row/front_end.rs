//! The front end, which is the amplifier and the converter between the sensor's pixels and the counts of a
//! row, as it was measured.
//!
//! `slitrange head measure` measures it by photon transfer: light of m counts above the black level has a
//! variance of
//!
//! ```text
//! v = read noise^2 + 1/12 + m / gain      (counts^2; J. R. Janesick, "Photon Transfer", SPIE 2007)
//! ```
//!
//! with the gain in electrons a count, and 1/12 for the rounding of the converter. The gain sets the
//! uncertainty that every reading claims.

use serde::{Deserialize, Serialize};

use crate::base::{Counts, Electrons};
use crate::row::{Geometry, LARGEST_COUNT, Polarity};

/// A measured value with its standard uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Estimate<T> {
    /// The value.
    pub value: T,
    /// Its standard uncertainty.
    pub u: T,
}

/// What was measured of a sensor's front end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrontEnd {
    /// What light does to a word.
    pub polarity: Polarity,
    /// The gain: electrons that make a count, [`LEAST_GAIN`] to [`LARGEST_GAIN`].
    pub gain: Estimate<Electrons>,
    /// Standard deviation of a pixel in the dark, without the rounding of the converter.
    pub read_noise: Estimate<Counts>,
    /// The count that light does not exceed, black level included; full scale if only the converter limits
    /// the light. `None` if the target was too dim to show it.
    pub saturation: Option<Estimate<Counts>>,
    /// The counts of an unlit pixel on that day. Only for people: each row has its own.
    pub black_level: Estimate<Counts>,
}

/// The smallest gain that can be used, in electrons a count: a geometry holds one over the gain in 16 bits.
pub const LEAST_GAIN: Electrons = Electrons::from_int(1);
/// The largest gain that can be used, in electrons a count: a well of four million electrons.
pub const LARGEST_GAIN: Electrons = Electrons::from_int(1000);
/// The read noise comes after the well, so a saturated pixel may read so many of its standard deviations
/// less.
const NOISE_BELOW_SATURATION: i32 = 4;

impl FrontEnd {
    /// The geometry of the sensor's driver, with what was measured in place of what the driver assumes.
    pub fn geometry(&self, of_driver: &Geometry) -> Geometry {
        // Electrons have 12 bits after the point: 2^16 / (bits / 2^12) = 2^28 / bits.
        let shot = (1u32 << 28).checked_div(self.gain.value.to_bits().unsigned_abs());
        let shot = shot.and_then(|shot| u16::try_from(shot).ok());
        Geometry {
            polarity: self.polarity,
            shot_variance_per_count_q16: shot.unwrap_or(u16::MAX),
            saturation: self.saturated_from(of_driver),
            ..of_driver.clone()
        }
    }

    fn saturated_from(&self, of_driver: &Geometry) -> u16 {
        let full_scale = Counts::from_int(of_driver.full_scale().into());
        match self.saturation {
            None => of_driver.saturation,
            Some(Estimate { value, .. }) if value >= full_scale => of_driver.full_scale(),
            Some(Estimate { value, .. }) => {
                let bits = self.below_noise(value).to_bits().max(0);
                u16::try_from(bits >> Counts::FRACTION).unwrap_or(u16::MAX)
            }
        }
    }

    /// A level less what the noise of a saturated pixel may take from it.
    fn below_noise(&self, level: Counts) -> Counts {
        let noise = self.read_noise.value.to_bits().max(0);
        let below = noise.saturating_mul(NOISE_BELOW_SATURATION);
        Counts::from_bits(level.to_bits().saturating_sub(below))
    }

    /// Whether all values and uncertainties are within their ranges.
    pub fn is_sensible(&self) -> bool {
        let largest = Counts::from_int(LARGEST_COUNT.into());
        let is_count = |it: &Estimate<Counts>| {
            let range = Counts::default()..=largest;
            range.contains(&it.value) && range.contains(&it.u)
        };
        let Self {
            polarity: _,
            gain,
            read_noise,
            saturation,
            black_level,
        } = self;
        (LEAST_GAIN..=LARGEST_GAIN).contains(&gain.value)
            && (Electrons::default()..=LARGEST_GAIN).contains(&gain.u)
            && is_count(read_noise)
            && is_count(black_level)
            && (saturation.as_ref()).is_none_or(|saturation| {
                // Otherwise an unlit pixel would count as saturated.
                is_count(saturation) && self.below_noise(saturation.value) > black_level.value
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::sensor_heads::tcd1304dg;
    use crate::tests::with;

    fn counts(value: f32, u: f32) -> Estimate<Counts> {
        let [value, u] = [value, u].map(Counts::from_f32);
        Estimate { value, u }
    }

    fn front_end() -> FrontEnd {
        let [value, u] = [8.0, 0.1].map(Electrons::from_f32);
        FrontEnd {
            polarity: Polarity::Falling,
            gain: Estimate { value, u },
            read_noise: counts(5.5, 0.1),
            saturation: Some(counts(2700.25, 0.5)),
            black_level: counts(320.0, 0.1),
        }
    }

    #[test]
    fn measured_values_replace_those_of_the_driver() {
        for polarity in [Polarity::Falling, Polarity::Rising] {
            let expected = Geometry {
                polarity,
                // One over 8, times 2^16.
                shot_variance_per_count_q16: 8192,
                // 2700.25 less four times 5.5.
                saturation: 2678,
                ..tcd1304dg()
            };
            let front_end = with(front_end(), |it| it.polarity = polarity);
            assert_eq!(front_end.geometry(&tcd1304dg()), expected);
        }
    }

    #[test]
    fn a_saturation_at_full_scale_or_unknown_is_that_of_the_driver() {
        let driver = tcd1304dg();
        for (saturation, expected) in [
            (None, driver.saturation),
            (Some(counts(4095.0, 0.0)), 4095),
            // Noise of the converter may lie above a well that is nearly at full scale.
            (Some(counts(4094.0, 0.5)), 4072),
            (Some(counts(0.0, 0.0)), 0),
        ] {
            let front_end = with(front_end(), |it| it.saturation = saturation);
            assert_eq!(front_end.geometry(&driver).saturated_from(), expected);
        }
    }

    /// For every gain: one over the gain, to a step of Q0.16.
    #[test]
    fn the_shot_noise_is_one_over_the_gain() {
        for gain in [1.0, 1.5, 3.0, 10.0, 99.0, 1000.0] {
            let mut front_end = front_end();
            front_end.gain.value = Electrons::from_f32(gain);
            assert!(front_end.is_sensible());
            let shot = front_end.geometry(&tcd1304dg()).shot_variance_per_count_q16;
            let expected = (65_536.0 / f64::from(gain)).min(65_535.0);
            assert!((f64::from(shot) - expected).abs() <= 1.0, "{gain}: {shot}");
        }
    }

    #[test]
    fn values_out_of_range_are_not_sensible() {
        assert!(front_end().is_sensible());
        let changes: [fn(&mut FrontEnd); 11] = [
            |it| it.gain.value = Electrons::from_f32(0.99),
            |it| it.gain.value = Electrons::from_int(1001),
            |it| it.gain.u = Electrons::from_bits(-1),
            |it| it.read_noise.value = Counts::from_bits(-1),
            |it| it.read_noise.u = Counts::from_int(4096),
            |it| it.black_level.value = Counts::from_int(4096),
            |it| it.black_level.u = Counts::MIN,
            |it| it.saturation = Some(counts(4096.0, 1.0)),
            // Below the black level.
            |it| it.saturation = Some(counts(320.0, 1.0)),
            // Four times the read noise below it lies the black level.
            |it| it.saturation = Some(counts(342.0, 1.0)),
            |it| it.read_noise = counts(600.0, 1.0),
        ];
        for change in changes {
            let mut wrong = front_end();
            change(&mut wrong);
            assert!(!wrong.is_sensible(), "{wrong:?}");
            // Any geometry that follows is usable all the same.
            let geometry = wrong.geometry(&tcd1304dg());
            assert!(geometry.saturated_from() <= geometry.full_scale());
        }
    }
}
