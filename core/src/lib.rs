//! The core of slitrange, pure: rows of a line-scan image sensor in, distances or faults out.
//!
//! A laser spot on the target shines through a slit on the sensor. Where it falls says how far away the target is.
//!
//! ```text
//! words -> row -> black level -> spot -> estimator -> frame -> triangulation -> reading
//!          (row)  (black_level)  (spot)  (estimator)  (frame)  (triangulation)  (reading)
//! ```
//!
//! [`measurement::Measurement`] is all of it up to the calibration, which makes a reading of what was measured. It knows no hardware, no clock and no allocation, and runs the same on
//! the chip and on a PC:
//!
//! ```
//! use slitrange::{black_level::BlackLevel, distance::Calibration, centre::Estimator, frame::Mean};
//! use slitrange::{measurement::{Measurement, Settings}, sensor_heads};
//!
//! let settings = Settings { rows: 1, mean: Mean::Weighted, estimator: Estimator::default(), black_level: BlackLevel::Shielded, ..Settings::default() };
//! let calibration = Calibration::nominal();
//! let mut measurement = Measurement::new(sensor_heads::tcd1304dg(), settings);
//! // A row as the converter delivers it: words fall with light. A spot of 2000 counts is on pixel 1800 of the light range,
//! // and the pixels' noise is a count.
//! let first = sensor_heads::tcd1304dg().light.start;
//! let mut words: Vec<u16> = (0..3694)
//!     .map(|i| {
//!         let u = (i as f64 - first as f64 - 1800.0) / 9.0;
//!         (3800.0 - 2000.0 * (-0.5 * u * u).exp()) as u16 - (i as u16 * 7 % 5 / 2)
//!     })
//!     .collect();
//! let measured = measurement.row(&mut words).expect("a frame of one row is complete").expect("a centre");
//! let reading = measured.reading(calibration.as_ref()).expect("a distance");
//! assert!((reading.centre.to_f64() - 1800.0).abs() < 0.02);
//! println!("{reading}");
//! ```
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod black_level;
pub mod centre;
pub mod check;
pub mod distance;
pub mod fault;
pub mod frame;
pub mod measurement;
mod numeric;
pub mod protocol;
pub mod reading;
pub mod record;
pub mod row;
pub mod sensor_heads;
pub mod session;
pub mod settings;
pub mod spot;
pub mod store;
pub mod units;
