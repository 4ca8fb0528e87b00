//! The core on a PC: seeded rows, statistics of its errors, reference estimators in f64, and a catalogue of
//! hard cases.

pub mod accuracy;
pub mod changing_light;
pub mod core_tables;
pub mod float_functions;
pub mod frames;
pub mod hard_cases;
pub mod measured_profile;
pub mod model;
pub mod profile_rows;
pub mod second_judge;
