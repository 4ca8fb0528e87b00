//! The world before the sensor, simulated: laser, slit or lens, surface and line sensor.
//!
//! A [`scene`] lists its effects, and each effect is a file with its physics and source. An effect that a
//! scene does not list costs nothing and changes nothing. Beside the rows stands what they truly show: the
//! Cramér-Rao [`bound`] (the smallest error that any unbiased method can have with the row's noise) and
//! reference fits in f64 ([`least_squares`], [`sinc_fit`]).
#![forbid(unsafe_code)]

// A module uses those before it (host-tests/tests/floors.rs). The blank lines keep rustfmt from sorting them.
pub mod sensor;

pub mod optics;

pub mod distorted_optics;

pub mod least_squares;

pub mod sinc_fit;

pub mod field;

pub mod scene;

pub mod bound;

pub mod profiles;

pub mod photograph;

/// A value with a change: `with(Scene::white_paper(), |it| it.seed = 2)`.
pub fn with<T>(mut value: T, change: impl FnOnce(&mut T)) -> T {
    change(&mut value);
    value
}
