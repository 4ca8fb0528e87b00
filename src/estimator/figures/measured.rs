//! What each rung costs and how accurate it is. Written by `cargo cost`; not to be edited.

use super::{Estimator, Figures};

/// In the order of [`Estimator::ALL`].
#[rustfmt::skip]
pub const FIGURES: [Figures; 10] = [
    Figures { estimator: Estimator::Centroid, instructions: 2080, microseconds_tenths: 167, white_percent: 312, shot_percent: 139 },
    Figures { estimator: Estimator::Parabola, instructions: 734, microseconds_tenths: 68, white_percent: 7294, shot_percent: 6504 },
    Figures { estimator: Estimator::LogParabola, instructions: 977, microseconds_tenths: 93, white_percent: 7291, shot_percent: 6502 },
    Figures { estimator: Estimator::ZeroCrossing, instructions: 842, microseconds_tenths: 81, white_percent: 1130, shot_percent: 235 },
    Figures { estimator: Estimator::Blocks, instructions: 675, microseconds_tenths: 69, white_percent: 112, shot_percent: 111 },
    Figures { estimator: Estimator::PhaseTable, instructions: 377, microseconds_tenths: 39, white_percent: 109, shot_percent: 109 },
    Figures { estimator: Estimator::Adaptive, instructions: 740, microseconds_tenths: 74, white_percent: 100, shot_percent: 102 },
    Figures { estimator: Estimator::Robust, instructions: 12763, microseconds_tenths: 1146, white_percent: 100, shot_percent: 102 },
    Figures { estimator: Estimator::GaussNewton, instructions: 18654, microseconds_tenths: 1989, white_percent: 100, shot_percent: 101 },
    Figures { estimator: Estimator::Fraunhofer, instructions: 871, microseconds_tenths: 87, white_percent: 156, shot_percent: 111 },
];
