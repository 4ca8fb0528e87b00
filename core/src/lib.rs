//! The core of a laser range sensor: rows of a line-scan image sensor in, distances with their uncertainty
//! out, or the fault that prevented them.
//!
//! A laser spot on the target shines through a slit onto the sensor, and the place where it falls says how
//! far away the target is. The core finds that place to a fraction of a pixel, by integer sums. The fit alone
//! takes a few hundred instructions. Its error is close to the Cramér-Rao bound (the smallest error that any
//! unbiased method can have with this noise). It knows no hardware, no clock and no allocation, cannot panic,
//! and runs the same on a microcontroller and on a PC.
//!
//! ```text
//! words -> row -> black level -> spot -> centre -> check -> frame -> distance -> reading
//!          a read-out in counts          of the row         mean     eq. (1)     or fault
//! ```
//!
//! [`Measurement`] takes rows and gives the centre of a frame. [`Measured::reading`] turns that centre into a
//! distance:
//!
//! ```
//! use slitrange::{Calibration, CalibrationErrors, Measurement, Options, Surface, sensor_heads};
//!
//! let head = sensor_heads::tcd1304dg();
//! // A row as the converter delivers it: words fall with light. A spot of 2000 counts is on pixel 1800 of
//! // the light range.
//! let spot = |i: usize| {
//!     let u = (i as f64 - head.light.start as f64 - 1800.0) / 9.0;
//!     2000.0 * (-0.5 * u * u).exp() + (i * 7 % 5 / 2) as f64
//! };
//! let mut words: Vec<u16> = (0..head.words).map(|i| (3800.0 - spot(i)) as u16).collect();
//!
//! let mut measurement = Measurement::new(head, Options { rows: 1, ..Options::default() });
//! let measured = measurement.row(&mut words).expect("a frame of one row is complete").expect("a centre");
//! // Nobody calibrated this head: u holds its tolerances, and speckle at its worst, on bare metal.
//! let nominal = Calibration::nominal();
//! let errors = CalibrationErrors::Nominal;
//! let reading = measured.reading(nominal.as_ref(), &errors, Surface::Auto).expect("a distance");
//! assert!((reading.centre.to_f64() - 1800.0).abs() < 0.02);
//! println!("{:.3} um, u {:.3} um", reading.distance, reading.uncertainty);
//! ```
//!
//! The folder `examples` starts from here: a row to a centre, a frame to a distance with its faults, a sensor
//! of another geometry.
//!
//! # Memory
//!
//! Static RAM on a 32-bit chip: two bytes for each word of a row, plus the values below that the program
//! keeps.
//!
//! | | bytes |
//! |---|---|
//! | [`Measurement`], with the frame under way, the sums over blocks, and the mean ambient light | 15,296 |
//! | [`Calibration`] | 2144 |
//! | [`row::pixels::flat_field::FlatField`], the map of the pixels with the sums for another one | 25,800 |
//! | [`Measured`], with the centre of each slit of a comb | 236 |
//! | [`Reading`], [`Geometry`], [`Options`] | 92 or less, each |
//!
//! Stack: a row takes 18 KB, because the search keeps the sums over its blocks, and 26 KB if a background
//! that rises along the row is removed first. A row of a comb takes 24 KB. docs/proofs.md says what the
//! firmware takes at most.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::cast_possible_truncation))]
#![cfg_attr(not(test), warn(clippy::cast_sign_loss, clippy::unwrap_used))]

// In the order of the pipeline: a module uses those before it (host-tests/tests/floors.rs). The blank lines
// keep rustfmt from sorting them.

pub mod base;

pub mod row;

pub mod light;

pub mod spot;

pub mod centre;

pub mod check;

pub mod frame;

pub mod distance;

pub mod reading;

pub mod measurement;

pub use base::fault::Fault;
pub use base::units::{Counts, Micrometres, Pixels};
pub use centre::{Estimator, RowCentre};
pub use distance::Calibration;
pub use frame::Mean;
pub use light::black_level::BlackLevel;
pub use measurement::{Measurement, Options};
pub use reading::uncertainty::{CalibrationErrors, Surface};
pub use reading::{Measured, Reading};
pub use row::{Geometry, Polarity, Row, sensor_heads};

#[cfg(test)]
mod tests;
