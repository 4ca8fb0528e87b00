//! From centres at known distances to the record that a sensor keeps in its flash.
//!
//! ```text
//! points -> fit -> record
//! ```
//!
//! [`points`] reads the points, with the setup in which they were taken. [`fit`] finds outliers, eq. (1), and
//! the smooth curve of what eq. (1) leaves. [`record`] makes of them what the sensor holds, with its errors.
//! Before all of them, [`positions`] says at which distances to take points. Each module uses only those
//! before it.
//!
//! Distances are in millimetres in points, because a person writes them, and in metres in computations.
#![forbid(unsafe_code)]

pub mod fixed;

pub mod positions;

pub mod points;

pub mod fit;

pub mod record;
