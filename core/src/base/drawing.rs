//! The nominal geometry of slit, sensor and laser.

/// The paper's geometry on a TCD1304DG: slit 50 mm from the sensor (f), baseline 300 mm (b), optical axis
/// through the middle of the 3648 pixels of 8 um. tan u is 2.6, and d0 is 0.
pub const DRAWING: Drawing = Drawing {
    baseline_um: 300_000.0,
    focal_px: 50_000.0 / 8.0,
    axis_px: 1823.5,
    pitch_um: 8.0,
};

/// See [`DRAWING`].
#[derive(Clone, Copy, Debug)]
pub struct Drawing {
    /// From the laser to the slit, in micrometres.
    pub baseline_um: f32,
    /// From the slit to the sensor, in pixels.
    pub focal_px: f32,
    /// The pixel on the optical axis.
    pub axis_px: f32,
    /// From pixel to pixel, in micrometres.
    pub pitch_um: f32,
}

/// tan u of [`DRAWING`].
pub const T: f64 = 2.6;
