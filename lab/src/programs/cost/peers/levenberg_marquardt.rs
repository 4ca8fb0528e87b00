//! The crate `levenberg-marquardt`, in f64 and f32, with analytic derivatives.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DVector, Dyn, MatrixXx4, Owned, RealField, U4, Vector4, convert};
use num_traits::Float;

use super::gaussian::{Parameters, WINDOW, derivatives, light};

/// Fits with the crate's default tolerances, 30 epsilon: 7e-15 in f64, 4e-6 in f32.
pub fn fit<T: RealField + Float>(pixels: &[T; WINDOW], start: Parameters) -> Option<Parameters> {
    let parameters = Vector4::from(start.to_array()).map(convert);
    let (problem, report) = LevenbergMarquardt::new().minimize(Problem::new(pixels, parameters));
    let found = problem.parameters.map(|value| value.to_f64());
    let [Some(amplitude), Some(centre), Some(scale), Some(level)] = found.data.0[0] else {
        return None;
    };
    let found = Parameters::from_array([amplitude, centre, scale, level]);
    report.termination.was_successful().then_some(found)
}

struct Problem<'a, T> {
    pixels: &'a [T; WINDOW],
    parameters: Vector4<T>,
    light: [T; WINDOW],
}

impl<'a, T: RealField + Copy> Problem<'a, T> {
    fn new(pixels: &'a [T; WINDOW], parameters: Vector4<T>) -> Self {
        Self {
            pixels,
            parameters,
            light: light(parameters[1], parameters[2]),
        }
    }
}

// Sizes are dynamic because nalgebra's static ones end at 127.
impl<T: RealField + Copy> LeastSquaresProblem<T, Dyn, U4> for Problem<'_, T> {
    type ResidualStorage = Owned<T, Dyn>;
    type JacobianStorage = Owned<T, Dyn, U4>;
    type ParameterStorage = Owned<T, U4>;

    fn set_params(&mut self, parameters: &Vector4<T>) {
        *self = Self::new(self.pixels, *parameters);
    }

    fn params(&self) -> Vector4<T> {
        self.parameters
    }

    fn residuals(&self) -> Option<DVector<T>> {
        let [amplitude, _, _, level] = self.parameters.data.0[0];
        let both = self.light.iter().zip(self.pixels);
        let residuals = both.map(|(&light, &count)| amplitude * light + level - count);
        Some(DVector::from_iterator(WINDOW, residuals))
    }

    fn jacobian(&self) -> Option<MatrixXx4<T>> {
        let mut jacobian = MatrixXx4::zeros(WINDOW);
        for (pixel, &light) in self.light.iter().enumerate() {
            let derivatives = derivatives(pixel, light, &self.parameters);
            for (parameter, derivative) in derivatives.into_iter().enumerate() {
                jacobian[(pixel, parameter)] = derivative;
            }
        }
        Some(jacobian)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::cost::peers::gaussian::examples;

    #[test]
    fn derivatives_are_those_of_the_residuals() {
        let (_, pixels) = examples::noiseless();
        let mut problem = Problem::new(&pixels, Vector4::from(examples::start().to_array()));
        let numeric = levenberg_marquardt::differentiate_numerically(&mut problem).expect("values");
        let analytic = problem.jacobian().expect("values");
        // Column by column, because s has derivatives 10^5 times larger than b.
        for (numeric, analytic) in numeric.column_iter().zip(analytic.column_iter()) {
            let off = (numeric - analytic).amax() / analytic.amax();
            println!("numeric and analytic derivatives differ by {off:.1e}");
            assert!(off < 1e-7);
        }
    }
}
