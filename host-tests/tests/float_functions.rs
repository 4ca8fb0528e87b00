//! What the exponential of the crate `micromath` would do to a centre, beside that of `libm`.
//! docs/accuracy.md shows the figures: the reasons why the core takes `libm`.

use crate::support::*;
use judges::float_functions::{Exp, WIDTHS, cell, change_of_centre, fitted_centre};

const EXACT: Exp = |x| f64::from(x).exp() as f32;
const MICROMATH: Exp = |x| micromath::F32(x).exp().0;

/// The core's fit ends after a step of less than a tenth of a standard deviation. The error after a step is
/// about the square of that step, so it is then less than a hundredth of a standard deviation.
#[test]
fn the_fit_is_that_of_the_core() {
    for width in WIDTHS {
        let cell = cell(width);
        let geometry = cell.scene().geometry();
        for number in 0..50 {
            let (light, _) = cell.light(cell.pixels(), number);
            let core = centre_of(&geometry, &light, Estimator::GaussNewton).expect("a centre");
            let fitted = fitted_centre(libm::expf, &geometry, &light).expect("a centre");
            let difference = (fitted - core.centre.to_f64()).abs();
            let most = 0.01 * cell.spot().bound();
            assert!(difference <= most, "{width}: {difference}");
        }
    }
}

/// An exact exponential, rounded to an f32, is the reference. The recurrence multiplies an error of the ratio
/// by the number of steps, here at most 64, and adds roundings of its own.
#[test]
fn narrow_spots_need_a_better_exponential_than_micromaths() {
    for width in WIDTHS {
        let cell = cell(width);
        let bound = cell.spot().bound();
        let [libm, micromath] =
            [libm::expf, MICROMATH].map(|exp| change_of_centre(&cell, exp, EXACT) / bound);
        println!("width {width}: libm {libm:.1e} of the bound, micromath {micromath:.1e}");
        assert!(libm < 1e-3, "{width}: {libm}");
        if width <= 2.0 {
            assert!(micromath > 0.01, "{width}: {micromath}");
        }
    }
}
