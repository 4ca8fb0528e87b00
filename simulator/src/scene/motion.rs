//! The target moves.

use serde::{Deserialize, Serialize};

/// A target that moves along the laser at a steady speed: its distance changes from row to row, and during an
/// exposure.
///
/// The distance that a scene's row is asked for is that at the middle of the first row's exposure; later rows
/// see the target where it has got to by the middle of their own exposure, which is also what an estimate is
/// to be compared with ([`crate::scene::Simulation::true_distance`]). Light of the whole exposure adds up,
/// and smears the spot: over a displacement of v T on the sensor the variance grows by (v T)^2 / 12. The
/// speckle is that of the exposure's middle: it does not change while the sensor looks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Metres a second, away from the sensor.
    pub speed: f64,
}

impl Motion {
    /// Distance in metres after a time in seconds.
    pub fn distance(&self, distance: f64, time: f64) -> f64 {
        distance + self.speed * time
    }

    /// Short exposures that together are the long one, for a spot that moves by so many sigma during it.
    ///
    /// The mean over n of them at their middles is off by (moved / n)^2 / 24 of the peak times the mean of
    /// the profile's second derivative, which is at most 1: 1e-4 where each moves by less than a twentieth of
    /// a sigma. A spot that crosses thousands of its widths is a faint stripe, and needs no more than 100,000
    /// of them.
    pub fn steps(moved: f64) -> u32 {
        (20.0 * moved.abs()).ceil().clamp(1.0, 1e5) as u32
    }

    /// The distances in the middles of `steps` short exposures, where the long one lasts `exposure` seconds
    /// and has `distance` in its middle.
    pub fn distances(
        self,
        distance: f64,
        exposure: f64,
        steps: u32,
    ) -> impl ExactSizeIterator<Item = f64> {
        let way = self.speed * exposure;
        (0..steps)
            .map(move |step| distance + way * ((f64::from(step) + 0.5) / f64::from(steps) - 0.5))
    }
}
