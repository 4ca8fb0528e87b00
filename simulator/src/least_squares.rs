//! The reference: an unweighted four-parameter least-squares fit of a gaussian in f64 (the paper's eq. (5)
//! with the black level), by the Levenberg-Marquardt method.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{Dyn, Matrix, OMatrix, OVector, Owned, U1, U4, Vector4};
use statistics::mean;

/// A gaussian on a level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// Centre in pixels.
    pub centre: f64,
    /// Sigma in pixels.
    pub width: f64,
    /// Height in counts.
    pub amplitude: f64,
    /// Level beneath, in counts.
    pub level: f64,
}

impl Gaussian {
    /// Whether all pixels that the fit wants are within a row of this length.
    pub fn is_whole_in(&self, length: usize) -> bool {
        let reach = HALF_WINDOW * self.width;
        self.centre - reach >= 0.0 && self.centre + reach <= length as f64 - 1.0
    }

    /// The value at a pixel.
    pub fn at(&self, pixel: f64) -> f64 {
        let u = (pixel - self.centre) / self.width;
        self.level + self.amplitude * (-0.5 * u * u).exp()
    }
}

/// The fit takes the pixels within this many sigma.
const HALF_WINDOW: f64 = 4.0;

/// Fits a gaussian to the spot of `row` that is highest near pixel `near`: first to what is within the half
/// width at half maximum, and then to what lies within four sigma of the centre until that window rests.
/// `None` where no fit is found.
pub fn fit_near(row: &[f64], near: f64) -> Option<Gaussian> {
    // Spots of a pixel or of a hundred: the smoothed top's half height gives the start.
    let mut sorted = row.to_vec();
    sorted.sort_by(f64::total_cmp);
    let level = *sorted.get(sorted.len() / 4)?;
    let middle = (near.round().max(0.0) as usize).min(row.len() - 1);
    let top = mean(&row[middle.saturating_sub(2)..(middle + 3).min(row.len())]);
    let half = (top + level) / 2.0;
    let is_lit = |count: &&f64| **count > half;
    let (left, right) = row.split_at(middle);
    let left = left.iter().rev().take_while(is_lit).count();
    let right = right.iter().take_while(is_lit).count();
    let width = ((left + right) as f64 / 2.355).max(0.5);
    let mut best = Gaussian {
        centre: near,
        width,
        amplitude: top - level,
        level,
    };
    let mut window = 0..0;
    for _ in 0..30 {
        let on_row = |place: f64| place.round().clamp(0.0, row.len() as f64) as usize;
        let from = on_row(best.centre - HALF_WINDOW * best.width);
        let to = on_row(best.centre + HALF_WINDOW * best.width + 1.0);
        if (from..to) == window || to < from + 5 {
            break;
        }
        window = from..to;
        best = fit(&row[window.clone()], from, best, vec![1.0; window.len()])?;
    }
    Some(best)
}

/// Fits the pixels given, the first of which has number `first`, each with the weight that `weight` gives a
/// pixel of a number under the gaussian that was found last: until the centre rests to a millionth of a
/// pixel. `None` where no fit is found.
pub fn fit_weighted(
    pixels: &[f64],
    first: usize,
    start: Gaussian,
    weight: impl Fn(&Gaussian, f64) -> f64,
) -> Option<Gaussian> {
    let mut best = start;
    for _ in 0..30 {
        let numbers = (first..).take(pixels.len());
        let weights = numbers.map(|i| weight(&best, i as f64));
        let found = fit(pixels, first, best, weights.map(f64::sqrt).collect())?;
        let step = found.centre - best.centre;
        best = found;
        if step.abs() < 1e-6 {
            return Some(best);
        }
    }
    None
}

fn fit(pixels: &[f64], first: usize, start: Gaussian, root_weights: Vec<f64>) -> Option<Gaussian> {
    let bell = |u: f64| {
        let light = (-0.5 * u * u).exp();
        (light, -u * light)
    };
    let start = Spot {
        centre: start.centre,
        extent: start.width,
        amplitude: start.amplitude,
        level: start.level,
    };
    let found = fit_shape(bell, pixels, first, start, root_weights)?;
    (found.extent.abs() > 0.1 && found.centre.is_finite()).then_some(Gaussian {
        centre: found.centre,
        width: found.extent.abs(),
        amplitude: found.amplitude,
        level: found.level,
    })
}

