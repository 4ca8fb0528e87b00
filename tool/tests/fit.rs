//! `slitrange calibrate fit` against known truth.

mod accuracy;
mod comb;
mod command;
mod errors;
mod own_spot;
mod properties;
mod refusals;
mod truth;
