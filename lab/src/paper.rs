//! The paper's experiment (sections 3 and 4), simulated: a position table moves six materials past a laser,
//! and a camera looks at the spot through a lens or through a slit.
//!
//! ```text
//! surface, view -> light -> effects of the lens -> noise -> fit -> centre -> eq. (1) -> error
//! (materials)      (field)  (lens_effects)      (camera)  (slit_path, lens_path)  (fit::eq1)  (errors)
//! ```
//!
//! The fit of eq. (1) is that of `slitrange calibrate fit` ([`calibration::fit::eq1`]). The slit's rows go
//! through the core itself. Beside the paper's methods, ours runs on the same captures ([`methods`]).

pub mod apparatus;
pub mod camera;
pub mod data_set;
pub mod errors;
pub mod experiment;
pub mod firmware;
pub mod lens_effects;
pub mod lens_path;
pub mod materials;
pub mod methods;
pub mod plane_gaussian;
pub mod published;
#[cfg(test)]
mod reference;
pub mod row_mean;
pub mod slit_path;
