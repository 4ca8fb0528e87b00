//! Frames of rows to distances, and what to do where there is none.
//!
//!     cargo run --package slitrange --example frame_to_distance

use slitrange::{
    Calibration, CalibrationErrors, Fault, Measurement, Options, Reading, Surface, sensor_heads,
};

/// The words of a read-out, which fall with light: a spot of some height at a place in pixels, and noise that
/// differs from row to row.
fn words(number: u32, centre: f64, height: f64) -> Vec<u16> {
    let head = sensor_heads::tcd1304dg();
    let word = |i: usize| {
        let u = (i as f64 - head.light.start as f64 - centre) / 9.0;
        let noise = (i as u32 + 5000 * number).wrapping_mul(2_654_435_761) >> 29;
        // Light cannot make a word less than zero.
        (3800.0 - height * (-0.5 * u * u).exp()).max(0.0) as u16 + noise as u16
    };
    (0..head.words).map(word).collect()
}

/// Takes rows until the frame is complete.
fn measure(centre: f64, height: f64) -> Result<Reading, Fault> {
    // A sensor without a calibration of its own has that of the nominal geometry.
    let calibration = Calibration::nominal();
    let options = Options {
        rows: 16,
        ..Options::default()
    };
    let mut measurement = Measurement::new(sensor_heads::tcd1304dg(), options);
    let frame = (0..).find_map(|number| measurement.row(&mut words(number, centre, height)));
    frame.expect("16 rows are a frame")?.reading(
        calibration.as_ref(),
        &CalibrationErrors::Nominal,
        Surface::Auto,
    )
}

/// A good frame, a dim one, one that is too bright, and one outside the calibration.
pub fn main() {
    let frames = [
        (1770.0, 2000.0),
        (1770.0, 3.0),
        (1770.0, 9000.0),
        (150.0, 2000.0),
    ];
    let readings = frames.map(|(centre, height)| measure(centre, height));
    for reading in &readings {
        match reading {
            Ok(reading) => println!("{:.1} um", reading.distance),
            Err(fault) => println!("{fault}"),
        }
    }
    let [good, dim, bright, outside] = readings;
    let good = good.expect("a distance");
    // -115.385 mm + 2.152367e6 mm px / 2350.35 px.
    assert!((good.distance.to_f64() / 1000.0 - 800.38).abs() < 0.01);
    assert!(good.amplitude < sensor_heads::tcd1304dg().height_limit(good.black_level));
    assert!(matches!(
        dim,
        Err(Fault::NoSpot { .. } | Fault::TooDim { .. })
    ));
    assert!(matches!(bright, Err(Fault::Saturated { .. })));
    assert!(matches!(outside, Err(Fault::OutOfRange { .. })));
}
