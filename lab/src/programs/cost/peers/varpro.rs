//! The crate `varpro`: variable projection, which solves for A and b exactly at each step and searches for x0
//! and s only.
//!
//! The model is written out and remembers its gaussian, as the crate's documentation advises "for maximum
//! performance".

use std::convert::Infallible;

use nalgebra::{DMatrix, DVector, dvector};
use varpro::model::SeparableNonlinearModel;
use varpro::problem::SeparableProblemBuilder;
use varpro::solvers::levmar::LevMarSolver;

use super::gaussian::{Parameters, WINDOW, derivatives, light};

pub fn fit(pixels: &[f64; WINDOW], start: Parameters) -> Option<Parameters> {
    let problem = SeparableProblemBuilder::new(Model::new(start.centre, start.scale))
        .observations(DVector::from_column_slice(pixels))
        .build()
        .ok()?;
    let fit = LevMarSolver::default().solve(problem).ok()?;
    let (nonlinear, linear) = (fit.nonlinear_parameters(), fit.linear_coefficients()?);
    Some(Parameters {
        amplitude: linear[0],
        centre: nonlinear[0],
        scale: nonlinear[1],
        level: linear[1],
    })
}

/// Two columns: the gaussian of x0 and s, and ones.
struct Model {
    centre: f64,
    scale: f64,
    light: [f64; WINDOW],
}

impl Model {
    fn new(centre: f64, scale: f64) -> Self {
        Self {
            centre,
            scale,
            light: light(centre, scale),
        }
    }
}

impl SeparableNonlinearModel for Model {
    type ScalarType = f64;
    type Error = Infallible;

    fn parameter_count(&self) -> usize {
        2
    }

    fn base_function_count(&self) -> usize {
        2
    }

    fn output_len(&self) -> usize {
        WINDOW
    }

    fn set_params(&mut self, parameters: DVector<f64>) -> Result<(), Infallible> {
        *self = Self::new(parameters[0], parameters[1]);
        Ok(())
    }

    fn params(&self) -> DVector<f64> {
        dvector![self.centre, self.scale]
    }

    fn eval(&self) -> Result<DMatrix<f64>, Infallible> {
        let mut columns = DMatrix::from_element(WINDOW, 2, 1.0);
        columns.column_mut(0).copy_from_slice(&self.light);
        Ok(columns)
    }

    fn eval_partial_deriv(&self, parameter: usize) -> Result<DMatrix<f64>, Infallible> {
        let mut columns = DMatrix::zeros(WINDOW, 2);
        let unit = [1.0, self.centre, self.scale, 0.0].into();
        let mut column = columns.column_mut(0);
        for (pixel, (value, &light)) in column.iter_mut().zip(&self.light).enumerate() {
            *value = derivatives(pixel, light, &unit)[1 + parameter];
        }
        Ok(columns)
    }
}
