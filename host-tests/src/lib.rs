//! slitrange on a PC: scenes, the Cramér-Rao bound and reference estimators in f64, against which the core is measured.

pub mod accuracy;
pub mod bound;
pub mod budget;
pub mod core_tables;
pub mod distorted_optics;
pub mod docs;
pub mod field;
pub mod grid;
pub mod hard_cases;
pub mod ladder;
pub mod least_squares;
pub mod measured_profile;
pub mod model;
pub mod optics;
pub mod paper;
pub mod photograph;
pub mod profiles;
pub mod scene;
pub mod sinc_fit;
