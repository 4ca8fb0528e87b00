//! The times during which a row collects light.

/// The times during which a row collects light and dark current, in seconds.
///
/// The sensor collects ambient light and dark current during the whole row, from shift pulse to shift pulse.
/// It collects the laser's light only while the laser is on. The pulse is in the middle of the row. A number
/// in place of an exposure is the one of a laser that is always on: all three times are equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// From shift pulse to shift pulse: ambient light and dark current.
    pub row: f64,
    /// While the laser was on within the row. 0 for a row without the laser's light.
    pub laser: f64,
    /// While the laser was on in the row before: [`crate::scene::Lag`] keeps some of that light.
    pub laser_before: f64,
}

impl From<f64> for Exposure {
    fn from(seconds: f64) -> Self {
        Self {
            row: seconds,
            laser: seconds,
            laser_before: seconds,
        }
    }
}
