//! A sensor of another geometry: 2048 pixels of 14 um, whose words rise with light.
//!
//!     cargo run --package slitrange --example other_sensor

use slitrange::distance::eq1::{Eq1, Eq1Error};
use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Geometry, Measurement, Micrometres, Options,
    Pixels, Polarity, Surface,
};

/// The sensor behind a 12-bit converter. It has no shielded pixels, and its driver reads 16 words before the
/// first pixel.
fn geometry() -> Geometry {
    Geometry {
        words: 16 + 2048,
        shielded: 0..0,
        light: 16..16 + 2048,
        polarity: Polarity::Rising,
        bits: 12,
        // 80 ke- at saturation over 4096 counts: 20 electrons make a count.
        shot_variance_per_count_q16: u16::MAX / 20,
        saturation: 4095,
    }
}

/// Eq. (1) of a slit 50 mm from the sensor and a laser 300 mm beside it, whose beam leans by tan u = 2.6: D +
/// K / (x - xp).
fn calibration() -> Result<Calibration, Eq1Error> {
    let (slit, baseline, t) = (50_000.0 / 14.0, 300_000.0, 2.6);
    let k = baseline * slit * (1.0 + t * t) / (t * t);
    let pole = Pixels::from_f32((1023.5 - slit / t) as f32);
    let range = Pixels::from_int(700)..=Pixels::from_int(1500);
    let d = Micrometres::from_f32((-baseline / t) as f32);
    Eq1::new(d, (k * 65536.0) as i64, pole, range).map(Calibration::Eq1)
}

/// The words of a read-out: a spot of 1500 counts with a sigma of 5 pixels at a centre of 1100.4 pixels.
fn words(number: u32) -> Vec<u16> {
    let word = |i: usize| {
        let u = (i as f64 - 16.0 - 1100.4) / 5.0;
        let noise = (i as u32 + 3000 * number).wrapping_mul(2_654_435_761) >> 29;
        (250.0 + 1500.0 * (-0.5 * u * u).exp()) as u16 + noise as u16
    };
    (0..16 + 2048).map(word).collect()
}

/// Measures a frame of four rows. Without shielded pixels the black level comes from the pixels away from the
/// spot.
pub fn main() {
    let options = Options {
        rows: 4,
        black_level: BlackLevel::Frame,
        ..Options::default()
    };
    let mut measurement = Measurement::new(geometry(), options);
    let frame = (0..).find_map(|number| measurement.row(&mut words(number)));
    let measured = frame.expect("four rows are a frame").expect("a centre");
    let calibration = calibration().expect("a curve over these centres");
    // This calibration has no uncertainties, and the target is smooth: u holds noise and pixels only.
    let errors = CalibrationErrors::Unknown;
    let reading = measured
        .reading(Some(&calibration), &errors, Surface::Off)
        .expect("a distance");
    println!("{:.1} um", reading.distance);
    assert!((reading.centre.to_f64() - 1100.4).abs() < 0.01);
    assert!((reading.black_level.to_f64() - 253.5).abs() < 0.5);
    // -115.385 mm + 1.22993e6 mm px / 1450.53 px.
    assert!((reading.distance.to_f64() / 1000.0 - 732.53).abs() < 0.2);
}
