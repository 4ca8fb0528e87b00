//! The light around the spot: the black level, ambient light, and the exposure that gives the spot its
//! height.

pub mod ambient;
pub mod auto_exposure;
pub mod black_level;
