//! The light of the rows to come, which measuring orders of acquisition.

use core::sync::atomic::{AtomicU32, Ordering};

use slitrange::base::exposure::Exposure;
use slitrange::light::ambient::AmbientMode;

/// For how long the laser is to be on in the rows to come. It is off until the settings are known.
pub static LASER: LaserOrder = LaserOrder(AtomicU32::new(0));

/// See [`LASER`]. Microseconds, or 0 if the laser is off; [`LaserOrder::EVERY_SECOND_ROW`] may be added.
pub struct LaserOrder(AtomicU32);

impl LaserOrder {
    /// The laser is on in every second row only.
    const EVERY_SECOND_ROW: u32 = 1 << 31;

    /// Sets the exposure of the rows to come: of every second row, if the ambient light is to be subtracted.
    pub fn set(&self, exposure: Option<Exposure>, ambient: AmbientMode) {
        let us = u32::from(exposure.map_or(0, Exposure::us));
        let rows = match ambient {
            AmbientMode::Off => 0,
            AmbientMode::Subtract => Self::EVERY_SECOND_ROW,
        };
        // Relaxed: this orders nothing.
        self.0.store(us | rows, Ordering::Relaxed);
    }

    /// The exposure of the row that follows one with the exposure `before`. `None` if the laser is off.
    pub fn exposure_after(&self, before: Option<Exposure>) -> Option<Exposure> {
        let order = self.0.load(Ordering::Relaxed);
        if order & Self::EVERY_SECOND_ROW != 0 && before.is_some() {
            return None;
        }
        let us = order & !Self::EVERY_SECOND_ROW;
        u16::try_from(us).ok().and_then(Exposure::from_us)
    }
}
