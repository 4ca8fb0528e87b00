//! Calibrations: tables of distances and of residuals in integers against f64, what holds for all of them,
//! and their record.

mod common;
mod figures;
mod record;
mod refusals;
mod residuals;
mod tables;