/// A spot of some shape on a level. The shape is of height 1, and gives its value and derivative so many
/// extents from its centre.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Centre in pixels.
    pub centre: f64,
    /// The unit of the shape's places, in pixels.
    pub extent: f64,
    /// Height in counts.
    pub amplitude: f64,
    /// Level beneath, in counts.
    pub level: f64,
}

/// Fits the pixels given, the first of which has number `first`, by the Levenberg-Marquardt method.
pub(crate) fn fit_shape(
    shape: impl Fn(f64) -> (f64, f64),
    pixels: &[f64],
    first: usize,
    start: Spot,
    root_weights: Vec<f64>,
) -> Option<Spot> {
    let problem = Problem {
        shape,
        pixels,
        first: first as f64,
        root_weights,
        start,
        scaled: Vector4::new(0.0, 1.0, 1.0, start.level / start.amplitude),
    };
    let (problem, report) = LevenbergMarquardt::new().with_tol(1e-12).minimize(problem);
    (report.termination.was_successful()).then(|| problem.spot())
}

struct Problem<'a, S> {
    shape: S,
    pixels: &'a [f64],
    first: f64,
    root_weights: Vec<f64>,
    start: Spot,
    /// In units of the start: (centre - start)/extent, extent/extent, amplitude and level over amplitude.
    scaled: Vector4<f64>,
}

impl<S: Fn(f64) -> (f64, f64)> Problem<'_, S> {
    fn spot(&self) -> Spot {
        Spot {
            centre: self.start.centre + self.scaled[0] * self.start.extent,
            extent: self.scaled[1] * self.start.extent,
            amplitude: self.scaled[2] * self.start.amplitude,
            level: self.scaled[3] * self.start.amplitude,
        }
    }

    /// A pixel's place in extents from the centre.
    fn place(&self, spot: &Spot, i: usize) -> f64 {
        (self.first + i as f64 - spot.centre) / spot.extent
    }
}

impl<S: Fn(f64) -> (f64, f64)> LeastSquaresProblem<f64, Dyn, U4> for Problem<'_, S> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, U4>;
    type ParameterStorage = Owned<f64, U4>;

    fn set_params(&mut self, scaled: &Vector4<f64>) {
        self.scaled = *scaled;
    }

    fn params(&self) -> Vector4<f64> {
        self.scaled
    }

    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        let spot = self.spot();
        let residual = |i: usize, _| {
            let (height, _) = (self.shape)(self.place(&spot, i));
            let light = spot.level + spot.amplitude * height;
            self.root_weights[i] * (light - self.pixels[i]) / self.start.amplitude
        };
        let length = Dyn(self.pixels.len());
        Some(OVector::<f64, Dyn>::from_fn_generic(length, U1, residual))
    }

    fn jacobian(&self) -> Option<Matrix<f64, Dyn, U4, Self::JacobianStorage>> {
        let spot = self.spot();
        let by_parameter = |i: usize, parameter: usize| {
            let u = self.place(&spot, i);
            let (height, slope) = (self.shape)(u);
            let by_u = spot.amplitude / self.start.amplitude * slope;
            let scale = self.start.extent / spot.extent;
            self.root_weights[i]
                * match parameter {
                    0 => -by_u * scale,
                    1 => -by_u * u * scale,
                    2 => height,
                    _ => 1.0,
                }
        };
        let derivatives = OMatrix::<f64, Dyn, U4>::from_fn(self.pixels.len(), by_parameter);
        Some(derivatives)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_a_noiseless_gaussian() {
        let truth = Gaussian {
            centre: 312.34,
            width: 22.0,
            amplitude: 1500.0,
            level: 180.0,
        };
        let row: Vec<f64> = (0..900).map(|i| truth.at(f64::from(i))).collect();
        let found = fit_near(&row, 300.0).expect("a fit");
        let off = [found.centre - truth.centre, found.width - truth.width];
        assert!(off.iter().all(|it| it.abs() < 1e-6), "{found:?}");
    }
}
