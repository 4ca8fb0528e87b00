//! One row of counts to the centre of its spot, in pixels.
//!
//!     cargo run --package slitrange --example row_to_centre

use slitrange::measurement::centre_of_spot;
use slitrange::{Estimator, Geometry, Polarity, Row, spot};

/// Counts of 1000 pixels, light positive: black of 120, noise of a count or two, and a spot of 1500 counts
/// with a sigma of 6 pixels.
fn counts(centre: f64) -> Vec<u16> {
    let count = |i: usize| {
        let u = (i as f64 - centre) / 6.0;
        let noise = (i as u32).wrapping_mul(2_654_435_761) >> 30;
        (120.0 + 1500.0 * (-0.5 * u * u).exp()) as u16 + noise as u16
    };
    (0..1000).map(count).collect()
}

/// Finds the spot, then its centre.
pub fn main() {
    // What the core must know of the sensor.
    let geometry = Geometry {
        words: 1000,
        shielded: 0..0,
        light: 0..1000,
        polarity: Polarity::Rising,
        bits: 12,
        // 20 electrons make a count.
        shot_variance_per_count_q16: u16::MAX / 20,
        saturation: 4095,
    };
    let light = counts(412.3);
    let row = Row::new(&light, &[], geometry.saturated_from()).expect("a row of 12-bit counts");
    let (spot, budget) = spot::find(&row).expect("a spot");
    let estimator = Estimator::default();
    let found =
        centre_of_spot(estimator, &row, &spot, None, &geometry, None, budget).expect("a centre");
    println!(
        "centre {} +- {} px, height {} counts, sigma {:.2} px{}",
        found.centre,
        found.uncertainty,
        found.amplitude,
        found.width,
        if found.misfit {
            ", not shaped like a spot"
        } else {
            ""
        }
    );
    let error = found.centre.to_f64() - 412.3;
    assert!(error.abs() < 5.0 * found.uncertainty.to_f64(), "{error}");
    assert!(!found.misfit);
}
