//! `slitrange calibrate fit` against known truth.

mod accuracy;
mod truth;
