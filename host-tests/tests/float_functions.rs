//! What the exponential of `libm` does to a centre. docs/accuracy.md also shows that of `micromath`.

use crate::support::*;
use judges::float_functions::{Exp, WIDTHS, cell, change_of_centre, fitted_centre};

const EXACT: Exp = |x| f64::from(x).exp() as f32;

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
fn the_exponential_changes_a_centre_by_less_than_a_thousandth_of_the_bound() {
    for width in WIDTHS {
        let cell = cell(width);
        let change = change_of_centre(&cell, libm::expf, EXACT) / cell.spot().bound();
        println!("width {width}: {change:.1e} of the bound");
        assert!(change < 1e-3, "{width}: {change}");
    }
}
