//! The reference for the diffraction pattern of a slit: an unweighted four-parameter least-squares fit of eq. (6), sinc^2 on a level,
//! in f64, by the Levenberg-Marquardt method.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{Dyn, Matrix, OMatrix, OVector, Owned, U4, Vector4};

/// sinc^2 on a level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sinc {
    /// Centre in pixels.
    pub centre: f64,
    /// From the centre to the first zero, in pixels.
    pub zero: f64,
    /// Height in counts.
    pub amplitude: f64,
    /// Level beneath, in counts.
    pub level: f64,
}

/// The fit takes the pixels within this many zeros of the start.
const HALF_WINDOW: f64 = 3.0;

/// Fits the pixels around a start that is good to a fraction of the spot's width. `None` where no fit is found.
pub fn fit_from(row: &[f64], start: Sinc) -> Option<Sinc> {
    let reach = HALF_WINDOW * start.zero;
    let first = (start.centre - reach).round().max(0.0) as usize;
    let last = (start.centre + reach).round() as usize;
    let problem = Problem {
        pixels: row.get(first..=last.min(row.len() - 1))?,
        first: first as f64,
        start,
        scaled: Vector4::new(0.0, 1.0, 1.0, start.level / start.amplitude),
    };
    let (problem, report) = LevenbergMarquardt::new().with_tol(1e-12).minimize(problem);
    report
        .termination
        .was_successful()
        .then_some(problem.sinc())
}

/// Parameters are in units of the start: (centre - start)/zero, zero/zero, amplitude and level/amplitude.
struct Problem<'a> {
    pixels: &'a [f64],
    first: f64,
    start: Sinc,
    scaled: Vector4<f64>,
}

impl Problem<'_> {
    fn sinc(&self) -> Sinc {
        Sinc {
            centre: self.start.centre + self.scaled[0] * self.start.zero,
            zero: self.scaled[1] * self.start.zero,
            amplitude: self.scaled[2] * self.start.amplitude,
            level: self.scaled[3] * self.start.amplitude,
        }
    }
}

/// sin(pi u) / (pi u) and its derivative by u.
fn sinc(u: f64) -> (f64, f64) {
    let x = std::f64::consts::PI * u;
    if x.abs() < 1e-4 {
        return (1.0 - x * x / 6.0, -std::f64::consts::PI * x / 3.0);
    }
    (x.sin() / x, (x.cos() - x.sin() / x) / u)
}

impl LeastSquaresProblem<f64, Dyn, U4> for Problem<'_> {
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
        let fit = self.sinc();
        let residual = |(i, &count): (usize, &f64)| {
            let (height, _) = sinc((self.first + i as f64 - fit.centre) / fit.zero);
            (fit.level + fit.amplitude * height * height - count) / self.start.amplitude
        };
        let residuals = self.pixels.iter().enumerate().map(residual);
        Some(OVector::<f64, Dyn>::from_iterator(
            self.pixels.len(),
            residuals,
        ))
    }

    fn jacobian(&self) -> Option<Matrix<f64, Dyn, U4, Self::JacobianStorage>> {
        let fit = self.sinc();
        Some(OMatrix::<f64, Dyn, U4>::from_fn(
            self.pixels.len(),
            |i, j| {
                let u = (self.first + i as f64 - fit.centre) / fit.zero;
                let (height, slope) = sinc(u);
                let by_place = fit.amplitude / self.start.amplitude * 2.0 * height * slope;
                let scale = self.start.zero / fit.zero;
                match j {
                    0 => -by_place * scale,
                    1 => -by_place * u * scale,
                    2 => height * height,
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
    fn finds_a_noiseless_pattern() {
        let truth = Sinc {
            centre: 312.34,
            zero: 22.0,
            amplitude: 1500.0,
            level: 180.0,
        };
        let row: Vec<f64> = (0..900)
            .map(|i| {
                let (height, _) = sinc((f64::from(i) - truth.centre) / truth.zero);
                truth.level + truth.amplitude * height * height
            })
            .collect();
        let start = Sinc {
            centre: 309.0,
            zero: 19.0,
            amplitude: 1000.0,
            level: 100.0,
        };
        let found = fit_from(&row, start).expect("a fit");
        assert!(
            (found.centre - truth.centre).abs() < 1e-6 && (found.zero - truth.zero).abs() < 1e-6,
            "{found:?}"
        );
    }
}
