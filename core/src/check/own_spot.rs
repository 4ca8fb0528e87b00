//! The sensor's own spot: what its optics do to every spot, as a calibration learned it.
//!
//! A laser's skewed beam or a scratch in the slit makes every spot lopsided in the same way. That is no error
//! once the sensor is calibrated: the curve holds it. So the check compares a row's antisymmetric light with
//! that of the sensor's own spot, and only the rest counts as a flaw.
//!
//! The width tells of flaws too. A wide shadow moves a spot, and leaves it symmetric but narrower.

use serde::{Deserialize, Serialize};

use crate::base::places::{PLACES, place_at};
use crate::base::{Pixels, numeric};
use crate::centre::spot_shape::{COMPONENTS, OwnSpot};

/// The sensor's own spot at [`PLACES`] centres, evenly from the first to the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Profile {
    /// The first centre.
    pub first: Pixels,
    /// The last centre.
    pub last: Pixels,
    /// The spot's width.
    pub width: [Pixels; PLACES],
    /// How far the widths of spots without a flaw differ from that, as a standard deviation.
    pub width_deviation: Pixels,
    /// The components of the antisymmetric light, each at all places: see
    /// [`SpotShape::components`](crate::centre::spot_shape::SpotShape::components).
    pub components: [[Pixels; PLACES]; COMPONENTS],
    /// How far the components of spots without a flaw differ from that beyond noise, as a standard deviation.
    pub deviation: Pixels,
}

impl Profile {
    /// Interpolates linearly. Beyond the range the spot is that of its end.
    pub fn at(&self, centre: Pixels) -> OwnSpot {
        let from_first =
            |it: Pixels| i64::from(it.to_bits()).saturating_sub(self.first.to_bits().into());
        // Q16. An empty range is that of its first centre.
        let along = numeric::shifted(from_first(centre), 16).checked_div(from_first(self.last));
        let (index, part) = place_at(numeric::saturated(along.unwrap_or_default()));
        let between = |values: &[Pixels; PLACES]| match values.get(index..) {
            Some([from, to, ..]) => {
                let rise = i64::from(to.to_bits()).saturating_sub(from.to_bits().into());
                let part = rise.saturating_mul(part.into()) >> 16;
                Pixels::from_bits(numeric::saturated(
                    part.saturating_add(from.to_bits().into()),
                ))
            }
            _ => Pixels::default(),
        };
        OwnSpot {
            width: between(&self.width),
            width_deviation: self.width_deviation,
            components: self.components.each_ref().map(between),
            deviation: self.deviation,
        }
    }

    /// Whether the widths are above zero, and no deviation is below.
    pub fn is_sensible(&self) -> bool {
        self.width.iter().all(|width| width.to_bits() > 0)
            && self.width_deviation.to_bits() >= 0
            && self.deviation.to_bits() >= 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_own_spot_is_interpolated_and_ends_with_its_range() {
        let rising =
            |from: i32| core::array::from_fn(|place| Pixels::from_int(from + place as i32));
        let mut components = [[Pixels::default(); PLACES]; COMPONENTS];
        components[2] = rising(-4);
        let profile = Profile {
            first: Pixels::from_int(1000),
            last: Pixels::from_int(1800),
            width: rising(7),
            width_deviation: Pixels::from_f32(0.25),
            components,
            deviation: Pixels::from_f32(0.5),
        };
        for (centre, width) in [
            (0, 7.0),
            (1000, 7.0),
            (1250, 9.5),
            (1799, 14.99),
            (1800, 15.0),
            (3000, 15.0),
        ] {
            let own = profile.at(Pixels::from_int(centre));
            assert!(
                (own.width.to_f32() - width).abs() < 1e-4,
                "{centre}: {own:?}"
            );
            assert_eq!(own.components[2], own.width.moved_by(-11));
            let deviations = (own.width_deviation, own.deviation);
            assert_eq!(deviations, (profile.width_deviation, profile.deviation));
        }
        let last = profile.first;
        let empty = Profile { last, ..profile };
        assert_eq!(empty.at(Pixels::from_int(1000)).width, Pixels::from_int(7));
        assert!(profile.is_sensible());
        let spoil: [fn(&mut Profile); 3] = [
            |it| it.width[0] = Pixels::default(),
            |it| it.width_deviation = Pixels::from_bits(-1),
            |it| it.deviation = Pixels::from_bits(-1),
        ];
        for spoil in spoil {
            let mut spoilt = profile;
            spoil(&mut spoilt);
            assert!(!spoilt.is_sensible(), "{spoilt:?}");
        }
    }
}
