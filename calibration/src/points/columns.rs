//! The columns of a file of points. A run writes them in this order, and a fit finds them by their names.

use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::frame::comb::MAX_SLITS;

/// The centre in pixels.
pub const X: &str = "x_px";
/// The target's distance in millimetres.
pub const D: &str = "d_mm";
/// The centre's standard uncertainty in pixels.
pub const SIGMA: &str = "sigma_px";
/// The number of frames.
pub const FRAMES: &str = "frames";
/// The standard uncertainty of a frame's centre in pixels that the sensor claims.
pub const CLAIMED: &str = "claimed_px";
/// The spot's height in counts.
pub const HEIGHT: &str = "height_counts";
/// The spot's width in pixels.
pub const WIDTH: &str = "width_px";
/// The components of the spot's shape in pixels.
pub const SHAPE: [&str; COMPONENTS] = [
    "shape_0_px",
    "shape_1_px",
    "shape_2_px",
    "shape_3_px",
    "shape_4_px",
];

/// The columns of a sensor with one slit.
pub const ONE_SLIT: [&str; 15] = [
    X,
    D,
    SIGMA,
    FRAMES,
    "scatter_px",
    CLAIMED,
    "misfits",
    "correlated",
    HEIGHT,
    WIDTH,
    SHAPE[0],
    SHAPE[1],
    SHAPE[2],
    SHAPE[3],
    SHAPE[4],
];

/// The further columns of a comb: for each slit the centre of its image in pixels, and its height in counts.
pub fn comb() -> Vec<String> {
    let numbers = 1..=MAX_SLITS;
    let of_slit = |slit| [format!("slit_{slit}_px"), format!("slit_{slit}_counts")];
    numbers.flat_map(of_slit).collect()
}
