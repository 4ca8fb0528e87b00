//! The design, in f64, of slitrange's phase tables: the integer weights with which the firmware finds the centre of a
//! spot to a fraction of a pixel.
//!
//! A table holds, for each of a few sub-pixel phases of the spot, three rows of weights. Their inner products with the
//! counts around the spot are
//!
//! * the **score**, which is zero where the spot is centred on the phase, and otherwise proportional to how far it is;
//! * the **slope** of the score, so that score / slope is the distance in pixels, whatever the amplitude;
//! * the **stretch**, so that stretch / slope says how much wider the spot is than the table's width.
//!
//! Every row of weights sums to zero exactly, so the black level drops out bit for bit.
//!
//! [`design`] makes the weights, [`Table::quantise`] makes integers of them, and [`rust_source`] writes them for the
//! firmware. The core's `estimator::tables` is the reader.

mod design;
mod quantise;

pub use design::{Profile, Shape, Table, design, gaussian};
pub use quantise::{IntegerTable, LARGEST_SAMPLE, rust_source};

/// Ratio of one width to the next. The core says which spots a table serves, and what that costs.
pub const WIDTH_RATIO: f64 = 1.2;

/// The narrowest table's width in pixels.
pub const NARROWEST: f64 = 0.8;

/// Number of widths: 0.8 to 8.56 pixels. Wider spots are summed in blocks of pixels until they fit; with four samples or
/// more a sigma that costs less than half a per cent.
pub const WIDTHS: usize = 14;

/// Weight of read noise against the peak's shot noise that is at most 6 % worse than the best for pure read noise and at
/// most 10 % worse for pure shot noise (the minimax).
pub const DEFAULT_NOISE_RATIO: f64 = 0.3;

/// Sub-pixel phases for a width in pixels: the narrower the spot, the smaller the range over which score / slope is
/// straight.
pub fn phases(width: f64) -> usize {
    match width {
        w if w >= 8.0 => 1,
        w if w >= 4.0 => 2,
        w if w >= 2.0 => 4,
        w if w >= 1.0 => 8,
        _ => 16,
    }
}

/// Half of the window in pixels for a width: beyond 4 sigma a window gains less than 0.1 %; one more pixel for the phase.
pub fn half_width(width: f64) -> usize {
    (4.0 * width + 1.0).ceil() as usize
}

/// The tables of a profile for every width.
///
/// `noise_ratio` is r, the read noise's variance over the shot noise's at the peak; infinity gives least squares.
pub fn set(profile: Profile<'_>, noise_ratio: f64) -> Vec<IntegerTable> {
    (0..WIDTHS)
        .map(|i| {
            let width = NARROWEST * WIDTH_RATIO.powi(i as i32);
            let shape = Shape {
                width,
                half_width: half_width(width),
                phases: phases(width),
            };
            design(profile, shape, noise_ratio).quantise()
        })
        .collect()
}
