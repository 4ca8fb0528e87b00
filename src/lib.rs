//! todo
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod black_level;
pub mod estimator;
pub mod frame;
pub mod measurement;
pub mod protocol;
pub mod reading;
pub mod row;
pub mod sensor_heads;
pub mod spot;
pub mod triangulation;
pub mod units;
