//! The world before the sensor, simulated: laser, slit or lens, surface and line sensor.
//!
//! A [`scene`] lists its effects, and each effect is a file with its physics and source. An effect that a
//! scene does not list costs nothing and changes nothing. Beside the rows stands what they truly show: the
//! Cramér-Rao [`bound`] (the smallest error that any unbiased method can have with the row's noise) and
//! reference fits in f64 ([`least_squares`], [`sinc_fit`]).

pub mod bound;
pub mod comb;
pub mod distorted_optics;
pub mod field;
pub mod least_squares;
pub mod optics;
pub mod photograph;
pub mod profiles;
pub mod scene;
pub mod sinc_fit;
