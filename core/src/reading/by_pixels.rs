//! What the differences between pixels do to a centre.

use crate::base::numeric::at_least;
use crate::base::{Counts, Pixels};
use crate::centre::Estimator;
use crate::row::pixels::PixelErrors;

impl PixelErrors {
    /// The standard uncertainty in pixels of a spot's centre, by these errors: of a spot of a width (sigma)
    /// and a height, on a background of ambient light. It does not depend on the spot's place, and rises with
    /// the square root of the width, as the sum of so many independent pixels does.
    pub fn of_centre(
        self,
        estimator: Estimator,
        width: Pixels,
        height: Counts,
        ambient: Counts,
    ) -> f32 {
        let (by_response, by_offset) = weights(estimator);
        let response = f32::from(self.response_q16) / 65536.0;
        let height = at_least(height.to_f32(), 1.0);
        // Ambient light makes an offset of a response that differs.
        let offset = self.offset.to_f32();
        let under = response * ambient.to_f32();
        let offset = dual_mac::square_root(offset * offset + under * under) / height;
        let (response, offset) = (by_response * response, by_offset * offset);
        let width = at_least(width.to_f32(), 0.0);
        dual_mac::square_root(width * (response * response + offset * offset))
    }
}

/// How far independent errors of the pixels move a centre, over the square root of the width: relative errors
/// of the response, and offsets over the spot's height. The unweighted fit of a gaussian has 0.632 and 1.062
/// in closed form. Here the weights follow the shot noise of a TCD1304DG; host-tests/tests/uncertainty.rs
/// finds errors of 0.8 to 1.1 times these.
const fn weights(estimator: Estimator) -> (f32, f32) {
    match estimator {
        Estimator::Centroid => (0.42, 1.75),
        Estimator::PhaseTable => (0.49, 1.17),
        Estimator::Adaptive => (0.5, 1.1),
        Estimator::GaussNewton => (0.52, 1.1),
        Estimator::Fraunhofer => (0.45, 1.17),
    }
}
