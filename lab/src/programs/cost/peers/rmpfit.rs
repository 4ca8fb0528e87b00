//! The crate `rmpfit`, a translation of C's MPFIT.

use rmpfit::{MPError, MPFitter, MPPar, MPResult, MPSide, MPSuccess};

use super::gaussian::{Parameters, WINDOW, derivatives, light};

/// Fits with the crate's defaults: numeric derivatives, tolerances 1e-10.
pub fn fit(pixels: &[f64; WINDOW], start: Parameters) -> Option<Parameters> {
    run(pixels, start, &[])
}

/// The same with analytic derivatives.
pub fn fit_with_derivatives(pixels: &[f64; WINDOW], start: Parameters) -> Option<Parameters> {
    const ANALYTIC: MPPar = MPPar {
        side: MPSide::User,
        ..MPPar::new()
    };
    run(pixels, start, &[ANALYTIC; 4])
}

fn run(pixels: &[f64; WINDOW], start: Parameters, options: &[MPPar]) -> Option<Parameters> {
    let mut parameters = start.to_array();
    let status = Fitter { pixels, options }.mpfit(&mut parameters).ok()?;
    match status.success {
        MPSuccess::Chi | MPSuccess::Par | MPSuccess::Both | MPSuccess::Dir => {
            Some(Parameters::from_array(parameters))
        }
        _ => None,
    }
}

struct Fitter<'a> {
    pixels: &'a [f64; WINDOW],
    options: &'a [MPPar],
}

impl MPFitter for Fitter<'_> {
    fn number_of_points(&self) -> usize {
        WINDOW
    }

    fn parameters(&self) -> &[MPPar] {
        self.options
    }

    fn eval(&mut self, parameters: &[f64], deviates: &mut [f64]) -> MPResult<()> {
        let &[amplitude, centre, scale, level] = parameters else {
            return Err(MPError::Eval);
        };
        let light = light(centre, scale);
        for ((deviate, &count), light) in deviates.iter_mut().zip(self.pixels).zip(light) {
            *deviate = count - (amplitude * light + level);
        }
        Ok(())
    }

    fn jacobian(
        &mut self,
        parameters: &[f64],
        deviates: &mut [f64],
        columns: &mut [Option<Vec<f64>>],
    ) -> MPResult<()> {
        let (&[amplitude, centre, scale, level], [Some(a), Some(x0), Some(s), Some(b)]) =
            (parameters, columns)
        else {
            return Err(MPError::Eval);
        };
        let parameters = [amplitude, centre, scale, level].into();
        for (pixel, light) in light(centre, scale).into_iter().enumerate() {
            deviates[pixel] = self.pixels[pixel] - (amplitude * light + level);
            // The deviate falls where the model rises.
            [a[pixel], x0[pixel], s[pixel], b[pixel]] =
                derivatives(pixel, light, &parameters).map(|derivative| -derivative);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::cost::peers::gaussian::examples;

    #[test]
    fn finds_a_noiseless_gaussian() {
        let (truth, pixels) = examples::noiseless();
        for (name, fit) in [
            ("numeric", fit(&pixels, examples::start())),
            ("analytic", fit_with_derivatives(&pixels, examples::start())),
        ] {
            let off = fit.expect("a fit").centre - truth.centre;
            println!("{name}: {off:.1e} px off");
            assert!(off.abs() < 1e-6, "{name}: {off}");
        }
    }

    #[test]
    fn agrees_with_levenberg_marquardt() {
        for (window, bound) in examples::noisy(100) {
            let pixels = window.pixels.map(f64::from);
            let other =
                crate::programs::cost::peers::levenberg_marquardt::fit_f64(&pixels, window.start)
                    .expect("a fit");
            for fit in [fit, fit_with_derivatives] {
                let off =
                    (fit(&pixels, window.start).expect("a fit").centre - other.centre) / bound;
                assert!(off.abs() < 1e-3, "{off} of the bound");
            }
        }
    }
}
