//! The reference: an unweighted four-parameter least-squares fit of a gaussian in f64 (the paper's eq. (5) with the black
//! level), by the Levenberg-Marquardt method.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{Dyn, Matrix, OMatrix, OVector, Owned, U4, Vector4, storage::Owned as OwnedStorage};

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

/// Fits a gaussian to the spot of `row` that is highest near pixel `near`: first to what is within the half width at half
/// maximum, and then to what lies within four sigma of the centre until that window rests. `None` where no fit is found.
pub fn fit_near(row: &[f64], near: f64) -> Option<Gaussian> {
    // Spots of a pixel or of a hundred: the smoothed top's half height gives the start.
    let mut sorted = row.to_vec();
    sorted.sort_by(f64::total_cmp);
    let level = *sorted.get(sorted.len() / 4)?;
    let middle = (near.round().max(0.0) as usize).min(row.len() - 1);
    let top = mean(&row[middle.saturating_sub(2)..(middle + 3).min(row.len())]);
    let half = (top + level) / 2.0;
    let left = row[..middle]
        .iter()
        .rev()
        .take_while(|&&count| count > half)
        .count();
    let right = row[middle..]
        .iter()
        .take_while(|&&count| count > half)
        .count();
    let width = ((left + right) as f64 / 2.355).max(0.5);
    let mut best = Gaussian {
        centre: near,
        width,
        amplitude: top - level,
        level,
    };
    let mut window = 0..0;
    for _ in 0..30 {
        let from = (best.centre - HALF_WINDOW * best.width)
            .round()
            .clamp(0.0, row.len() as f64) as usize;
        let to = (best.centre + HALF_WINDOW * best.width + 1.0)
            .round()
            .clamp(0.0, row.len() as f64) as usize;
        if (from..to) == window || to < from + 5 {
            break;
        }
        window = from..to;
        best = fit_from(&row[window.clone()], from, best)?;
    }
    Some(best)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Fits the pixels given, the first of which has number `first`, each with the weight that `weight` gives a pixel of a number under
/// the gaussian that was found last: until the centre rests to a millionth of a pixel. `None` where no fit is found.
pub fn fit_weighted(
    pixels: &[f64],
    first: usize,
    start: Gaussian,
    weight: impl Fn(&Gaussian, f64) -> f64,
) -> Option<Gaussian> {
    let mut best = start;
    for _ in 0..30 {
        let weights = (first..)
            .take(pixels.len())
            .map(|i| weight(&best, i as f64));
        let found = fit(pixels, first, best, weights.map(f64::sqrt).collect())?;
        let step = found.centre - best.centre;
        best = found;
        if step.abs() < 1e-6 {
            return Some(best);
        }
    }
    None
}

/// Fits the pixels given, the first of which has number `first`.
fn fit_from(pixels: &[f64], first: usize, start: Gaussian) -> Option<Gaussian> {
    fit(pixels, first, start, vec![1.0; pixels.len()])
}

fn fit(pixels: &[f64], first: usize, start: Gaussian, root_weights: Vec<f64>) -> Option<Gaussian> {
    // Parameters in units of the start: (centre - start)/width, width/width, amplitude and level/amplitude.
    let problem = Problem {
        pixels,
        first: first as f64,
        root_weights,
        start,
        scaled: Vector4::new(0.0, 1.0, 1.0, start.level / start.amplitude),
    };
    let (problem, report) = LevenbergMarquardt::new().with_tol(1e-12).minimize(problem);
    let found = problem.gaussian();
    (report.termination.was_successful() && found.width.abs() > 0.1 && found.centre.is_finite())
        .then_some(Gaussian {
            width: found.width.abs(),
            ..found
        })
}

struct Problem<'a> {
    pixels: &'a [f64],
    first: f64,
    root_weights: Vec<f64>,
    start: Gaussian,
    scaled: Vector4<f64>,
}

impl Problem<'_> {
    fn gaussian(&self) -> Gaussian {
        Gaussian {
            centre: self.start.centre + self.scaled[0] * self.start.width,
            width: self.scaled[1] * self.start.width,
            amplitude: self.scaled[2] * self.start.amplitude,
            level: self.scaled[3] * self.start.amplitude,
        }
    }
}

impl LeastSquaresProblem<f64, Dyn, U4> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = OwnedStorage<f64, Dyn, U4>;
    type ParameterStorage = Owned<f64, U4>;

    fn set_params(&mut self, scaled: &Vector4<f64>) {
        self.scaled = *scaled;
    }

    fn params(&self) -> Vector4<f64> {
        self.scaled
    }

    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        let gaussian = self.gaussian();
        let pixels = self.pixels.iter().zip(&self.root_weights).enumerate();
        let residuals = pixels.map(|(i, (&count, weight))| {
            weight * (gaussian.at(self.first + i as f64) - count) / self.start.amplitude
        });
        Some(OVector::<f64, Dyn>::from_iterator(
            self.pixels.len(),
            residuals,
        ))
    }

    fn jacobian(&self) -> Option<Matrix<f64, Dyn, U4, Self::JacobianStorage>> {
        let gaussian = self.gaussian();
        Some(OMatrix::<f64, Dyn, U4>::from_fn(
            self.pixels.len(),
            |i, j| {
                let u = (self.first + i as f64 - gaussian.centre) / gaussian.width;
                let light = (-0.5 * u * u).exp();
                let height = gaussian.amplitude / self.start.amplitude;
                self.root_weights[i]
                    * match j {
                        0 => height * light * u / gaussian.width * self.start.width,
                        1 => height * light * u * u / gaussian.width * self.start.width,
                        2 => light,
                        _ => 1.0,
                    }
            },
        ))
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
        assert!(
            (found.centre - truth.centre).abs() < 1e-6 && (found.width - truth.width).abs() < 1e-6,
            "{found:?}"
        );
    }
}
