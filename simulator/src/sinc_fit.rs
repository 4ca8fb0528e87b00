//! The reference for the diffraction pattern of a slit: an unweighted four-parameter least-squares fit of eq.
//! (6), sinc^2 on a level, in f64, by the Levenberg-Marquardt method.

use crate::least_squares::{Spot, fit_shape};

/// The fit takes the pixels within this many zeros of the start.
const HALF_WINDOW: f64 = 3.0;

/// Fits the pixels around a start that is good to a fraction of the spot's width. The extent of sinc^2 is
/// from its centre to the first zero. `None` where no fit is found.
pub fn fit_from(row: &[f64], start: Spot) -> Option<Spot> {
    let reach = HALF_WINDOW * start.extent;
    let first = (start.centre - reach).round().max(0.0) as usize;
    let last = (start.centre + reach).round() as usize;
    let pixels = row.get(first..=last.min(row.len() - 1))?;
    let square = |u: f64| {
        let (height, slope) = sinc(u);
        (height * height, 2.0 * height * slope)
    };
    fit_shape(square, pixels, first, start, vec![1.0; pixels.len()])
}

/// sin(pi u) / (pi u) and its derivative by u.
fn sinc(u: f64) -> (f64, f64) {
    let x = std::f64::consts::PI * u;
    if x.abs() < 1e-4 {
        return (1.0 - x * x / 6.0, -std::f64::consts::PI * x / 3.0);
    }
    (x.sin() / x, (x.cos() - x.sin() / x) / u)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_a_noiseless_pattern() {
        let truth = Spot {
            centre: 312.34,
            extent: 22.0,
            amplitude: 1500.0,
            level: 180.0,
        };
        let count = |i| {
            let (height, _) = sinc((f64::from(i) - truth.centre) / truth.extent);
            truth.level + truth.amplitude * height * height
        };
        let row: Vec<f64> = (0..900).map(count).collect();
        let start = Spot {
            centre: 309.0,
            extent: 19.0,
            amplitude: 1000.0,
            level: 100.0,
        };
        let found = fit_from(&row, start).expect("a fit");
        let off = [found.centre - truth.centre, found.extent - truth.extent];
        assert!(off.iter().all(|it| it.abs() < 1e-6), "{found:?}");
    }
}
