//! What each rung costs and how accurate it is. Written by `cargo cost`; not to be edited.

use super::{Estimator, Figures};

/// In the order of [`Estimator::ALL`].
#[rustfmt::skip]
pub const FIGURES: [Figures; 10] = [
    Figures { estimator: Estimator::Centroid, instructions: 1015, microseconds_tenths: 84, white_percent: 273, shot_percent: 115 },
    Figures { estimator: Estimator::Parabola, instructions: 60, microseconds_tenths: 6, white_percent: 3100, shot_percent: 3100 },
    Figures { estimator: Estimator::LogParabola, instructions: 120, microseconds_tenths: 11, white_percent: 3100, shot_percent: 3100 },
    Figures { estimator: Estimator::ZeroCrossing, instructions: 204, microseconds_tenths: 20, white_percent: 760, shot_percent: 270 },
    Figures { estimator: Estimator::Blocks, instructions: 299, microseconds_tenths: 25, white_percent: 113, shot_percent: 117 },
    Figures { estimator: Estimator::PhaseTable, instructions: 354, microseconds_tenths: 30, white_percent: 110, shot_percent: 114 },
    Figures { estimator: Estimator::Adaptive, instructions: 653, microseconds_tenths: 54, white_percent: 103, shot_percent: 104 },
    Figures { estimator: Estimator::Robust, instructions: 1416, microseconds_tenths: 121, white_percent: 105, shot_percent: 105 },
    Figures { estimator: Estimator::GaussNewton, instructions: 37553, microseconds_tenths: 2786, white_percent: 103, shot_percent: 104 },
    Figures { estimator: Estimator::Fraunhofer, instructions: 354, microseconds_tenths: 30, white_percent: 112, shot_percent: 118 },
];
