//! The names that most programs use.

pub use anyhow::{Context as _, Result, bail, ensure};
pub use clap::Args;
pub use rand::{Rng, SeedableRng};
pub use rand_chacha::ChaCha8Rng;
pub use rand_distr::{Distribution, StandardNormal};
pub use rayon::prelude::*;
pub use simulator::optics::{Aperture, Optics};
pub use simulator::scene::{Scene, Simulation, quantise};
pub use simulator::with;
pub use slitrange::frame::comb::Slits;
pub use slitrange::{
    Calibration, CalibrationErrors, Counts, Estimator, Fault, Geometry, Measured, Measurement,
    Micrometres, Pixels, Row, RowCentre, Surface, sensor_heads,
};
pub use statistics::{mean, rms, upper_median};
pub use std::collections::BTreeSet;
pub use std::path::{Path, PathBuf};
pub use std::time::Duration;
pub use virtual_board::{Firmware, VirtualBoard};
