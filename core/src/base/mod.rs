//! What all steps share: units, faults, exposures, arithmetic, and the work that a row may cost.

pub mod drawing;
pub mod exposure;
pub mod fault;
pub(crate) mod numeric;
pub mod order_statistic;
pub mod places;
pub mod units;
pub mod work_budget;

pub(crate) use exposure::{Exposure, ExposureMode};
pub(crate) use fault::Fault;
pub(crate) use units::{Counts, Electrons, Micrometres, Pixels};
pub(crate) use work_budget::WorkBudget;

/// The most rows in a frame.
pub const MAX_ROWS: u32 = 64;
