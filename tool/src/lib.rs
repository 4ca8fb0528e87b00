//! What the owner of a sensor does on a PC: calibrate it.
//!
//! ```text
//! stage, sensor -> points -> fit -> record -> sensor
//!  (sensor::run)  (points)  (fit)  (record_file)  (sensor::transfer)
//! ```
//!
//! Distances are in millimetres where a person reads or writes them, in metres in computations.

pub mod axes;
pub mod fit;
pub mod points;
pub mod record_file;
pub mod sensor;
mod whole_file;
