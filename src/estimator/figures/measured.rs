//! What each rung costs and how accurate it is. Written by `cargo cost`; not to be edited.

use super::{Estimator, Figures};

/// In the order of [`Estimator::ALL`].
#[rustfmt::skip]
pub const FIGURES: [Figures; 10] = [
    Figures { estimator: Estimator::Centroid, instructions: 2080, microseconds_tenths: 167, white_percent: 166, shot_percent: 139 },
    Figures { estimator: Estimator::Parabola, instructions: 675, microseconds_tenths: 62, white_percent: 65535, shot_percent: 65535 },
    Figures { estimator: Estimator::LogParabola, instructions: 913, microseconds_tenths: 87, white_percent: 65535, shot_percent: 65535 },
    Figures { estimator: Estimator::ZeroCrossing, instructions: 766, microseconds_tenths: 73, white_percent: 65535, shot_percent: 65535 },
    Figures { estimator: Estimator::Blocks, instructions: 673, microseconds_tenths: 69, white_percent: 112, shot_percent: 113 },
    Figures { estimator: Estimator::PhaseTable, instructions: 377, microseconds_tenths: 40, white_percent: 109, shot_percent: 111 },
    Figures { estimator: Estimator::Adaptive, instructions: 736, microseconds_tenths: 75, white_percent: 101, shot_percent: 103 },
    Figures { estimator: Estimator::Robust, instructions: 15539, microseconds_tenths: 1460, white_percent: 570, shot_percent: 236 },
    Figures { estimator: Estimator::GaussNewton, instructions: 18537, microseconds_tenths: 1981, white_percent: 65535, shot_percent: 178 },
    Figures { estimator: Estimator::Fraunhofer, instructions: 869, microseconds_tenths: 87, white_percent: 65535, shot_percent: 65535 },
];
