//! Known distances and the centres that a sensor had there: a CSV file of `x_px`, `d_mm` and, if there, `sigma_px`.

/// A centre at a known distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The line of the file that it comes from, from 1.
    pub line: u64,
    /// The spot's centre in pixels.
    pub x_px: f64,
    /// The target's distance in millimetres.
    pub d_mm: f64,
    /// The centre's standard uncertainty in pixels, where it is known.
    pub sigma_px: Option<f64>,
}
