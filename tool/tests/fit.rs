//! `slitrange calibrate fit` against known truth.

mod command;
mod own_spot;
mod properties;
#[path = "../../calibration/tests/fit/truth.rs"]
#[expect(dead_code, reason = "the library's tests use all of it")]
mod truth;
