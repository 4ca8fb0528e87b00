//! The paper's experiment (sections 3 and 4), simulated.

pub mod eq1_fit;
pub mod plane_gaussian;
pub mod camera;
